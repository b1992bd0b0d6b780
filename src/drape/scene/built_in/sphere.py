"""A square of cloth that falls on a moving sphere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import trimesh

from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.scene.frozen_array import frozen_floats
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.obstacle import Obstacle
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State


def sphere(
    size: float,
    resolution: int,
    pattern: str,
    radius: float,
    subdivisions: int,
    gap: float,
    sway: Sequence[float],
    period: float,
    friction: float | None,
    material: Material,
    mass: Mapping[str, float | None],
    gravity: Sequence[float],
    fps: float,
    frames: int,
) -> Scene:
    """A square of side ``size`` [m], horizontal, ``gap`` above an icosphere of ``radius`` [m]; nothing is pinned.

    The sphere starts at rest and moves to and fro by ``sway`` (x, y, z) [m] within ``period`` [s]:
    ``centre(t) = ½ (1 - cos(2π t / period)) sway``. The cloth lies at z = 0.

    Raises:
        DrapeError: a radius or period that is not positive; see also :func:`square_grid`, :func:`vertex_masses`,
            :class:`Scene`.
    """
    if not (radius > 0 and period > 0 and math.isfinite(gap) and 0 <= subdivisions <= 6):
        raise DrapeError(
            f"scene: radius {radius}, period {period}, gap {gap}, subdivisions {subdivisions}; expected radius > 0 m, "
            "period > 0 s, a gap in metres and 0 to 6 subdivisions of the sphere"
        )
    mesh = square_grid(size, resolution, pattern)
    ball = trimesh.creation.icosphere(subdivisions, radius)
    dt = frame_time(fps)
    share = 0.5 * (1.0 - np.cos(2 * np.pi * dt * np.arange(frames + 1) / period))
    centre = [0.0, 0.0, -radius - gap] + share[:, None] * frozen_floats(sway, (3,), "scene.sway")
    return Scene(
        name="sphere",
        mesh=mesh,
        initial=State.at_rest(mesh.rest_positions),
        material=material,
        mass=vertex_masses(mesh, mass),
        gravity=frozen_floats(gravity, (3,), "scene.gravity"),
        dt=dt,
        frames=frames,
        obstacle=Obstacle(ball.faces, ball.vertices + centre[:, None]),
        friction=friction,
    )
