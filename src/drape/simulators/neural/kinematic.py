"""What networks add to: cloth that goes with its body and keeps the lengths of its edges, and nothing else."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.step import Step
from drape.scene.material import ATTRIBUTES
from drape.scene.scene import Scene
from drape.simulators.neural.cloths import RecordedCloths
from drape.simulators.neural.kinematic_prior import KinematicPrior
from drape.simulators.neural.neural import NeuralSimulator


def kinematic(scene: Scene, share: float, rounds: int, search_range: float) -> NeuralSimulator:
    """A :class:`KinematicPrior` with these numbers and a network that has learned nothing: no weight, no fabric.

    Raises:
        DrapeError: numbers out of range.
    """
    prior = KinematicPrior(Nothing(), share, rounds, search_range)
    return NeuralSimulator(prior, RecordedCloths(dict.fromkeys(ATTRIBUTES, 1.0)), scene)


class Nothing(nn.Module):
    """A network that has learned nothing: accelerations of 0."""

    def forward(self, step: Step) -> Float[Tensor, "vertices 3"]:
        return torch.zeros_like(step.x)
