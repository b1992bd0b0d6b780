"""Weight."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Kernel, Stencils, array


class Gravity(EnergyTerm):
    """``-Σ m g · (x' - x)`` [J]: the change of gravitational energy over the step.

    Relative to the positions at t, so a cloth 10 km from the origin loses no digits; a constant of the step does not
    move the minimum.
    """

    name = "gravity"

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        return step.mesh.sum_vertices(-step.mass * ((x_next - step.x) @ step.gravity))

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        return self(x_next.detach(), step), -step.mass[:, None] * step.gravity

    def kernel(self, step: Step) -> Kernel | None:
        if step.x.device.type != "cpu":
            return None
        start, lift = array(step.x), array(-step.mass[:, None] * step.gravity)
        return lambda x: (np.vdot(lift, x - start), lift)

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """None: the energy is linear."""
        return []
