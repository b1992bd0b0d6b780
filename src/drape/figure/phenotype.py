"""The measures of a person of anny (Brégier et al. 2025), which are positions on anny's own scales."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from drape.errors import DrapeError

RANGES = {
    "gender": (0.0, 1.0),
    "age": (0.3, 1.0),
    "muscle": (0.0, 1.0),
    "weight": (0.0, 1.0),
    "height": (0.2, 0.7),
    "proportions": (0.0, 1.0),
}
"""Smallest and largest value for which bodies in garments were looked at."""


@dataclass(frozen=True)
class Phenotype:
    """Measures of a person, each on anny's scale from 0 to 1, not in metres, years or kilograms.

    Raises:
        DrapeError: a value that is no number or outside :data:`RANGES`.
    """

    gender: float = 0.5
    """0 male, 1 female."""
    age: float = 0.67
    """1/3 a child, 2/3 a young adult, 1 old."""
    muscle: float = 0.5
    weight: float = 0.5
    """Of the build, for its height."""
    height: float = 0.45
    """Among people of this age and gender."""
    proportions: float = 0.5
    """0 uncommon, 1 ideal ones."""

    def __post_init__(self) -> None:
        for measure, value in asdict(self).items():
            low, high = RANGES[measure]
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (number and math.isfinite(value) and low <= value <= high):
                raise DrapeError(
                    f"figure.{measure}: found {value!r}; expected {low} to {high} on anny's scale; choose a value in "
                    "this range"
                )
