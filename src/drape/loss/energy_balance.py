"""The supervised loss of EUNet: the energy that disappears from the motion must be in Φ."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from drape.energy.step_energies import StepEnergies
from drape.loss.term import LossTerm


class EnergyBalance(LossTerm):
    """``(ΔV_Φ - ΔV)²`` [J²], averaged over the batch (paper, eq. 7)."""

    def forward(self, step: StepEnergies) -> Float[Tensor, ""]:
        return (step.change - step.window.balance).square().mean()
