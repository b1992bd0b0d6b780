"""The body of a sequence of CLOTH3D: SMPL, posed from info.mat, or a mesh sequence that the user brings instead."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from drape.data.cloth3d.info_mat import GENDERS, SequenceInfo
from drape.data.smpl.body_model import SmplModel
from drape.errors import DrapeError
from drape.scene.obstacle_file import read_obstacle

REST_POSE = np.zeros(72)
REST_POSE[0] = np.pi / 2  # SMPL's y becomes z: the body stands
REST_POSE[5], REST_POSE[8] = 0.15, -0.15  # the hips (joints 1 and 2) open the legs about SMPL's z
"""The pose around which the rest meshes of the garments lie (axis-angle [rad])."""
KINDS = (".npz", ".h5")


class PosedBody(NamedTuple):
    """A body at the frames of a sequence."""

    faces: Int[np.ndarray, "faces 3"]
    rest_positions: Float[np.ndarray, "vertices 3"]
    """[m], z up, root joint at the origin"""
    positions: Float[np.ndarray, "frames vertices 3"]
    """[m], in the world"""
    model: str


class Bodies(ABC):
    """Source of bodies."""

    @abstractmethod
    def body(self, name: str, info: SequenceInfo, start: int, stop: int) -> PosedBody:
        """The body of sequence ``name`` at frames ``start`` to ``stop`` (exclusive)."""


class SmplBodies(Bodies):
    """SMPL, female and male, from the user's own models; each is read when the first sequence needs it."""

    def __init__(self, paths: Mapping[str, str]) -> None:
        if set(paths) != set(GENDERS):
            raise DrapeError(f"data.smpl: found {', '.join(paths) or 'nothing'}; expected a path for {GENDERS}")
        self._paths = paths
        self._model = cache(lambda gender: SmplModel.load(self._paths[gender]))

    def body(self, name: str, info: SequenceInfo, start: int, stop: int) -> PosedBody:
        """The root joint is moved to the origin, then to ``info.trans`` (CLOTH3D's way).

        Raises:
            DrapeError: no model of this gender, or one of another kind.
        """
        model = self._model(info.gender)
        rest = model.posed(REST_POSE[None], info.shape, np.zeros((1, 3)), root_at_origin=True)[0]
        moved = model.posed(info.poses[start:stop], info.shape, info.trans[start:stop], root_at_origin=True)
        return PosedBody(model.faces, rest, moved, "smpl")


class MeshBodies(Bodies):
    """A folder with ``<sequence>.npz`` (or .h5): faces, positions [m] in the world from frame 0 on, fps."""

    def __init__(self, folder: Path, dt: float) -> None:
        self._folder = folder
        self._dt = dt

    def body(self, name: str, info: SequenceInfo, start: int, stop: int) -> PosedBody:
        """The mesh at the times of the frames; its first frame stands in for the rest pose.

        Raises:
            DrapeError: no file for this sequence, or no body in it.
        """
        paths = [path for kind in KINDS if (path := self._folder / f"{name}{kind}").is_file()]
        if not paths:
            raise DrapeError(
                f"{self._folder / name}.npz: no such file; expected the body of the sequence: faces, positions, fps"
            )
        body = read_obstacle(paths[0], self._dt, stop - 1)
        frames = [body.at(frame) for frame in range(start, stop)]
        return PosedBody(body.faces, body.at(0) - info.trans[0], np.stack(frames), paths[0].name)
