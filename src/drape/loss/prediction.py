"""Loss terms of simulators: named, weighted terms of a predicted step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.step import Step
from drape.energy.term import EnergyTerm


@dataclass(frozen=True, eq=False)
class Prediction:
    """A step as a network has taken it."""

    x_next: Float[Tensor, "vertices 3"]
    """Predicted positions at t + dt [m], with their graph."""
    step: Step
    target: Float[Tensor, "vertices 3"]
    """Positions of the data at t + dt [m]."""
    terms: Sequence[EnergyTerm]
    """Energies of the fabric."""
    progress: float | Float[Tensor, ""]
    """Of the training, from 0 to 1; an array where steps are recorded."""


class PredictionLoss(nn.Module, ABC):
    """Summands of the loss of a simulator; the total is ``Σ weight · summand``."""

    def __init__(self, weight: float):
        super().__init__()
        self.weight = weight

    @abstractmethod
    def forward(self, prediction: Prediction) -> dict[str, Tensor]:
        """The unweighted summands by name, means over the garments."""

    def joules(self, values: dict[str, Tensor], prediction: Prediction) -> dict[str, Tensor]:
        """Those of the summands that are energies, for a garment of mean mass [J]; to be looked at."""
        return {}

    def total(self, values: dict[str, Tensor]) -> Tensor:
        """The number that is minimised: ``weight · Σ values``."""
        return self.weight * torch.stack([value.double() for value in values.values()]).sum()
