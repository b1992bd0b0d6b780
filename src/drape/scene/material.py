"""A fabric as the networks see it."""

from __future__ import annotations

from collections.abc import Mapping

ATTRIBUTES = ("tension_stiffness", "bending_stiffness", "mass_per_vertex", "tension_damping", "bending_damping")
"""The entries of the vector **a** in R⁵ (paper, section 3.2), Blender's values."""


def attribute_vector(material: Mapping[str, object], scales: Mapping[str, float]) -> list[float]:
    """The vector **a** of a fabric: Blender's values divided by ``scales`` (FACTS 1.1).

    A scale of infinity hides an entry, as the official code hides the mass.
    """
    return [float(material[name]) / scales[name] for name in ATTRIBUTES]
