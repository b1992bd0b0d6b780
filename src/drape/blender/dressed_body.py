"""A garment around a body that moves: what Blender is given of both. Does not import bpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class DressedBody:
    """All that a simulation of a garment needs, except its fabric, the contact settings and where it starts."""

    rest_positions: Float[np.ndarray, "vertices 3"]
    """The garment's unstrained shape [m]."""
    faces: Int[np.ndarray, "faces 3"]
    pinned: Int[np.ndarray, " pinned"]
    """Vertices that are led; may be none."""
    pin_positions: Float[np.ndarray, "frames pinned 3"]
    """Positions that they are led to [m]."""
    body_faces: Int[np.ndarray, "body_faces 3"]
    body_positions: Float[np.ndarray, "frames body_vertices 3"]
    """The body [m], one frame every 1 / fps seconds."""

    @property
    def num_frames(self) -> int:
        """Frames of the motion."""
        return len(self.body_positions)

    def led(self, start: Float[np.ndarray, "vertices 3"], frame: int) -> Float[np.ndarray, "vertices 3"]:
        """``start`` with the pinned vertices where they are in ``frame``, moved as they are moved in ``start``."""
        positions = np.array(start, np.float64)
        if len(self.pinned):
            offset = positions[self.pinned] - self.pin_positions[0]
            positions[self.pinned] = self.pin_positions[frame] + offset
        return positions
