"""The interface of bodies that garments are cut around: watertight, with the joints of a figure."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int


@runtime_checkable
class Body(Protocol):
    """A solid."""

    def signed_distance(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Distance to the surface, negative inside [m]."""
        ...


@runtime_checkable
class FigureLike(Body, Protocol):
    """A person in the rest pose: arms away from the trunk, z up, left side at positive x."""

    @property
    def rest_positions(self) -> Float[np.ndarray, "vertices 3"]: ...
    @property
    def faces(self) -> Int[np.ndarray, "faces 3"]: ...
    @property
    def joints(self) -> Float[np.ndarray, "joints 3"]: ...
    @property
    def bones(self) -> Int[np.ndarray, "vertices 4"]: ...
    @property
    def weights(self) -> Float[np.ndarray, "vertices 4"]: ...

    def skin_weights(
        self, points: Float[np.ndarray, "points 3"]
    ) -> tuple[Int[np.ndarray, "points 4"], Float[np.ndarray, "points 4"]]:
        """Bones and weights of the surface next to each point."""
        ...
