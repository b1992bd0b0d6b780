"""A piece of a fabric in the laboratory: its law, its weight, and a solver that lets it come to rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from drape.energy.fabric import Fabric
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.simulator import Simulator

GRAVITY = 9.81
"""[m/s²]"""
STEP = 0.25
"""Time step on the way to rest, a long one: it damps, and rest does not depend on it [s]."""
STEPS = 400
"""On the way to rest, at most."""
STILL = 1e-5
"""Mean motion of a vertex in a step at which cloth is at rest, as a share of its size."""


@dataclass(frozen=True)
class Sample:
    """A specimen of cloth that instruments test."""

    material: Material
    areal_density: float
    """[kg/m²]"""
    law: Fabric
    solver: Callable[[Scene], Simulator]
    """Solves scenes made of it."""

    def scene(
        self,
        name: str,
        mesh: ClothMesh,
        x: Float[np.ndarray, "vertices 3"],
        *,
        pins: Pins | None = None,
        gravity: float = GRAVITY,
    ) -> Scene:
        """A mesh of it that is at ``x`` [m], in frames of a thirtieth of a second."""
        return Scene(
            name=name,
            mesh=mesh,
            initial=State.at_rest(x),
            material=self.material,
            mass=vertex_masses(mesh, {"areal_density": self.areal_density}),
            gravity=np.array([0.0, 0.0, -gravity]),
            dt=1 / 30,
            frames=1,
            pins=pins,
        )

    def at_rest(self, scene: Scene) -> State:
        """The cloth of a scene at rest, as it lies or hangs in the end.

        Raises:
            DrapeError: it does not within ``STEPS`` steps.
        """
        slow = replace(scene, dt=STEP, frames=STEPS)
        simulator, state = self.solver(slow), slow.initial
        size = float(np.ptp(scene.mesh.rest_positions, axis=0).max())
        for frame in range(STEPS):
            before, state = state, simulator.step(state, frame).state
            if np.linalg.norm(state.x - before.x, axis=1).mean() <= STILL * size:
                return state
        raise DrapeError(
            f"fabric card: {scene.name} of {self.material.name}: found it still moving after {STEPS} steps of "
            f"{STEP:g} s; expected it at rest; raise simulator.iterations"
        )
