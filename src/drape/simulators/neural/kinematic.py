"""Simulator of the kinematic prior alone: cloth that goes with its body and keeps the lengths of its edges."""

from __future__ import annotations

from drape.scene.material import ATTRIBUTES
from drape.scene.scene import Scene
from drape.simulators.kinematic.prior import KinematicPrior, Nothing
from drape.simulators.neural.cloths import RecordedCloths
from drape.simulators.neural.neural import NeuralSimulator


def kinematic(scene: Scene, share: float, rounds: int, reach: float) -> NeuralSimulator:
    """A :class:`KinematicPrior` with these numbers and a network that has learned nothing: no weight, no fabric.

    Raises:
        DrapeError: numbers out of range.
    """
    prior = KinematicPrior(Nothing(), share, rounds, reach)
    return NeuralSimulator(prior, RecordedCloths(dict.fromkeys(ATTRIBUTES, 1.0)), scene)
