"""Sparse matrices of meshes: sums of stencils into fixed patterns, and their factors."""
