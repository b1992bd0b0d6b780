"""What a training loss is made of: named, weighted terms."""

from __future__ import annotations

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.step_energies import StepEnergies


class LossTerm(nn.Module, ABC):
    """One summand of the training loss; the total is ``Σ weight · term``."""

    def __init__(self, weight: float):
        super().__init__()
        self.weight = weight

    @abstractmethod
    def forward(self, step: StepEnergies) -> Float[Tensor, ""]:
        """The unweighted value of the term, averaged over the meshes of the window."""
