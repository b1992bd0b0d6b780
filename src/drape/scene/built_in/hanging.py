"""A square of cloth that hangs by two corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from drape.geometry.grid import square_grid
from drape.scene.frozen_array import frozen_floats
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.pins import Pins
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State


def hanging(
    size: float,
    resolution: int,
    pattern: str,
    start: Literal["horizontal", "vertical"],
    material: Material,
    mass: Mapping[str, float | None],
    gravity: Sequence[float],
    fps: float,
    frames: int,
) -> Scene:
    """A square of side ``size`` [m] with ``resolution``² vertices, its corners 0 and ``resolution - 1`` held.

    ``start``: ``horizontal`` lies in the plane z = 0 and swings down; ``vertical`` hangs flat from its top edge.

    Raises:
        DrapeError: see :func:`square_grid`, :func:`vertex_masses`, :class:`Scene`.
    """
    mesh = square_grid(size, resolution, pattern)
    x = mesh.rest_positions.astype(np.float64)
    if start == "vertical":
        x = x[:, [0, 2, 1]]  # a quarter turn about x, as the cloth is flat
    return Scene(
        name="hanging",
        mesh=mesh,
        initial=State.at_rest(x),
        material=material,
        mass=vertex_masses(mesh, mass),
        gravity=frozen_floats(gravity, (3,), "scene.gravity"),
        dt=frame_time(fps),
        frames=frames,
        pins=Pins.fixed([0, resolution - 1], x),
    )
