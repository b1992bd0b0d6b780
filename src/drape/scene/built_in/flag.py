"""A flag in a constant force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drape.geometry.grid import rectangular_grid
from drape.scene.frozen_array import frozen_floats, frozen_indices
from drape.scene.mass import vertex_areas, vertex_masses
from drape.scene.material import Material
from drape.scene.pins import Pins
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State


def flag(
    size: Sequence[float],
    resolution: Sequence[int],
    pattern: str,
    force_per_area: Sequence[float],
    material: Material,
    mass: Mapping[str, float | None],
    gravity: Sequence[float],
    fps: float,
    frames: int,
) -> Scene:
    """A vertical rectangle in the xz plane, ``size`` (along x, height) [m], held along its edge at the lowest x.

    ``force_per_area`` (x, y, z) [N/m²] acts all the time, on every vertex by its share of the area.

    Raises:
        DrapeError: see :func:`rectangular_grid`, :func:`vertex_masses`, :class:`Scene`.
    """
    sides = tuple(frozen_floats(size, (2,), "scene.size").tolist())
    counts = tuple(frozen_indices(resolution, (2,), "scene.resolution").tolist())
    mesh = rectangular_grid(sides, counts, pattern)
    x = mesh.rest_positions.astype(np.float64)[:, [0, 2, 1]]  # a quarter turn about x, as the cloth is flat
    return Scene(
        name="flag",
        mesh=mesh,
        initial=State.at_rest(x),
        material=material,
        mass=vertex_masses(mesh, mass),
        gravity=frozen_floats(gravity, (3,), "scene.gravity"),
        dt=frame_time(fps),
        frames=frames,
        pins=Pins.fixed(np.arange(counts[1]) * counts[0], x),
        external_force=vertex_areas(mesh)[:, None] * frozen_floats(force_per_area, (3,), "scene.force_per_area"),
    )
