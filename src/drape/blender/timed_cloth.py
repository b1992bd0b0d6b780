"""Blender's own cloth on a scene, frame by frame and timed, in a process of its own. Does not import bpy."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.blender.comparable import refuse_incomparable
from drape.blender.presets import blender_version
from drape.blender.process import BlenderProcess
from drape.scene.scene import Scene


class TimedCloth:
    """The cloth of ``scene`` as Blender simulates it, with ``settings`` and the masses of the scene; to be closed.

    Raises:
        DrapeError: Blender is missing; or a scene that its cloth cannot do the same: a body, an external force, pins
            that move, vertices of different masses, a start in motion.
    """

    def __init__(self, scene: Scene, settings: Mapping[str, float | int | str]):
        blender_version()
        check_comparable(scene)
        self._folder = tempfile.TemporaryDirectory()
        self._positions = Path(self._folder.name) / "positions.npy"
        arguments = Path(self._folder.name) / "cloth.npz"
        np.savez(
            arguments,
            rest_positions=scene.mesh.rest_positions,
            faces=scene.mesh.faces,
            pinned=np.zeros(0, np.int64) if scene.pins is None else scene.pins.vertices,
            settings=json.dumps({**settings, "mass": float(scene.mass[0])}),
            start=scene.initial.x,
            acceleration=np.tile(scene.gravity, (scene.frames, 1)),
            fps=1.0 / scene.dt,
        )
        log = Path(self._folder.name) / "blender.log"
        self._process = BlenderProcess("drape.blender.cloth_timer", [str(arguments)], log)

    def step(self) -> tuple[Float[np.ndarray, "vertices 3"], float]:
        """Positions [m] of the next frame, and the time that Blender took for it [s].

        Raises:
            DrapeError: Blender's process died, or there are no more frames.
        """
        self._process.send(str(self._positions))
        seconds = self._process.receive("Blender's cloth")
        return np.load(self._positions).astype(np.float64), seconds

    def close(self) -> None:
        """End the process and remove its files."""
        self._process.stop()
        self._process.join()
        self._folder.cleanup()


def check_comparable(scene: Scene) -> None:
    """Refuse a scene that Blender's cloth would not do the same.

    Raises:
        DrapeError: what is in it.
    """
    refuse_incomparable(
        scene,
        ("a body", scene.obstacle is not None),
        ("pins that move", scene.pins is not None and not scene.pins.is_static),
        expected="a cloth of equal masses that starts at rest and hangs under gravity, to compare it with Blender's; "
        "use scene=hanging with scene.mass.per_vertex",
    )
