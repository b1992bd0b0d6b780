"""No penetration at the start: vertices and faces at a distance from the body."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from drape.garment.figure_like import Body

CLEARANCE = 0.0065
"""Distance of every vertex from the body [m]."""
FACE_CLEARANCE = 0.005
"""Distance of every face's centre [m]: more than the body's and the cloth's collision distance needs at the start."""
ROUNDS = 10
STEP = 1e-3
"""Step of the central differences of the distance [m]."""


def outward(body: Body, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
    """Unit gradient of the distance to the body."""
    steps = STEP * np.concatenate([np.eye(3), -np.eye(3)])
    values = body.signed_distance((points + steps[:, None]).reshape(-1, 3)).reshape(6, -1)
    gradient = (values[:3] - values[3:]).T
    return gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)


def push_out(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], body: Body
) -> Float[np.ndarray, "vertices 3"]:
    """Vertices moved along the gradient until they, and the centres of their faces, are clear of the body."""
    vertices = vertices.copy()
    for _ in range(ROUNDS):
        short = np.maximum(CLEARANCE - body.signed_distance(vertices), 0.0)
        of_faces = np.maximum(FACE_CLEARANCE - body.signed_distance(vertices[faces].mean(1)), 0.0)
        np.maximum.at(short, faces.reshape(-1), np.repeat(of_faces, 3))
        moved = np.flatnonzero(short > 0.0)
        if len(moved) == 0:
            break
        vertices[moved] += (short[moved, None] + 1e-4) * outward(body, vertices[moved])
    return vertices
