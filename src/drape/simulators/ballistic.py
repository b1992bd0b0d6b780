"""The garment flies on: gravity, but neither a fabric nor a body."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.scene.state import State
from drape.simulators.baseline import Baseline


class Ballistic(Baseline):
    """``x' = x + dt v + dt² g``: the implicit Euler step without elastic energy and contact."""

    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        return state.x + self.scene.dt * state.v + self.scene.dt**2 * self.scene.gravity
