"""SMPL in numpy: shape blend, pose blend, joints, linear blend skinning [Loper 2015, eqs. 2-10].

The user's own model file, made plain once by ``drape.data.smpl.convert_pickle``, is all that is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from drape.errors import DrapeError

JOINTS = 24
CHUNK = 32
"""Frames at a time: memory stays below 100 MB."""
COMMAND = "python -m drape.data.smpl.convert_pickle"


@dataclass(frozen=True, eq=False)
class SmplModel:
    """One SMPL body; y is up and the body faces +z in its rest pose, as SMPL has it."""

    rest_positions: Float[np.ndarray, "vertices 3"]
    """Mean shape [m]."""
    faces: Int[np.ndarray, "faces 3"]
    shape_directions: Float[np.ndarray, "vertices 3 shapes"]
    """Displacement per unit of each shape parameter [m]."""
    pose_directions: Float[np.ndarray, "vertices 3 207"]
    """Displacement per unit of each entry of R - 1 of joints 1..23 [m]."""
    joint_regressor: Float[np.ndarray, "24 vertices"]
    weights: Float[np.ndarray, "vertices 24"]
    parents: Int[np.ndarray, "24"]

    @classmethod
    def load(cls, path: Path | str) -> SmplModel:
        """Read a converted model.

        Raises:
            DrapeError: no such file, another model (SMPL-H, SMPL-X, STAR), arrays that do not fit each other.
        """
        path = Path(path)
        arrays = _read(path, tuple(cls.__dataclass_fields__))
        joints, vertices = len(arrays["parents"]), len(arrays["rest_positions"])
        if joints != JOINTS:
            raise DrapeError(
                f"{path}: found a body of {joints} joints; expected the {JOINTS} of SMPL; SMPL-H, SMPL-X and others "
                "are not the body of these data sets: convert model_f.pkl or model_m.pkl of SMPL"
            )
        shapes = arrays["shape_directions"].shape[-1]
        expected = {
            "rest_positions": (vertices, 3), "faces": (len(arrays["faces"]), 3), "parents": (JOINTS,),
            "shape_directions": (vertices, 3, shapes), "pose_directions": (vertices, 3, 9 * (JOINTS - 1)),
            "joint_regressor": (JOINTS, vertices), "weights": (vertices, JOINTS),
        }  # fmt: skip
        for name, shape in expected.items():
            if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
                raise DrapeError(
                    f"{path}: {name}: found shape {arrays[name].shape}; expected finite numbers of shape {shape}, as "
                    f"SMPL has {JOINTS} joints; convert the model again: {COMMAND}"
                )
        if not (arrays["parents"] < np.arange(JOINTS)).all():
            raise DrapeError(f"{path}: parents: found {arrays['parents'].tolist()}; expected parents before children")
        return cls(**arrays)

    def posed(
        self,
        poses: Float[np.ndarray, "frames 72"],
        shape: Float[np.ndarray, "shapes"] | Float[np.ndarray, "frames shapes"],
        translation: Float[np.ndarray, "frames 3"],
        root_at_origin: bool = False,
    ) -> Float[np.ndarray, "frames vertices 3"]:
        """Vertices [m] of ``poses`` (axis-angle of each joint, relative to its parent [rad]) and ``shape``.

        ``root_at_origin``: the root joint is moved to the origin before the body is posed, so that it comes to lie at
        ``translation``, as in CLOTH3D; otherwise it keeps its place in the rest pose, as SMPL has it.

        Raises:
            DrapeError: more shape parameters than the model has.
        """
        shape = np.atleast_2d(shape)
        if shape.shape[1] > self.shape_directions.shape[2]:
            raise DrapeError(
                f"shape: found {shape.shape[1]} parameters; expected at most {self.shape_directions.shape[2]}, as the "
                "SMPL model has them"
            )
        shape = np.broadcast_to(shape, (len(poses), shape.shape[1]))
        chunks = [slice(start, start + CHUNK) for start in range(0, len(poses), CHUNK)]
        return np.concatenate([self._posed(poses[c], shape[c], translation[c], root_at_origin) for c in chunks])

    def _posed(
        self, poses: np.ndarray, shape: np.ndarray, translation: np.ndarray, root_at_origin: bool
    ) -> Float[np.ndarray, "frames vertices 3"]:
        frames, vertices = len(poses), len(self.rest_positions)
        directions = self.shape_directions[..., : shape.shape[1]].reshape(vertices * 3, -1)
        shaped = self.rest_positions + (shape @ directions.T).reshape(frames, vertices, 3)
        joints = np.einsum("jv,fvc->fjc", self.joint_regressor, shaped, optimize=True)
        if root_at_origin:
            shaped, joints = shaped - joints[:, :1], joints - joints[:, :1]
        rotations = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(frames, JOINTS, 3, 3)
        bends = (rotations[:, 1:] - np.eye(3)).reshape(frames, -1)
        corrected = shaped + (bends @ self._pose_matrix).reshape(frames, vertices, 3)
        turns, shifts = self._chain(rotations, joints)
        blended = (self.weights @ turns.reshape(frames, JOINTS, 9)).reshape(frames, vertices, 3, 3)
        moved = np.einsum("fvab,fvb->fva", blended, corrected)
        return moved + self.weights @ shifts + translation[:, None]

    @cached_property
    def _pose_matrix(self) -> Float[np.ndarray, "207 coordinates"]:
        return np.ascontiguousarray(self.pose_directions.reshape(-1, 9 * (JOINTS - 1)).T)

    def _chain(self, rotations: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of every joint the map from rest to posed, x' = turn x + shift, down the skeleton."""
        turns, places = rotations.copy(), joints.copy()
        for joint in range(1, JOINTS):
            parent = self.parents[joint]
            bone = joints[:, joint] - joints[:, parent]
            turns[:, joint] = turns[:, parent] @ rotations[:, joint]
            places[:, joint] = places[:, parent] + np.einsum("fab,fb->fa", turns[:, parent], bone)
        return turns, places - np.einsum("fjab,fjb->fja", turns, joints)


def _read(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; make it from your own SMPL model with: {COMMAND} model.pkl {path}")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in names if name in file}
            found = file.files
    except Exception as error:  # cut off, something else, an array of objects
        raise DrapeError(
            f"{path}: cannot be read ({type(error).__name__}: {error}); expected the npz that {COMMAND} makes"
        ) from error
    if len(arrays) < len(names):
        raise DrapeError(
            f"{path}: found {', '.join(found) or 'nothing'}; expected {', '.join(names)}; make it with: {COMMAND}"
        )
    whole = ("faces", "parents")
    return {name: array.astype(np.int64 if name in whole else np.float64) for name, array in arrays.items()}
