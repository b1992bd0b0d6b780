"""The measures of a body."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from drape.errors import DrapeError

RANGES = {
    "height": (1.45, 2.05),
    "girth": (0.85, 1.3),
    "shoulder": (0.85, 1.2),
    "hip": (0.85, 1.25),
    "chest": (0.85, 1.35),
    "belly": (0.85, 1.6),
    "limb": (0.85, 1.2),
}
"""Smallest and largest measure for which the surface was looked at; the height in m, the others factors."""


@dataclass(frozen=True)
class FigureShape:
    """Measures of a body: the height in metres, the others factors of an average build.

    Raises:
        DrapeError: a measure that is no number or outside :data:`RANGES`.
    """

    height: float = 1.72
    """From sole to crown [m]."""
    girth: float = 1.0
    """Thickness of trunk and limbs."""
    shoulder: float = 1.0
    """Width of the shoulders."""
    hip: float = 1.0
    """Width of the hips, and the seat."""
    chest: float = 1.0
    """Depth of the chest; above 1 also the bust."""
    belly: float = 1.0
    """Depth of the abdomen, and the waist."""
    limb: float = 1.0
    """Thickness of arms and legs, times ``girth``."""

    def __post_init__(self) -> None:
        for measure, value in asdict(self).items():
            low, high = RANGES[measure]
            if not (math.isfinite(value) and low <= value <= high):
                unit = " m" if measure == "height" else ""
                raise DrapeError(
                    f"figure.{measure}: found {value}; expected {low} to {high}{unit}; choose a measure in this range"
                )
