"""A force on each vertex that is constant over the step."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.errors import DrapeError


class ExternalForce(EnergyTerm):
    """``-Σ f · (x' - x)`` [J], relative to the positions at t as in :class:`drape.energy.terms.gravity.Gravity`.

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
