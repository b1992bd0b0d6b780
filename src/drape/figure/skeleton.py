"""Nineteen joints of a body and where they are at rest: arms 35 degrees below the horizontal, legs slightly apart."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.figure.shape import FigureShape

_LIMBS = ("clavicle", "upper_arm", "forearm", "hand"), ("thigh", "shin", "foot")
JOINTS: tuple[str, ...] = (
    "pelvis", "spine", "chest", "throat", "skull",
    *(f"left_{part}" for part in _LIMBS[0]), *(f"right_{part}" for part in _LIMBS[0]),
    *(f"left_{part}" for part in _LIMBS[1]), *(f"right_{part}" for part in _LIMBS[1]),
)  # fmt: skip
"""A joint is called like the bone that begins there; parents stand before their children."""
PARENTS: tuple[int, ...] = (-1, 0, 1, 2, 3, 2, 5, 6, 7, 2, 9, 10, 11, 0, 13, 14, 0, 16, 17)

REFERENCE_HEIGHT = 1.75
"""The height [m] in which the proportions below are given; a body is this one, scaled."""
ARM_DROP = np.deg2rad(35.0)
"""Angle of the arms at rest below the horizontal."""
UPPER_ARM, FOREARM, HAND = 0.290, 0.255, 0.185
"""Lengths at the reference height [m], as the lengths of the legs below."""
THIGH, SHIN = 0.43, 0.40


def arm_direction() -> Float[np.ndarray, "3"]:
    """Unit vector along the left arm at rest, shoulder to wrist."""
    return np.array([np.cos(ARM_DROP), 0.0, -np.sin(ARM_DROP)])


def breadth(shape: FigureShape, part: float) -> float:
    """Factor of the distances of limbs from the middle: they move out less than the trunk thickens."""
    return part * (0.55 + 0.45 * shape.girth)


def reference_skeleton(
    shape: FigureShape,
) -> tuple[Float[np.ndarray, "joints 3"], Float[np.ndarray, "joints 3"]]:
    """Joints and ends of the bones of a body of :data:`REFERENCE_HEIGHT` [m]: z up, facing -y, its left is +x.

    Proportions after Drillis and Contini (1966).
    """
    arm, hip = arm_direction(), 0.092 * breadth(shape, shape.hip)
    shoulder = np.array([0.170 * breadth(shape, shape.shoulder), 0.014, 1.398])
    elbow = shoulder + UPPER_ARM * arm
    wrist = elbow + FOREARM * arm
    knee, ankle = np.array([hip + 0.036, -0.006, 0.485]), np.array([hip + 0.064, 0.018, 0.080])
    starts = [
        [0, 0.0, 0.95], [0, 0.008, 1.06], [0, 0.012, 1.20], [0, 0.022, 1.475], [0, 0.012, 1.555],
        [0.03, 0.014, 1.41], shoulder, elbow, wrist, [hip, 0.0, 0.905], knee, ankle,
    ]  # fmt: skip
    ends = [
        [0, 0.008, 1.06], [0, 0.012, 1.20], [0, 0.016, 1.36], [0, 0.012, 1.555], [0, -0.005, 1.69],
        shoulder, elbow, wrist, wrist + 0.9 * HAND * arm, knee, ankle, [hip + 0.082, -0.14, 0.03],
    ]  # fmt: skip
    return _both_sides(starts), _both_sides(ends)


def rest_joints(shape: FigureShape) -> Float[np.ndarray, "joints 3"]:
    """Rest positions of the joints [m]."""
    return reference_skeleton(shape)[0] * (shape.height / REFERENCE_HEIGHT)


def _both_sides(left: list) -> Float[np.ndarray, "joints 3"]:
    middle, arm, leg = np.array(left[:5], float), np.array(left[5:9], float), np.array(left[9:], float)
    mirror = np.array([-1.0, 1.0, 1.0])
    return np.concatenate([middle, arm, arm * mirror, leg, leg * mirror])


def bone_directions(shape: FigureShape) -> dict[str, Float[np.ndarray, "3"]]:
    """Unit vectors along the bones at rest."""
    starts, ends = reference_skeleton(shape)
    along = (ends - starts) / np.linalg.norm(ends - starts, axis=1, keepdims=True)
    return dict(zip(JOINTS, along, strict=True))
