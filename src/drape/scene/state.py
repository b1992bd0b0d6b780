"""Positions and velocities of a cloth, and a stored sequence of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError


@dataclass(frozen=True, eq=False)
class State:
    """Positions ``x`` [m] and velocities ``v`` [m/s] of the vertices at one instant, float64."""

    x: Float[np.ndarray, "vertices 3"]
    v: Float[np.ndarray, "vertices 3"]

    def __post_init__(self) -> None:
        for name in ("x", "v"):
            array = np.array(getattr(self, name), np.float64)
            bad = ~np.isfinite(array).all(axis=-1)
            if bad.any():
                where = int(np.flatnonzero(bad)[0])
                raise DrapeError(f"state: {name} of vertex {where} is {array[where]}; expected finite numbers")
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def at_rest(cls, x: Float[np.ndarray, "vertices 3"]) -> State:
        """Positions ``x`` without velocity."""
        return cls(x, np.zeros_like(x))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Frames of one cloth; frame k is at time ``k * dt`` and frame 0 is the initial state."""

    x: Float[np.ndarray, "frames vertices 3"]
    """Positions [m]."""
    v: Float[np.ndarray, "frames vertices 3"]
    """Velocities [m/s]."""
    dt: float
    """Time between frames [s]."""

    @property
    def num_frames(self) -> int:
        return len(self.x)

    def state(self, frame: int) -> State:
        """The state at one frame."""
        return State(self.x[frame], self.v[frame])
