"""A moving mesh as a file gives it, at the file's own rate and in its own unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class MotionClip:
    """Faces and positions per frame; not checked, that is for those who make a body of it."""

    faces: Int[np.ndarray, "faces 3"]
    positions: Float[np.ndarray, "frames vertices 3"]
    fps: float | None = None
    """Frames per second; None where the file does not say."""
    z_is_up: bool = False
    """The file says what is up, and the positions have been turned so that it is +z."""
