"""A heavy strip that is clamped at one end: the theory that the cantilever test rests on."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

LEAST, STEEPEST = 1e-4, 85.0
"""Chord angles that are looked at [degrees]: limper strips hang straight down."""
LONGEST = 50.0
"""In bending lengths."""


class _Level:
    """End of the integration: a strip that is level."""

    terminal = True

    def __call__(self, _: float, y: Sequence[float] | np.ndarray) -> float:
        return float(y[0])


def strip(tip: float) -> tuple[float, float]:
    """Overhang in bending lengths, ``L / (B/w)^(1/3)``, and chord angle of a strip whose tip is that steep [radians].

    ``φ'' = -σ cos φ``, φ'(0) = 0, with the slope φ of an inextensible strip at the arc length σ from its tip, in
    bending lengths; B is its bending stiffness, w its weight per length. Where φ = 0 it is clamped. The chord leads
    from there to the tip (Peirce 1930, J. Textile Inst. 21, T377).
    """
    slopes = lambda sigma, y: [y[1], -sigma * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]  # noqa: E731
    found = solve_ivp(slopes, (0.0, LONGEST), [tip, 0.0, 0.0, 0.0], events=_Level(), rtol=1e-9, atol=1e-12)
    return float(found.t[-1]), float(np.arctan2(found.y[3, -1], found.y[2, -1]))


@cache
def bending_lengths(angle: float) -> float:
    """The overhang in bending lengths at which the chord has this angle [degrees]; beyond ``STEEPEST`` that of it."""
    chord = np.radians(np.clip(angle, LEAST, STEEPEST))
    return strip(brentq(lambda tip: strip(tip)[1] - chord, 1e-9, 0.5 * np.pi - 1e-9, xtol=1e-12))[0]
