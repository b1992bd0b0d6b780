"""Drift of energy and momentum of a motion from those of a recorded one."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.data.motion import external_energy_per_mass

Frames = Float[np.ndarray, "frames vertices 3"]


def energy_drift(x: Frames, reference: Frames, dt: float, gravity: Float[np.ndarray, " 3"]) -> np.ndarray:
    """``|e - e_recorded|`` of the kinetic and gravitational energy per mass [J/kg], from the second frame on.

    The body works on the garment, so its energy is not conserved: what it should be is what was recorded.
    """
    simulated, recorded = (external_energy_per_mass(frames, dt, gravity) for frames in (x, reference))
    return np.abs(simulated - recorded)


def momentum_drift(x: Frames, reference: Frames, dt: float) -> np.ndarray:
    """``|p - p_recorded| / m``: how far apart the velocities of the centres of mass are [m/s], from the second frame.

    All vertices weigh the same, as in Blender.
    """
    return np.linalg.norm(np.diff((x - reference).mean(axis=1), axis=0), axis=-1) / dt
