"""The garment stays where it is."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.scene.state import State
from drape.simulators.baseline import Baseline


class Frozen(Baseline):
    """``x' = x``."""

    def positions(self, state: State, frame: int) -> Float[np.ndarray, "vertices 3"]:
        return state.x
