"""The price of leaving free motion, by which a minimum of the incremental potential is a step of implicit Euler."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Kernel, Stencils, array


class Inertia(EnergyTerm):
    """``Σ m |x' - (x + dt v)|² / (2 dt²)`` [J] (paper, eq. 10).

    Evaluated as ``(x' - x) - dt v``: far from the origin ``x + dt v`` would round the motion of the step away.
    """

    name = "inertia"

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        deviation = (x_next - step.x) - step.dt * step.v
        return step.mesh.sum_vertices(0.5 * (step.mass / step.dt**2) * deviation.square().sum(-1))

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        deviation = (x_next.detach() - step.x) - step.dt * step.v
        gradient = (step.mass / step.dt**2)[:, None] * deviation
        return step.mesh.sum_vertices(0.5 * (gradient * deviation).sum(-1)), gradient

    def kernel(self, step: Step) -> Kernel | None:
        if step.x.device.type != "cpu":
            return None
        start, flown, stiffness = array(step.x), array(step.dt * step.v), array(step.mass / step.dt**2)[:, None]

        def evaluated(x: np.ndarray) -> tuple[float, np.ndarray]:
            deviation = (x - start) - flown
            gradient = stiffness * deviation
            return 0.5 * np.vdot(gradient, deviation), gradient

        return evaluated

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """m/dt² on the diagonal: exact."""
        vertices = torch.arange(len(x_next), device=x_next.device)[:, None]
        identity = torch.eye(3, dtype=x_next.dtype, device=x_next.device)
        blocks = (step.mass / step.dt**2)[:, None, None] * identity
        return [Stencils(vertices, blocks[:, None, :, None, :])]
