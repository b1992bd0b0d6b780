"""Numbers of frames in words."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int


def spans(frames: Int[np.ndarray, " frames"]) -> str:
    """Sorted numbers in words: ``12-18, 40``."""
    parts = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    return ", ".join(f"{part[0]}-{part[-1]}" if len(part) > 1 else f"{part[0]}" for part in parts)
