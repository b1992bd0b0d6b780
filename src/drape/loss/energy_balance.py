"""The supervised loss of EUNet: the energy that disappears from the motion must be in Φ."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from drape.energy.law.step_energies import StepEnergies
from drape.loss.term import LossTerm


class EnergyBalance(LossTerm):
    """``(ΔV_Φ - ΔV)²`` [J²], averaged over the batch (paper, eq. 8)."""

    def forward(self, step: StepEnergies) -> Float[Tensor, ""]:
        return (step.change - step.window.balance).square().mean()


class EnergyBalancePerMass(LossTerm):
    """``((ΔV_Φ - ΔV) / M)²`` [J²/kg²] with M the mass of the cloth: heavy fabrics do not outweigh light ones."""

    def forward(self, step: StepEnergies) -> Float[Tensor, ""]:
        window = step.window
        error = (step.change - window.balance) / window.mesh.sum_vertices(window.mass)
        return error.square().mean()
