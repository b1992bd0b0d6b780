"""Garments around a figure in its rest pose: a field, an iso-surface, cuts, an even mesh; numpy and scipy only."""
