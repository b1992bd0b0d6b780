"""Sizes and ease of a garment, as numbers that a figure of any size can wear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from drape.errors import DrapeError

KINDS = ("tshirt", "top", "jumpsuit", "dress", "skirt", "trousers")


@dataclass(frozen=True)
class GarmentStyle:
    """Measures of a garment; what a kind does not have (sleeves of trousers) is ignored.

    Raises:
        DrapeError: a measure outside its range in :data:`LIMITS`.
    """

    ease: float = 0.012
    """Distance between the cloth and the body where it sits closely [m]."""
    length: float = 0.6
    """Height of the hem: tshirt, top 0 at the waist, 1 at the crotch; others 0 at the crotch, 1 at the ankle."""
    sleeve: float = 0.35
    """End of the sleeve: 0 at the shoulder, 1 at the wrist."""
    fit: float = 0.5
    """1 follows the body, 0 hangs straight down from the widest place above."""
    flare: float = 0.15
    """Widening of skirts and legs: half-width gained per length below hip or knee."""
    collar: float = 0.3
    """Opening of the collar: 0 close to the throat, 1 wide and deep."""
    strap: float = 0.065
    """Width of a top's shoulder straps [m]; narrower ones slip off."""

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise DrapeError(
                    f"garment style: {name} is {value}; expected {low} to {high}; choose a value in that range"
                )


LIMITS: Mapping[str, tuple[float, float]] = {
    "ease": (0.008, 0.03),
    "length": (0.0, 1.0),
    "sleeve": (0.2, 1.0),
    "fit": (0.0, 1.0),
    "flare": (0.0, 0.6),
    "collar": (0.0, 1.0),
    "strap": (0.055, 0.12),
}
"""The values with which a garment can be made on a figure of usual shape."""

RANGES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "tshirt": {"length": (0.55, 1.0), "sleeve": (0.3, 0.6), "fit": (0.1, 0.8)},
    "top": {"length": (0.4, 0.95), "fit": (0.2, 0.9), "collar": (0.3, 0.9)},
    "jumpsuit": {"length": (0.35, 0.95), "sleeve": (0.3, 0.95), "fit": (0.3, 0.9), "flare": (0.0, 0.15)},
    "dress": {"length": (0.1, 0.85), "sleeve": (0.28, 0.6), "fit": (0.4, 1.0), "flare": (0.1, 0.45)},
    "skirt": {"length": (0.15, 0.85), "flare": (0.1, 0.5), "fit": (0.5, 1.0)},
    "trousers": {"length": (0.25, 0.97), "fit": (0.2, 0.9), "flare": (0.0, 0.15)},
}
"""Ranges that :func:`random_style` draws from, uniformly, for each kind; the other measures from :data:`USUAL`."""

USUAL: Mapping[str, tuple[float, float]] = {
    "ease": (0.010, 0.018),
    "length": (0.4, 0.9),
    "sleeve": (0.3, 0.6),
    "fit": (0.3, 0.8),
    "flare": (0.05, 0.2),
    "collar": (0.1, 0.8),
    "strap": (0.06, 0.085),
}


def known_kind(kind: str) -> str:
    """``kind`` itself.

    Raises:
        DrapeError: it is none of :data:`KINDS`.
    """
    if kind not in KINDS:
        raise DrapeError(f"garment kind: found {kind!r}; expected one of {', '.join(KINDS)}")
    return kind


def random_style(kind: str, rng: np.random.Generator) -> GarmentStyle:
    """A style drawn uniformly from :data:`RANGES` of its kind; the same generator state gives the same style.

    Raises:
        DrapeError: an unknown kind.
    """
    ranges = {**USUAL, **RANGES[known_kind(kind)]}
    return GarmentStyle(**{field.name: float(rng.uniform(*ranges[field.name])) for field in fields(GarmentStyle)})
