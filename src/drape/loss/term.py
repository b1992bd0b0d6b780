"""Loss terms of a training: named and weighted."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from jaxtyping import Float
from torch import Tensor, nn

from drape.data.windows import Window
from drape.energy.law.eunet import EUNet
from drape.energy.law.step_energies import StepEnergies


class LossTerm(nn.Module, ABC):
    """One summand of the training loss; the total is ``Σ weight · term``."""

    def __init__(self, weight: float):
        super().__init__()
        self.weight = weight

    @abstractmethod
    def forward(self, step: StepEnergies) -> Float[Tensor, ""]:
        """The unweighted value of the term, averaged over the meshes of the window."""


def loss_values(
    energy: EUNet, loss: Mapping[str, LossTerm] | nn.ModuleDict, window: Window
) -> dict[str, Float[Tensor, ""]]:
    """The terms of ``loss`` by name, unweighted, and their weighted sum ``total``."""
    step = StepEnergies(energy, window, training=True)
    values = {name: term(step) for name, term in loss.items()}
    return values | {"total": sum(loss[name].weight * value for name, value in values.items())}
