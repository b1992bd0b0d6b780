"""Cloth that meets itself and a body without crossing: incremental potential contact."""
