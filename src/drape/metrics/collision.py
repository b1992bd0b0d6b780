"""Vertices of a garment inside the body: as the paper counts them, and by a signed distance."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

REACH = 0.5
"""A vertex farther than this from the nearest vertex of the body does not collide [m].

Source: docs/sources.md, Scores of garments.
"""


def vertex_normals(
    positions: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Unit normals, means of the normals of the faces at a vertex weighted by area; 0 where there is no face."""
    corners = positions[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    at, count = faces.reshape(-1), len(positions)
    total = np.stack([np.bincount(at, np.repeat(normal[:, axis], 3), minlength=count) for axis in range(3)], axis=-1)
    return total / np.maximum(np.linalg.norm(total, axis=-1, keepdims=True), np.finfo(np.float64).tiny)


def behind_nearest_vertex(
    x: Float[np.ndarray, "vertices 3"],
    body: Float[np.ndarray, "body_vertices 3"],
    faces: Int[np.ndarray, "body_faces 3"],
    reach: float = REACH,
) -> Bool[np.ndarray, " vertices"]:
    """The paper's collisions: ``(x - b)·n < 0`` and ``|x - b| ≤ reach`` for the nearest vertex b of the body, normal n.

    Positions of garment and body are those of the same time. A vertex outside of a body with few faces may count, as
    may one near a narrow fold of it: :func:`drape.contact.penetration.Penetration` is exact.
    """
    distance, nearest = cKDTree(body).query(x)
    height = np.einsum("vi,vi->v", x - body[nearest], vertex_normals(body, faces)[nearest])
    return (height < 0) & (distance <= reach)
