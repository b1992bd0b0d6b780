"""Points that move with the surface of a body."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from drape.errors import DrapeError
from drape.geometry.normals import face_normals, unit
from drape.scene.obstacle import Obstacle


def follow(obstacle: Obstacle, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "frames points 3"]:
    """Positions of ``points`` [m] that are fixed to the body's nearest face (by its centre) as they are in frame 0.

    In the frame of the face (origin at a corner, axes along a side, the normal, and across both) their coordinates
    stay the same, so that a rigid motion of the body carries them rigidly.

    Raises:
        DrapeError: all faces of the body are degenerate.
    """
    first = obstacle.positions[0][obstacle.faces]
    area = np.linalg.norm(face_normals(obstacle.positions[0], obstacle.faces), axis=-1)
    sound = np.flatnonzero(area > 1e-12 * np.square(first[:, 1] - first[:, 0]).sum(-1).max())
    if len(sound) == 0:
        raise DrapeError("body: found only faces without area; pinned vertices cannot follow it")
    nearest = sound[cKDTree(first[sound].mean(axis=1)).query(points)[1]]
    corners = obstacle.positions[:, obstacle.faces[nearest]]  # frames, points, corners, 3
    axes = _axes(corners)
    local = np.einsum("pij,pj->pi", axes[0], points - corners[0, :, 0])
    return corners[:, :, 0] + np.einsum("fpij,pi->fpj", axes, local)


def _axes(corners: Float[np.ndarray, "frames points 3 3"]) -> Float[np.ndarray, "frames points 3 3"]:
    """Three orthonormal rows for each triangle."""
    side = unit(corners[:, :, 1] - corners[:, :, 0])
    normal = unit(np.cross(side, corners[:, :, 2] - corners[:, :, 0]))
    return np.stack([side, normal, np.cross(side, normal)], axis=-2)
