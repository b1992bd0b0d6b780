"""Baselines without an energy: motions that follow from a recorded sequence."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float

from drape.data.garment_sequence import GarmentSequence
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.simulator import Outcome, StepResult


class Baseline(ABC):
    """A simulator of one recorded garment that needs no energy; pinned vertices are led as in every simulator.

    Args:
        scene: of the sequence, as :func:`drape.data.garment_scene.recorded_scene` makes it.
        sequence: what was recorded, from the first frame on.
    """

    def __init__(self, scene: Scene, sequence: GarmentSequence):
        self.scene = scene
        self.sequence = sequence

    @abstractmethod
    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        """Positions at frame ``frame + 1`` of the scene, from the state at ``frame`` [m]."""

    def step(self, state: State, frame: int) -> StepResult:
        """The state at frame ``frame + 1`` from that at ``frame``; velocities are those of the step."""
        x = np.array(self.positions(state, frame))
        if self.scene.pins is not None:
            x[self.scene.pins.vertices] = self.scene.pins.at(frame + 1)
        return StepResult(State(x, (x - state.x) / self.scene.dt), Outcome.CONVERGED, 0, 0.0)
