"""A fabric as Blender describes it, and as the networks see it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from drape.errors import DrapeError

ATTRIBUTES = ("tension_stiffness", "bending_stiffness", "mass_per_vertex", "tension_damping", "bending_damping")
"""The entries of the vector **a** in R⁵ (paper, section 3.2), Blender's values."""

OURS = ("name", "areal_density")
"""Fields of :class:`Material` that are no settings of Blender's."""


@dataclass(frozen=True)
class Material:
    """One fabric: Blender's cloth settings, in Blender's numbers, and what it weighs as people wear it.

    ``mass_per_vertex`` [kg] is what the fabric weighed in the training data, for every vertex whatever its area; it is
    an input of the networks. ``areal_density`` [kg/m²] is that of the real fabric, no setting of Blender's; scenes of
    human size take it for their cloth. What a vertex of a scene weighs is said by the scene alone.

    Raises:
        DrapeError: a value that is not finite or negative, a mass or density that is not positive.
    """

    name: str
    tension_stiffness: float
    bending_stiffness: float
    tension_damping: float
    bending_damping: float
    air_damping: float
    mass_per_vertex: float
    areal_density: float | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        for key, value in self.attributes.items():
            least = "a positive number" if key == "mass_per_vertex" else "a number from 0 on"
            if not math.isfinite(value) or value < 0 or (value == 0 and key == "mass_per_vertex"):
                raise DrapeError(f"fabric {self.name}: {key}: found {value}; expected {least}, as Blender has it")
        density = self.areal_density
        if density is not None and not (math.isfinite(density) and density > 0):
            raise DrapeError(f"fabric {self.name}: areal_density: found {density}; expected kg/m2, more than 0")

    @classmethod
    def from_settings(cls, name: str, settings: Mapping[str, Any]) -> Material:
        """A fabric from Blender's settings as a data file stores them; other settings than a fabric's are left out.

        Raises:
            DrapeError: a setting is missing, or see :class:`Material`.
        """
        keys = [each.name for each in fields(cls) if each.name not in OURS]
        missing = [key for key in keys if key not in settings]
        if missing:
            raise DrapeError(f"fabric {name}: missing {', '.join(missing)}; expected Blender's cloth settings")
        return cls(name, **{key: float(settings[key]) for key in keys})

    @property
    def attributes(self) -> dict[str, float]:
        """Setting -> value; what :func:`attribute_vector` takes."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name not in OURS}


def attribute_vector(material: Mapping[str, Any], scales: Mapping[str, float]) -> list[float]:
    """The vector **a** of a fabric: Blender's values divided by ``scales`` (docs/sources.md, The piece of cloth).

    A scale of infinity hides an entry, as the official code hides the mass.
    """
    return [float(material[name]) / scales[name] for name in ATTRIBUTES]
