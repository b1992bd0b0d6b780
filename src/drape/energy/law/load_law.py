"""The law of one fabric from a file: a checkpoint of networks, or a table of splines."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.energy.law.baked.file import read_baked
from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.checkpoint import load_energy, read_checkpoint
from drape.energy.law.edge_law import NetworkLaw
from drape.energy.law.hinge_law import NetworkHinges
from drape.energy.law.potential_hinge import HingePotential
from drape.errors import DrapeError
from drape.scene.material import ATTRIBUTES, Material, attribute_vector
from drape.stored import reading

SAME = 1e-6
"""Relative difference of a setting up to which a fabric is the one that was baked."""


def load_law(checkpoint: str, material: Material) -> tuple[NetworkLaw | NetworkHinges, Float[Tensor, " attributes"]]:
    """The law that a checkpoint of ``train.py`` holds, and the vector **a** of the fabric in its scales.

    Raises:
        DrapeError: see :func:`drape.energy.law.checkpoint.load_energy`; or no fabric of this name was trained.
    """
    with reading(checkpoint, "train again"):
        return _law(read_checkpoint(checkpoint)["drape"], checkpoint, material)


def _law(
    content: dict[str, Any], checkpoint: str, material: Material
) -> tuple[NetworkLaw | NetworkHinges, Float[Tensor, " attributes"]]:
    trained = list(content["config"]["material"])
    if material.name not in trained:
        raise DrapeError(
            f"{checkpoint}: found a law of {', '.join(trained)}; expected one of {material.name}; choose one of its "
            f"fabrics, or train with material={material.name}"
        )
    example = content["example"]
    face_area = _mean_area(example["rest_positions"], example["faces"])
    scales = content["config"]["datamodule"]["attribute_scales"]
    attributes = torch.tensor(attribute_vector(material.attributes, scales), dtype=torch.float64)
    if not torch.isfinite(attributes).all():
        raise DrapeError(f"{checkpoint}: attribute_scales: found {scales}; expected numbers above 0, or inf")
    energy, dt = load_energy(checkpoint), example["window"]["dt"]
    if isinstance(energy.potential, HingePotential):
        return NetworkHinges(energy, attributes, face_area, dt), attributes
    return NetworkLaw(energy, face_area, dt), attributes


def load_baked(table: str, material: Material) -> tuple[BakedHinges, Float[Tensor, " attributes"]]:
    """The law that a table of ``bake.py`` holds, and the vector **a** that it was baked for.

    Raises:
        DrapeError: see :func:`drape.energy.law.baked.file.read_baked`; or the table is of another fabric, by its
            name or by its settings.
    """
    law = read_baked(table)
    if law.fabric.name != material.name:
        raise DrapeError(
            f"{table}: found a table of {law.fabric.name}; expected one of {material.name}; bake that fabric: "
            f"python src/bake.py fabric={material.name}"
        )
    for name in ATTRIBUTES:
        value, baked = material.attributes[name], law.fabric.attributes[name]
        if abs(value - baked) > SAME * max(abs(baked), 1.0):
            raise DrapeError(
                f"{table}: {name} of {material.name}: found a table baked for {baked:g}, but the scene's fabric has "
                f"{value:g}; a table is of one fabric only: bake it again with fabric.{name}={value:g}"
            )
    return law, law.attributes


def _mean_area(rest_positions: Float[Tensor, "vertices 3"], faces: Int[Tensor, "faces 3"]) -> float:
    """Mean area of the faces [m²]."""
    a, b, c = rest_positions.double()[faces].unbind(1)
    return float(0.5 * torch.linalg.cross(b - a, c - a).norm(dim=-1).mean())
