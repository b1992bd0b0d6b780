"""A strip of cloth clamped at one end, as in the standard test of bending."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drape.errors import DrapeError
from drape.geometry.grid import rectangular_grid
from drape.scene.frozen_array import frozen_floats, frozen_indices
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.pins import Pins
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State


def cantilever(
    size: Sequence[float],
    resolution: Sequence[int],
    clamped_rows: int,
    pattern: str,
    material: Material,
    mass: Mapping[str, float | None],
    gravity: Sequence[float],
    fps: float,
    frames: int,
) -> Scene:
    """A horizontal strip, ``size`` (length along x, width) [m], that bends under its weight.

    The first ``clamped_rows`` rows of vertices across the strip are held: two rows hold its direction, too, one is a
    hinge.

    Raises:
        DrapeError: no free row; see also :func:`rectangular_grid`, :func:`vertex_masses`, :class:`Scene`.
    """
    sides = tuple(frozen_floats(size, (2,), "scene.size").tolist())
    counts = tuple(frozen_indices(resolution, (2,), "scene.resolution").tolist())
    if not 1 <= clamped_rows < counts[0]:
        raise DrapeError(
            f"scene.clamped_rows: found {clamped_rows} of {counts[0]} rows; expected 1..{counts[0] - 1}"
        )
    mesh = rectangular_grid(sides, counts, pattern)
    clamped = np.flatnonzero(np.arange(mesh.num_vertices) % counts[0] < clamped_rows)
    return Scene(
        name="cantilever",
        mesh=mesh,
        initial=State.at_rest(mesh.rest_positions),
        material=material,
        mass=vertex_masses(mesh, mass),
        gravity=frozen_floats(gravity, (3,), "scene.gravity"),
        dt=frame_time(fps),
        frames=frames,
        pins=Pins.fixed(clamped, mesh.rest_positions),
    )
