"""Animate a scene from Python, without files."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.energy.fabric import Fabric
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.terms.contact import Contact
from drape.scene.scene import Scene
from drape.simulators.rollout import first_frame
from drape.simulators.solver.implicit import ImplicitSolver


def animate(
    scene: Scene, fabric: Fabric, contact: Contact | None = None, iterations: int = 300, steps: int = 1
) -> Float[np.ndarray, "frames vertices 3"]:
    """Positions of the cloth of a scene in all frames [m], the initial one first, by implicit Euler steps.

    Args:
        scene: what is simulated.
        fabric: the energies of its cloth.
        contact: between cloth and body; None for the usual one.
        iterations: the most evaluations of the incremental potential for a time step.
        steps: equal time steps in each frame.

    Raises:
        DrapeError: a value that makes no sense, or a garment deep inside its body at the start.
    """
    potential = IncrementalPotential.for_scene(scene, fabric.terms, contact)
    solver = ImplicitSolver(potential, scene, fabric.attributes, iterations=iterations, steps=steps)
    states = [first_frame(scene, solver.barrier)]
    for frame in range(scene.frames):
        states.append(solver.step(states[-1], frame).state)
    return np.stack([state.x for state in states])
