"""Blender's cloth at some qualities takes a solver step too many in each frame: its gravity is larger than asked for.

Its loop ``for (step = 0; step < 1; step += 1 / quality)`` adds in single precision, and ends one step late where the
sum falls short of 1: at a quality of 12, which is denim's, and at 19, 23, 27, 28, ... With n = q + 1 steps of 1/q frame
time runs n/q times as fast: a free vertex falls by (n/q)² times what it should, 11.51 instead of 9.81 m/s² at 12
(measured with Blender 5.0.1 at 12, 28, 40 and 80, and at 15 other qualities where nothing is wrong). Seen at the frame
rate, that is a larger gravity and a fabric as much stiffer.
"""

from __future__ import annotations

import numpy as np


def steps_run(quality: int) -> int:
    """Solver steps that Blender takes in a frame at a ``quality``: it, or one more."""
    step, size, count = np.float32(0.0), np.float32(1.0) / np.float32(quality), 0
    while step < np.float32(1.0):
        step, count = np.float32(step + size), count + 1
    return count


def gravity_factor(quality: int) -> float:
    """Factor of gravity at a ``quality``."""
    return (steps_run(quality) / quality) ** 2
