"""Energies of every cloth: inertia, weight and a given force; no fabric and no body."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Kernel, Stencils, array
from drape.errors import DrapeError


class Inertia(EnergyTerm):
    """``Σ m |x' - (x + dt v)|² / (2 dt²)`` [J] (paper, eq. 10).

    Evaluated as ``(x' - x) - dt v``: far from the origin ``x + dt v`` would round the motion of the step away.
    """

    name = "inertia"
    stores = False

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


class Gravity(EnergyTerm):
    """``-Σ m g · (x' - x)`` [J]: the change of potential energy over the step.

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


class ExternalForce(EnergyTerm):
    """``-Σ f · (x' - x)`` [J], relative to the positions at t as in :class:`drape.energy.terms.free_motion.Gravity`.

    Raises:
        DrapeError: a step without external force (when evaluated).
    """

    name = "external"

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        return step.mesh.sum_vertices(-(_force(step) * (x_next - step.x)).sum(-1))

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        return self(x_next.detach(), step), -_force(step)

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """None: the energy is linear."""
        return []


def _force(step: Step) -> Float[Tensor, "vertices 3"]:
    if step.external_force is None:
        raise DrapeError("energy term external: the step has no external force; add the term only to scenes with one")
    return step.external_force
