"""Carries the turns of one skeleton over to another one, relative to how both hold their limbs at rest."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from drape.figure.pose import FORWARDS
from drape.figure.skeleton import JOINTS, PARENTS, arm_direction

NEXT = {"clavicle": "upper_arm", "upper_arm": "forearm", "forearm": "hand", "thigh": "shin", "shin": "foot"}
"""The bone of a joint leads to this one."""
STRAIGHT_ANGLE = np.deg2rad(60)
"""Collar bones, hands and feet that differ less at rest are held to be the same: the surface is what differs."""
FOLDED_ANGLE = np.deg2rad(100)
"""Limbs that differ more are not at rest at all: then the hinge of the limb tells how it is turned about its axis."""


def rest_alignment(
    own: dict[str, Float[np.ndarray, "3"]],
    other: dict[str, Float[np.ndarray, "3"]],
    hinges: dict[str, Float[np.ndarray, "3"]],
    level: Float[np.ndarray, "3 3"],
) -> dict[str, Float[np.ndarray, "3 3"]]:
    """For each joint the rotation from our frame at rest to that of the other skeleton.

    ``own`` and ``other`` are the directions of the bones at rest, ``hinges`` the axes about which the other's elbows
    and knees bend, in the frame of the bone above at rest; ``level`` turns our trunk into the other's.
    """
    aligned: dict[str, np.ndarray] = {}
    for joint, parent in zip(JOINTS, PARENTS, strict=True):
        part = joint.split("_", 1)[-1]
        above = aligned[JOINTS[parent]] if parent >= 0 else level
        if joint not in other or part == joint:
            aligned[joint] = level if part == joint else above
            continue
        start = above if part == "hand" else level
        angle = _angle(start @ own[joint], other[joint])
        if part in ("clavicle", "hand", "foot") and angle < STRAIGHT_ANGLE:
            aligned[joint] = start
        elif joint in hinges and _angle(above @ own[joint], other[joint]) > FOLDED_ANGLE:
            aligned[joint] = _frame(other[joint], hinges[joint]) @ _frame(own[joint], own_hinge(joint)).T
        else:
            aligned[joint] = shortest_turn(above @ own[joint], other[joint]) @ above
    return aligned


def own_hinge(joint: str) -> Float[np.ndarray, "3"]:
    """Axis about which the limb below a thigh or an upper arm of the figure bends."""
    if joint.endswith("thigh"):
        return np.array([1.0, 0.0, 0.0])
    side = 1.0 if joint.startswith("left") else -1.0
    return np.cross(arm_direction() * [side, 1.0, 1.0], FORWARDS)


def hinge_axis(
    turns: Float[np.ndarray, "frames 3 3"],
    upper: Float[np.ndarray, "frames 3"],
    lower: Float[np.ndarray, "frames 3"],
) -> Float[np.ndarray, "3"] | None:
    """Mean axis about which the lower limb bends, in the frame of the upper; None where it never bends."""
    axes = np.einsum("fba,fb->fa", turns, np.cross(upper, lower))
    mean = axes.mean(axis=0)
    length = np.linalg.norm(mean)
    return mean / length if length > 0.05 * np.linalg.norm(upper[0]) * np.linalg.norm(lower[0]) else None


def shortest_turn(start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation by the smallest angle that takes one direction into the other."""
    axis = np.cross(start, end)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        if start @ end > 0:
            return np.eye(3)
        axis, length = np.cross(start, np.eye(3)[np.argmin(np.abs(start))]), 1.0
        axis = axis / np.linalg.norm(axis)
    return Rotation.from_rotvec(axis / length * _angle(start, end)).as_matrix()


def _frame(along: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """Columns: along the bone, about the hinge (made upright on it), and their cross product."""
    along = along / np.linalg.norm(along)
    hinge = hinge - (hinge @ along) * along
    hinge = hinge / np.linalg.norm(hinge)
    return np.stack([along, hinge, np.cross(along, hinge)], axis=1)


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
