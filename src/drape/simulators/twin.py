"""Noise floor: the recorded simulation started 1e-6 m to the side, the error that chaos alone makes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.data.recorded_scene import START
from drape.data.sequence import GarmentSequence
from drape.errors import DrapeError
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.baseline import Baseline


class Twin(Baseline):
    """The perturbed twin of the data; its error is the noise floor.

    Raises:
        DrapeError: the sequence has none.
    """

    def __init__(self, scene: Scene, sequence: GarmentSequence):
        super().__init__(scene, sequence)
        if sequence.twin is None:
            raise DrapeError(
                f"{sequence.file.path}: sequences/{sequence.name}: has no twin; simulator=twin expects the recording "
                "of a second, perturbed start; generate the data with data.twin=1e-6, or choose another simulator"
            )

    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        return self.sequence.twin[START + frame + 1]
