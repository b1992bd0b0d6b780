"""Normals of faces and vertices of triangle meshes, in NumPy."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int


def face_normals(
    positions: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "faces 3"]:
    """``(b - a) x (c - a)`` of each face: along its normal, and twice as long as its area [m²]."""
    a, b, c = positions[faces].swapaxes(0, 1)
    return np.cross(b - a, c - a)


def vertex_normals(
    positions: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Unit normals, means of the normals of the faces at a vertex weighted by area; 0 where there is no face."""
    at, columns = faces.ravel(), face_normals(positions, faces).T
    total = np.stack([np.bincount(at, np.repeat(column, 3), len(positions)) for column in columns], axis=-1)
    return unit(total)


def unit(vectors: Float[np.ndarray, "*any 3"]) -> Float[np.ndarray, "*any 3"]:
    """Vectors of length 1 along ``vectors``; 0 where there is no direction."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), np.finfo(np.float32).tiny)
