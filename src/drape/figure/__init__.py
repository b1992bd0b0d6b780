"""A parametric human body from code: surface, skeleton, skinning, motions."""
