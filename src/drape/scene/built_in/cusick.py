"""The drape test of Cusick: a disc of cloth on a smaller pedestal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drape.geometry.disc import disc
from drape.scene.frozen_array import frozen_floats
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.pins import Pins
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State


def cusick(
    radius: float,
    pedestal_radius: float,
    rings: int,
    unevenness: float,
    material: Material,
    mass: Mapping[str, float | None],
    gravity: Sequence[float],
    fps: float,
    frames: int,
) -> Scene:
    """A disc of cloth whose vertices over the pedestal are held, one ring of them exactly on its rim; [m].

    ``unevenness``: amplitude [m] of the waves in the overhang at the start; a perfectly even disc has no reason to
    fold anywhere.

    Raises:
        DrapeError: see :func:`disc`, :func:`vertex_masses`, :class:`Scene`.
    """
    mesh = disc(radius, rings, pedestal_radius)
    x = np.array(mesh.rest_positions)
    distance, angle = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
    held = distance <= pedestal_radius * (1 + 1e-9)
    overhang = np.where(held, 0.0, distance - pedestal_radius) / (radius - pedestal_radius)
    x[:, 2] = unevenness * overhang * np.sin(7 * angle + 0.5 * np.sin(3 * angle))
    return Scene(
        name="cusick",
        mesh=mesh,
        initial=State.at_rest(x),
        material=material,
        mass=vertex_masses(mesh, mass),
        gravity=frozen_floats(gravity, (3,), "scene.gravity"),
        dt=frame_time(fps),
        frames=frames,
        pins=Pins.fixed(np.flatnonzero(held), x),
    )
