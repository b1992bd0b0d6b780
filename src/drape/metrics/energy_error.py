"""The metric of the paper's table: how well the energy explains the change of energy of a whole cloth."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from drape.energy.law.step_energies import StepEnergies
from drape.metrics.fabric_metric import FabricMetric


class EnergyError(FabricMetric):
    """Mean and standard deviation over windows of ``(ΔV_Φ - ΔV)²`` [J²] (paper, eq. 8 and table 1).

    Every window counts, those of error zero too (the official code leaves them out, docs/sources.md). The deviation is
    that of the squared errors around their mean, divided by n.
    """

    count: Tensor
    total: Tensor
    squares: Tensor

    def __init__(self, fabrics: Sequence[str]):
        super().__init__(fabrics)
        for name in ("count", "total", "squares"):
            self.add_sum(name)

    def update(self, step: StepEnergies) -> None:
        error = (step.change - step.window.balance).square()
        self.count += self.per_fabric(step.window, torch.ones_like(error))
        self.total += self.per_fabric(step.window, error)
        self.squares += self.per_fabric(step.window, error.square())

    def compute(self) -> dict[str, float]:
        means = self.means("energy_error_J2", self.total, self.count)
        squares = self.means("energy_error_J2_std", self.squares, self.count)
        spread = {key: max(s - m**2, 0.0) ** 0.5 for (key, s), m in zip(squares.items(), means.values(), strict=True)}
        return means | spread
