"""The incremental potential of a predicted step: a network that minimises it needs no recorded garments."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.incremental_potential import terms_of
from drape.energy.term import EnergyTerm
from drape.energy.terms.contact import Contact
from drape.errors import DrapeError
from drape.loss.prediction import Prediction, PredictionLoss


class Potential(PredictionLoss):
    """Mean of ``(inertia + gravity [+ external] + Σ energies of the fabric + contact [+ friction]) / mass`` [J/kg].

    Paper, eq. 18. Per mass, so that garments of silk and of denim count alike; a frame's free fall is worth
    g² dt²/2 = 0.05 J/kg. The stiffness of contact grows over the training, as in HOOD (docs/sources.md): a network that
    has learned nothing yet would see nothing but contact. Energies bring their own gradients, from compiled kernels
    where there are some.

    Args:
        weight: of the sum.
        contact: of cloth and body, in the end.
        ramp: (share of its stiffness at first, progress at which it begins to grow, progress at which it is 1).
        friction: coefficient μ; None where the energy has no such term.

    Raises:
        DrapeError: a ramp of other than three shares in order.
    """

    def __init__(self, weight: float, contact: Contact, ramp: Sequence[float], friction: float | None):
        super().__init__(weight)
        self.contact, self.ramp, self.friction = contact, tuple(ramp), friction
        if len(self.ramp) != 3 or not 0.0 <= self.ramp[1] <= self.ramp[2] <= 1.0 or not 0.0 < self.ramp[0] <= 1.0:
            raise DrapeError(
                f"loss potential: ramp: found {list(ramp)}; expected a share of the stiffness above 0 and two points "
                "of the training from 0 to 1, such as [0.01, 0.33, 1.0]"
            )

    def forward(self, prediction: Prediction) -> dict[str, Tensor]:
        step = prediction.step
        mass = step.mesh.sum_vertices(step.mass)
        values = {}
        for term in self.terms(prediction):
            found = term.energy_and_gradient(prediction.x_next.detach(), step)
            values[term.name] = (differentiable(prediction, *found) / mass).mean()
        return values

    def joules(self, values: dict[str, Tensor], prediction: Prediction) -> dict[str, Tensor]:
        mass = prediction.step.mass.sum() / prediction.step.mesh.num_meshes
        return {name: mass * energy.detach() for name, energy in values.items()}

    def terms(self, prediction: Prediction) -> list[EnergyTerm]:
        """The summands of the incremental potential at this point of the training."""
        first, begin, end = self.ramp
        risen = ((torch.as_tensor(prediction.progress) - begin) / max(end - begin, 1e-9)).clamp(0.0, 1.0)
        share = first + (1.0 - first) * risen
        contact, pushed = self.contact.stiffened(share), prediction.step.external_force is not None
        return terms_of(prediction.terms, contact, self.friction, gravity=True, external=pushed)


def differentiable(
    prediction: Prediction, energy: Float[Tensor, " meshes"], gradient: Float[Tensor, "vertices 3"]
) -> Float[Tensor, " meshes"]:
    """The energy of each garment with its gradient in the predicted positions, which is known already."""
    nothing = prediction.x_next - prediction.x_next.detach()
    return energy + prediction.step.mesh.sum_vertices((nothing * gradient).sum(-1))
