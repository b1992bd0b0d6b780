"""Learning rates as a multiple of the initial one, over the progress of the training from 0 to 1."""

from __future__ import annotations

import math
from collections.abc import Callable

Schedule = Callable[[float], float]


def halving(every: float, begin: float = 0.0, extra: float = 0.0) -> Schedule:
    """Halved each time that ``every``, a fraction of the training, has passed since ``begin``; ``extra`` is added.

    The paper's energies: 4 of 6 epochs. Its simulators: every third after the first tenth, and 0.01
    (docs/sources.md, The published schedule of simulators).
    """
    return lambda progress: 0.5 ** math.floor(max(progress - begin, 0.0) / every + 1e-9) + extra


def cosine(warmup: float, final: float) -> Schedule:
    """Linear up to 1 over the fraction ``warmup``, then half a cosine down to ``final``."""

    def multiple(progress: float) -> float:
        if progress < warmup:
            return progress / warmup
        falling = (progress - warmup) / (1.0 - warmup)
        return final + (1.0 - final) * 0.5 * (1.0 + math.cos(math.pi * min(falling, 1.0)))

    return multiple
