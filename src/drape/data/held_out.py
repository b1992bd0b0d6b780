"""A sequence of a data file as a scene: a simulator starts from two recorded frames and goes on by itself."""

from __future__ import annotations

import numpy as np

from drape.data.trajectories import Trajectories, open_trajectories
from drape.errors import DrapeError
from drape.scene.material import Material
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State

START = 1
"""The recorded frame at which the scene begins: the first with a velocity."""


def held_out(path: str, fabric: str, sequence: int, frames: int) -> Scene:
    """Test sequence number ``sequence`` (0, 1, ...) of ``fabric``: mesh, pins, masses and gravity as recorded.

    The scene begins at the recorded frame 1 with ``v = (x¹ - x⁰) / dt``; its frame k is the recorded frame k + 1, and
    the recorded frames are its ``reference``.

    Raises:
        DrapeError: no such file, fabric or sequence, or fewer recorded frames than asked for.
    """
    file = open_trajectories(path)
    index = _index(file, fabric, sequence)
    piece, recorded_frames = file.piece(index), file.frames_of(index)
    if not 1 <= frames <= recorded_frames - START - 1:
        raise DrapeError(
            f"{path}: scene.frames: found {frames}; expected 1..{recorded_frames - START - 1}, as this sequence has "
            f"{recorded_frames} frames and the scene begins at frame {START}"
        )
    recorded = file.positions(index, 0, START + frames + 1).astype(np.float64)
    first, second = recorded[: START + 1]
    material = Material.from_settings(fabric, file.materials[fabric])
    return Scene(
        name=f"held_out_{fabric}_{sequence}",
        mesh=piece.mesh,
        initial=State(second, (second - first) / file.dt),
        material=material,
        mass=piece.mass,
        gravity=file.gravity,
        dt=file.dt,
        frames=frames,
        pins=Pins.fixed(piece.pinned, second) if len(piece.pinned) else None,
        reference=recorded[START:],
    )


def _index(file: Trajectories, fabric: str, sequence: int) -> int:
    if fabric not in file.fabrics:
        raise DrapeError(f"{file.path}: found no fabric {fabric!r}; expected one of {', '.join(file.fabrics)}")
    test = file.split("test")
    of_fabric = test[file.fabric[test] == file.fabrics.index(fabric)]
    if not 0 <= sequence < len(of_fabric):
        raise DrapeError(
            f"{file.path}: scene.sequence: found {sequence}; expected 0..{len(of_fabric) - 1}, as the test split has "
            f"{len(of_fabric)} sequences of {fabric}"
        )
    return int(of_fabric[sequence])
