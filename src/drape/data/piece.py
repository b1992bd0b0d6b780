"""The constants of a recorded piece of cloth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drape.geometry.mesh import ClothMesh


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of cloth, how it is held, and what it weighs. Pieces of the same mesh share the object ``mesh``."""

    mesh: ClothMesh
    pinned: Int[np.ndarray, " pinned"]
    """Vertices that do not move; none of a piece that falls."""
    mass: Float[np.ndarray, " vertices"]
    """Mass of each vertex [kg]."""
