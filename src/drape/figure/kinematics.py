"""Forward kinematics: rotations of the joints to transforms of the bones, and back."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.figure.skeleton import PARENTS


def forward_kinematics(
    joints: Float[np.ndarray, "joints 3"],
    rotations: Float[np.ndarray, "frames joints 3 3"],
    root: Float[np.ndarray, "frames 3"],
) -> Float[np.ndarray, "frames joints 4 4"]:
    """Skinning transforms, rest to posed: each joint turns by its rotation (in its parent's frame, identity at rest).

    ``joints`` are the rest positions [m], ``root`` is the displacement of the pelvis from rest [m].
    """
    turns = np.empty_like(rotations)
    places = np.empty(rotations.shape[:2] + (3,))
    for joint, parent in enumerate(PARENTS):
        if parent < 0:
            turns[:, joint], places[:, joint] = rotations[:, joint], joints[joint] + root
        else:
            turns[:, joint] = turns[:, parent] @ rotations[:, joint]
            places[:, joint] = places[:, parent] + turns[:, parent] @ (joints[joint] - joints[parent])
    transforms = np.zeros(rotations.shape[:2] + (4, 4))
    transforms[..., :3, :3] = turns
    transforms[..., :3, 3] = places - np.einsum("fjab,jb->fja", turns, joints)
    transforms[..., 3, 3] = 1.0
    return transforms


def joint_positions(
    joints: Float[np.ndarray, "joints 3"], transforms: Float[np.ndarray, "frames joints 4 4"]
) -> Float[np.ndarray, "frames joints 3"]:
    """Posed positions of the joints [m]."""
    return np.einsum("fjab,jb->fja", transforms[..., :3, :3], joints) + transforms[..., :3, 3]


def inverse_kinematics(
    joints: Float[np.ndarray, "joints 3"], transforms: Float[np.ndarray, "frames joints 4 4"]
) -> tuple[Float[np.ndarray, "frames joints 3 3"], Float[np.ndarray, "frames 3"]]:
    """The rotations and the displacement of the pelvis [m] that :func:`forward_kinematics` made ``transforms`` from."""
    turns = transforms[..., :3, :3]
    parents = np.array(PARENTS)
    rotations = turns.copy()
    rotations[:, 1:] = np.swapaxes(turns[:, parents[1:]], -1, -2) @ turns[:, 1:]
    return rotations, joint_positions(joints[:1], transforms[:, :1])[:, 0] - joints[0]
