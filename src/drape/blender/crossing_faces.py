"""Faces of a mesh that pass through others of it. Imports bpy: for processes of its own."""

from __future__ import annotations

import bpy  # noqa: F401  mathutils comes with it
import numpy as np
from jaxtyping import Bool, Float, Int
from mathutils.bvhtree import BVHTree


def crossing_faces(
    positions: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Bool[np.ndarray, " faces"]:
    """Whether each face intersects another one that shares no vertex with it."""
    tree = BVHTree.FromPolygons(positions.tolist(), faces.tolist(), all_triangles=True, epsilon=0.0)
    pairs = np.array(tree.overlap(tree), np.int64).reshape(-1, 2)
    shared = (faces[pairs[:, 0], :, None] == faces[pairs[:, 1], None, :]).any(axis=(1, 2))
    crossing = np.zeros(len(faces), bool)
    crossing[pairs[~shared].reshape(-1)] = True
    return crossing
