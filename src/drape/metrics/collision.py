"""Vertices of a garment inside the body: as the paper counts them, and by a signed distance."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from drape.geometry.normals import vertex_normals

REACH = 0.5
"""A vertex farther than this from the nearest vertex of the body does not collide [m].

Source: docs/sources.md, Scores of garments.
"""


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
