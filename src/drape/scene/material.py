"""A fabric as Blender describes it, and as the networks see it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from drape.errors import DrapeError

ATTRIBUTES = ("tension_stiffness", "bending_stiffness", "mass_per_vertex", "tension_damping", "bending_damping")
"""The entries of the vector **a** in R⁵ (paper, section 3.2), Blender's values."""


@dataclass(frozen=True)
class Material:
    """One fabric: Blender's cloth settings, in Blender's numbers (FACTS 1.1).

    ``mass_per_vertex`` [kg] is what the fabric weighed in the training data, for every vertex whatever its area; it is
    an input of the networks. What a vertex of a scene weighs is said by the scene alone.

    Raises:
        DrapeError: a value that is not finite or negative, a mass that is not positive.
    """

    name: str
    tension_stiffness: float
    bending_stiffness: float
    tension_damping: float
    bending_damping: float
    air_damping: float
    mass_per_vertex: float

    def __post_init__(self) -> None:
        for key, value in self.attributes.items():
            least = "a positive number" if key == "mass_per_vertex" else "a number from 0 on"
            if not math.isfinite(value) or value < 0 or (value == 0 and key == "mass_per_vertex"):
                raise DrapeError(f"fabric {self.name}: {key}: found {value}; expected {least}, as Blender has it")

    @classmethod
    def from_settings(cls, name: str, settings: Mapping[str, object]) -> Material:
        """A fabric from Blender's settings as a data file stores them; other settings than a fabric's are left out.

        Raises:
            DrapeError: a setting is missing, or see :class:`Material`.
        """
        keys = [key for key in cls.__dataclass_fields__ if key != "name"]
        missing = [key for key in keys if key not in settings]
        if missing:
            raise DrapeError(f"fabric {name}: missing {', '.join(missing)}; expected Blender's cloth settings")
        return cls(name, **{key: float(settings[key]) for key in keys})

    @property
    def attributes(self) -> dict[str, float]:
        """Setting -> value; what :func:`attribute_vector` takes."""
        return {key: value for key, value in asdict(self).items() if key != "name"}


def attribute_vector(material: Mapping[str, object], scales: Mapping[str, float]) -> list[float]:
    """The vector **a** of a fabric: Blender's values divided by ``scales`` (FACTS 1.1).

    A scale of infinity hides an entry, as the official code hides the mass.
    """
    return [float(material[name]) / scales[name] for name in ATTRIBUTES]
