"""Vertex masses of a cloth, by one of two rules that the scene names."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.geometry.normals import face_normals

RULES = ("per_vertex", "areal_density")


def vertex_masses(mesh: ClothMesh, mass: Mapping[str, float | None]) -> Float[np.ndarray, " vertices"]:
    """Mass of each vertex [kg], by the one rule of ``mass`` that is not None.

    * ``{per_vertex: m}``: m [kg] each, whatever its area, as in Blender; a finer mesh of the same cloth is heavier.
    * ``{areal_density: ρ}``: ρ [kg/m²] times a third of the rest areas of its faces; the same cloth weighs the same at
      every resolution.

    Raises:
        DrapeError: no rule, both, an unknown one, or a value that is not a positive number.
    """
    rule, value = mass_rule(mass)
    if rule == "per_vertex":
        return np.full(mesh.num_vertices, value)
    return value * vertex_areas(mesh)


def mass_rule(mass: Mapping[str, float | None]) -> tuple[str, float]:
    """The one rule of ``mass`` and its value: see :func:`vertex_masses`.

    Raises:
        DrapeError: no rule, both, an unknown one, or a value that is not a positive number.
    """
    chosen = {rule: value for rule, value in mass.items() if value is not None}
    if len(chosen) != 1 or set(mass) - set(RULES):
        raise DrapeError(
            f"scene.mass: found {dict(mass)}; expected exactly one of per_vertex (kg each, as Blender has it) and "
            "areal_density (kg/m2): set one, as in scene.mass.areal_density=0.2, and the other to null"
        )
    rule, value = next(iter(chosen.items()))
    if not math.isfinite(value) or value <= 0:
        raise DrapeError(f"scene.mass.{rule}: found {value}; expected a positive number")
    return rule, float(value)


def vertex_areas(mesh: ClothMesh) -> Float[np.ndarray, " vertices"]:
    """A third of the rest areas of the faces at each vertex [m²]; they sum to the area of the cloth."""
    area = 0.5 * np.linalg.norm(face_normals(mesh.rest_positions.astype(np.float64), mesh.faces), axis=1)
    return np.bincount(mesh.faces.reshape(-1), np.repeat(area / 3.0, 3), minlength=mesh.num_vertices)
