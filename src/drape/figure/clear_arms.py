"""Arms that keep away from the trunk, so that there is room for cloth between them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from drape.figure.figure import Figure
from drape.figure.kinematics import forward_kinematics, inverse_kinematics
from drape.figure.skeleton import JOINTS
from drape.figure.skinning import pose_vertices

ROOM = 0.04
"""Distance between an arm and the rest of the body [m]: a sleeve and two sides of a garment fit in."""
ARMPIT = 0.08
"""Vertices of an arm that are nearer to the rest of the body at rest are its armpit [m]."""
ANGLES = np.radians(np.arange(0.0, 61.0, 4.0))
"""Angles by which an arm may be raised to the side, in addition to its motion [rad]."""
BEFORE, SMOOTHING = 0.3, 0.1
"""An arm is raised this much before it has to be, and as smoothly [s]."""


def clear_arms(
    transforms: Float[np.ndarray, "frames joints 4 4"], figure: Figure, fps: float, room: float = ROOM
) -> Float[np.ndarray, "frames joints 4 4"]:
    """The same motion with each arm raised to the side, at the shoulder, as far as ``room`` [m] needs."""
    rotations, root = inverse_kinematics(figure.joints, transforms)
    arms = {side: _vertices_of_arm(figure, side) for side in ("left", "right")}
    rest_of_body = ~_belongs(figure, ("clavicle", "upper_arm", "forearm", "hand"))
    posed = pose_vertices(*_carried(figure, rest_of_body), transforms)
    trees = [cKDTree(frame) for frame in posed]
    for side, arm in arms.items():
        shoulder = JOINTS.index(f"{side}_upper_arm")
        raising = Rotation.from_rotvec(np.outer(ANGLES, [0.0, -1.0 if side == "left" else 1.0, 0.0])).as_matrix()
        gaps = np.empty((len(ANGLES), len(transforms)))
        for number, raised in enumerate(raising):
            tried = rotations.copy()
            tried[:, shoulder] = raised @ rotations[:, shoulder]
            points = pose_vertices(*_carried(figure, arm), forward_kinematics(figure.joints, tried, root))
            gaps[number] = [tree.query(frame)[0].min() for tree, frame in zip(trees, points, strict=True)]
        angles = _smoothed(_least_angles(gaps, room), fps)
        turns = Rotation.from_rotvec(np.outer(angles, [0.0, -1.0 if side == "left" else 1.0, 0.0])).as_matrix()
        rotations[:, shoulder] = turns @ rotations[:, shoulder]
    return forward_kinematics(figure.joints, rotations, root)


def _least_angles(gaps: Float[np.ndarray, "angles frames"], room: float) -> Float[np.ndarray, " frames"]:
    """The smallest angle with enough room; where there is none, the one with most."""
    enough = gaps >= room
    return ANGLES[np.where(enough.any(axis=0), enough.argmax(axis=0), gaps.argmax(axis=0))]


def _smoothed(angles: Float[np.ndarray, " frames"], fps: float) -> Float[np.ndarray, " frames"]:
    """Smooth in time, and not below ``angles`` where these last."""
    widest = maximum_filter1d(angles, 2 * round(BEFORE * fps) + 1, mode="nearest")
    return gaussian_filter1d(widest, SMOOTHING * fps, mode="nearest")


def _belongs(figure: Figure, parts: tuple[str, ...]) -> Bool[np.ndarray, " vertices"]:
    """Whether the bone that moves a vertex most ends in one of these names."""
    strongest = figure.bones[np.arange(len(figure.bones)), figure.weights.argmax(axis=1)]
    return np.array([name.endswith(parts) for name in JOINTS])[strongest]


def _vertices_of_arm(figure: Figure, side: str) -> Bool[np.ndarray, " vertices"]:
    trunk = cKDTree(figure.rest_positions[~_belongs(figure, ("clavicle", "upper_arm", "forearm", "hand"))])
    far = trunk.query(figure.rest_positions)[0] > ARMPIT
    return far & _belongs(figure, tuple(f"{side}_{part}" for part in ("upper_arm", "forearm", "hand")))


def _carried(figure: Figure, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return figure.rest_positions[chosen], figure.bones[chosen], figure.weights[chosen]
