"""Loss on the Newton step that a solver would still take from a prediction, and on its incremental potential."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm
from drape.energy.terms.contact import Contact
from drape.geometry.mesh_batch import MeshBatch
from drape.linalg.factorisation import Factorisation
from drape.linalg.stencil_sum import StencilSum
from drape.loss.potential import Potential, differentiable
from drape.loss.prediction import Prediction


class Newton(Potential):
    """Mean of ``½ |z|² / (dt² scale)²`` over the free vertices, ``H z = ∂E/∂x'``, and of ``energies`` · E per mass.

    The first is the squared length of Newton's step. Its gradient, with x' - z taken as given, is zero where that of
    the incremental potential E is, and nowhere else. That of E itself is ruled by the stiffest directions: a crease of
    a hundredth of the cloth outweighs all that sags, sways and slides by three orders of magnitude. Alone, each leaves
    what it hardly sees: trained by E, garments are lifted frame by frame; by Newton's step, they sag and enter the
    body. H is the positive definite Hessian that the solver takes, from the stencils of the terms.

    Args:
        energies: weight of the mean energies per mass [kg/J] beside the length of Newton's step.
        scale: typical acceleration [m/s²], so that the loss of a network that predicts none is of the order of 1.
        longest: vertices whose step is longer count with this length [m]: H knows only where x' is.
        weight, contact, ramp, friction: as of :class:`Potential`.
    """

    asks_device = True
    """The factorisation is made on a CPU."""

    def __init__(
        self,
        energies: float,
        scale: float,
        longest: float,
        *,
        weight: float,
        contact: Contact,
        ramp: Sequence[float],
        friction: float | None,
    ):
        super().__init__(weight, contact, ramp, friction)
        self.energies, self.scale, self.longest = energies, scale, longest
        self._last: tuple[MeshBatch, StencilSum, Factorisation] | None = None

    def forward(self, prediction: Prediction) -> dict[str, Tensor]:
        step, x_next = prediction.step, prediction.x_next.detach()
        mass, values = step.mesh.sum_vertices(step.mass), {}
        gradient, terms = torch.zeros_like(x_next), self.terms(prediction)
        for term in terms:
            energy, slope = term.energy_and_gradient(x_next, step)
            values[term.name] = (differentiable(prediction, energy, slope) / mass).mean()
            gradient += slope
        z = self._newton(terms, x_next, step, gradient)
        length = z.norm(dim=-1, keepdim=True)
        z = z * (self.longest / length.clamp(min=self.longest))
        distance = (prediction.x_next - (x_next - z))[step.free] / (step.dt**2 * self.scale)
        return values | {"newton": 0.5 * distance.square().sum(-1).mean()}

    def joules(self, values: dict[str, Tensor], prediction: Prediction) -> dict[str, Tensor]:
        return super().joules(_energies(values), prediction)

    def total(self, values: dict[str, Tensor]) -> Tensor:
        return self.weight * values["newton"] + self.energies * super().total(_energies(values))

    def _newton(self, terms: list[EnergyTerm], x: Tensor, step: Step, gradient: Tensor) -> Float[Tensor, "vertices 3"]:
        if self._last is None or self._last[0] is not step.mesh:  # a rollout keeps its mesh
            self._last = step.mesh, StencilSum(), Factorisation()
        _, stencils, factors = self._last
        pieces = [piece for term in terms for piece in term.stencils(x, step)]
        slots = np.flatnonzero(np.repeat(step.free.cpu().numpy(), 3))
        factors.factorise(stencils.upper(pieces, len(x))[slots][:, slots])
        solution = np.zeros(3 * len(x))
        solution[slots] = factors.solve(gradient.reshape(-1).double().cpu().numpy()[slots])
        return torch.from_numpy(solution).to(x).view(-1, 3)


def _energies(values: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name: value for name, value in values.items() if name != "newton"}
