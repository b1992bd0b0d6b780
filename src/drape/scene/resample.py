"""A motion at other times than those it was recorded at."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError

ROUNDING = 1e-6
"""Share of a frame by which a time may lie past the last recorded frame."""


def resample(
    positions: Float[np.ndarray, "recorded vertices 3"], fps: float | None, dt: float, frames: int, where: str
) -> Float[np.ndarray, "frames vertices 3"]:
    """Positions at the times ``k * dt``, k = 0..``frames``, between recorded frames linearly; ``fps`` of the recording.

    A single recorded frame stands still and stays one.

    Raises:
        DrapeError: the recording ends before time ``frames * dt``, or does not say its ``fps``. ``where`` opens the
            sentence.
    """
    if len(positions) == 1:
        return positions
    if fps is None:
        raise DrapeError(f"{where}: found {len(positions)} frames that do not say how many there are in a second")
    last = len(positions) - 1
    times = np.arange(frames + 1) * dt * fps  # in recorded frames
    if times[-1] > last + ROUNDING:
        enough = int((last + ROUNDING) / (dt * fps))
        raise DrapeError(
            f"{where}: found {len(positions)} frames at {fps:g} per second, {last / fps:.3g} s; expected "
            f"{frames * dt:.3g} s, for {frames} frames of the scene; set scene.frames to {enough} or fewer, or give a "
            "longer motion"
        )
    before = np.clip(np.floor(times + ROUNDING).astype(np.int64), 0, last - 1)
    share = np.clip(times - before, 0.0, 1.0)[:, None, None]
    return (1.0 - share) * positions[before] + share * positions[before + 1]
