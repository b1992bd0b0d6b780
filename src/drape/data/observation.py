"""A recording as a camera would have it: at fewer frames a second, with noise on the positions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError


@dataclass(frozen=True)
class Observation:
    """View of a recording: every ``stride``-th frame, each coordinate with normal noise.

    A vertex in a frame has the same noise in every window that it is seen in.

    Args:
        noise: standard deviation of each coordinate [m].
        stride: recorded frames from one that is seen to the next.
        seed: of the noise.

    Raises:
        DrapeError: noise that is negative or not finite, a stride below 1.
    """

    noise: float = 0.0
    stride: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.noise) and self.noise >= 0):
            raise DrapeError(f"observation.noise: found {self.noise}; expected 0 or a number above [m]")
        if self.stride < 1:
            raise DrapeError(f"observation.stride: found {self.stride}; expected a whole number from 1 on")

    def disturbance(self, sequence: int, frame: int, vertices: int) -> Float[np.ndarray, "vertices 3"]:
        """The noise of a frame of a sequence [m]."""
        return self.noise * np.random.default_rng((self.seed, sequence, frame)).standard_normal((vertices, 3))


AS_RECORDED = Observation()
