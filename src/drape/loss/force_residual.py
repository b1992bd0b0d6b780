"""Train on the equation of motion itself: three numbers for each free vertex instead of one for each cloth."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from drape.energy.law.step_energies import StepEnergies
from drape.loss.term import LossTerm


class ForceResidual(LossTerm):
    """Mean over free vertices of ``h(|m a - m g + ∂Φ/∂x| / m)`` [m²/s⁴], with h(r) = b² (√(1 + (r/b)²) - 1).

    Divided by the mass the residual is an acceleration, which is of one size for all fabrics. h is ``r²/2`` below
    ``bend`` [m/s²] and grows linearly above: a few violent vertices must not outweigh a whole sheet.
    """

    def __init__(self, weight: float, bend: float):
        super().__init__(weight)
        self.bend = bend

    def forward(self, step: StepEnergies) -> Float[Tensor, ""]:
        window = step.window
        relative = step.force_residual / (window.mass[:, None] * self.bend)
        huber = (1.0 + relative.square().sum(-1)).sqrt() - 1.0
        return self.bend**2 * huber.sum() / window.free.sum()
