"""Unions of fields without a crease."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def smooth_minimum(
    a: Float[np.ndarray, "*grid"], b: Float[np.ndarray, "*grid"], width: float
) -> Float[np.ndarray, "*grid"]:
    """Minimum with a rounded corner: at most ``width`` / 4 below it, and equal to it where |a - b| > ``width``."""
    share = np.clip(0.5 + 0.5 * (b - a) / width, 0.0, 1.0)
    return b * (1.0 - share) + a * share - width * share * (1.0 - share)


def smooth_maximum(
    a: Float[np.ndarray, "*grid"], b: Float[np.ndarray, "*grid"], width: float
) -> Float[np.ndarray, "*grid"]:
    """Maximum with a rounded corner: at most ``width`` / 4 above it, and equal to it where |a - b| > ``width``."""
    return -smooth_minimum(-a, -b, width)
