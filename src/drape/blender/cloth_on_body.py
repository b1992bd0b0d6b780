"""Blender's cloth on the moving body of a scene, in a process of its own. Does not import bpy."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np
from jaxtyping import Float

from drape.blender.comparable import refuse_incomparable
from drape.blender.presets import blender_version
from drape.blender.process import BlenderProcess
from drape.scene.obstacle import Obstacle
from drape.scene.scene import Scene


class ClothOnBody:
    """Simulates scenes as Blender does, with ``settings`` of a fabric and the masses of the scene; to be closed.

    ``contact`` is that of conf/data/garments.yaml, without the friction, which a scene has itself.

    Raises:
        DrapeError: Blender is missing.
    """

    def __init__(self, settings: Mapping[str, float | int | str], contact: Mapping[str, float | int]):
        blender_version()
        self._settings, self._contact = dict(settings), dict(contact)
        self._folder = tempfile.TemporaryDirectory()
        log = Path(self._folder.name) / "blender.log"
        self._process = BlenderProcess("drape.blender.cloth_on_body_worker", [], log)
        self.seconds: list[float] = []
        """Time that Blender took for each frame of the last scene but frame 0."""

    def __call__(self, scene: Scene) -> Float[np.ndarray, "frames vertices 3"]:
        """Positions [m] of the cloth in frames 0 to ``scene.frames``.

        Raises:
            DrapeError: a scene that Blender would not do the same, or its process died.
        """
        check_comparable(scene)
        arguments, positions = (Path(self._folder.name) / name for name in ("scene.npz", "positions.npy"))
        obstacle = cast(Obstacle, scene.obstacle)  # others were refused
        frames = range(scene.frames + 1)
        pinned = np.zeros(0, np.int64) if scene.pins is None else scene.pins.vertices
        led = [np.zeros((0, 3)) if scene.pins is None else scene.pins.at(frame) for frame in frames]
        np.savez(
            arguments,
            rest_positions=scene.mesh.rest_positions,
            faces=scene.mesh.faces,
            pinned=pinned,
            pin_positions=np.stack(led),
            body_faces=obstacle.faces,
            body_positions=np.stack([obstacle.at(frame) for frame in frames]),
            start=scene.initial.x,
            settings=json.dumps(self._settings | {"mass": float(scene.mass[0])}),
            contact=json.dumps(self._contact | {"friction": float(scene.friction or 0.0)}),
            gravity=scene.gravity,
            fps=1.0 / scene.dt,
        )
        self._process.send([str(arguments), str(positions)])
        self.seconds = self._process.receive("Blender's cloth")
        return np.load(positions).astype(np.float64)

    def close(self) -> None:
        """End the process and remove its files."""
        self._process.stop()
        self._process.join()
        self._folder.cleanup()


def check_comparable(scene: Scene) -> None:
    """Refuse a scene that Blender's cloth on a body would not do the same.

    Raises:
        DrapeError: what is in it.
    """
    refuse_incomparable(
        scene,
        ("no body", scene.obstacle is None),
        expected="a cloth of equal masses that starts at rest on a body, to compare it with Blender's; change the "
        "scene",
    )
