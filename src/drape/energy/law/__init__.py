"""Constitutive laws of fabrics: what edges feel, units and networks of it, and the checkpoints that hold them."""
