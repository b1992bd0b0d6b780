"""The falling test of air drag: the final speed of a level sheet."""

from __future__ import annotations

import numpy as np

from drape.benchmark.sample import GRAVITY, STEP, Sample
from drape.geometry.grid import square_grid
from drape.scene.scene import Scene
from drape.scene.state import State

EDGE = 0.02
"""Of its mesh [m]."""
STEADY = 1e-4
"""Change of the speed in a step, as a share of what free fall would add, at which it is steady."""
STEPS = 4000
"""At most."""


def falling_speed(sample: Sample) -> float:
    """The final speed of a level sheet [m/s]; infinite where no air brakes it.

    Its vertices weigh the same, those of the hem as those inside.
    """
    mesh = square_grid(4 * EDGE, 5, "alternating")
    scene = Scene(
        name="falling sheet", mesh=mesh, initial=State.at_rest(np.asarray(mesh.rest_positions, np.float64)),
        material=sample.material, mass=np.full(mesh.num_vertices, sample.areal_density * EDGE**2),
        gravity=np.array([0.0, 0.0, -GRAVITY]), dt=STEP, frames=STEPS,
    )  # fmt: skip
    simulator, state = sample.solver(scene), scene.initial
    for frame in range(STEPS):
        before, state = state, simulator.step(state, frame).state
        if abs(state.v[:, 2].mean() - before.v[:, 2].mean()) <= STEADY * GRAVITY * STEP:
            return float(-state.v[:, 2].mean())
    return float("inf")
