"""From the rest pose into a motion."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from drape.figure.figure import Figure
from drape.figure.kinematics import forward_kinematics, inverse_kinematics
from drape.figure.skeleton import JOINTS

EASED = 18 / 30
"""Part of the settling that moves; in the rest of it the first pose is held."""


def ease_in(
    transforms: Float[np.ndarray, "frames joints 4 4"], figure: Figure, settle: int
) -> Float[np.ndarray, "all_frames joints 4 4"]:
    """``settle`` frames before a motion: from the rest pose to its first pose, which is then held.

    Every joint turns about one axis, with the smooth step u²(3 − 2u) of time; frame 0 is the rest pose.
    """
    rotations, root = inverse_kinematics(figure.joints, transforms[:1])
    vectors = Rotation.from_matrix(rotations[0]).as_rotvec()
    u = np.minimum(np.arange(settle) / max(round(EASED * settle), 1), 1.0)
    u = u**2 * (3.0 - 2.0 * u)
    turns = Rotation.from_rotvec((u[:, None, None] * vectors).reshape(-1, 3)).as_matrix()
    eased = forward_kinematics(figure.joints, turns.reshape(settle, len(JOINTS), 3, 3), u[:, None] * root)
    return np.concatenate([eased, transforms])
