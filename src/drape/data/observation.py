"""A recording as a camera would have it: at fewer frames a second, with noise on the positions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError


@dataclass(frozen=True)
class Observation:
    """What of a recording is seen: every ``stride``-th frame, each coordinate with normal noise.

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

    def disturbed(
        self,
        x: Float[np.ndarray, "length windows vertices 3"],
        sequences: Int[np.ndarray, " windows"],
        frames: Int[np.ndarray, "length windows"],
    ) -> Float[np.ndarray, "length windows vertices 3"]:
        """Positions [m] with the noise of the ``frames`` of the ``sequences``."""
        if self.noise == 0:
            return x
        numbers = np.broadcast_to(sequences, frames.shape)
        drawn = [
            np.random.default_rng((self.seed, *place)).standard_normal(x.shape[2:])
            for place in zip(numbers.flat, frames.flat, strict=True)
        ]
        return x + self.noise * np.reshape(drawn, x.shape)


AS_RECORDED = Observation()
