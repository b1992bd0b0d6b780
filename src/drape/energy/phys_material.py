"""The material of PHYS: four numbers, the ranges that HOOD trains in, and what its networks see of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.term import EnergyTerm
from drape.energy.terms.bending import Bending
from drape.energy.terms.per_mesh import PerMesh
from drape.energy.terms.stvk import StVK

THICKNESS = 4.7e-4
"""Thickness of the cloth [m], the same for all materials (docs/sources.md, HOOD)."""


class Range(NamedTuple):
    """The values that a number of the material may take, and how networks see one: as its position from 0 to 1."""

    low: float
    high: float
    is_logarithmic: bool
    """Whether positions are counted on a logarithmic scale."""

    def value(self, position: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """The number at a position."""
        if self.is_logarithmic:
            return self.low * (self.high / self.low) ** position
        return self.low + (self.high - self.low) * position

    def position(self, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """The position of a number; outside of 0..1 for one that is not in the range."""
        if self.is_logarithmic:
            return torch.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


RANGES = {
    "areal_density": Range(4.34e-2, 7e-1, True),
    "shear_modulus": Range(15909.0, 63636.0, True),
    "first_lame": Range(3535.414406069427, 93333.73508005822, False),
    "bending_stiffness": Range(6.370782056371576e-08, 1.3139737991266374e-03, True),
}
"""HOOD's training ranges (docs/sources.md, HOOD), by field of :class:`PhysMaterial` and in its units."""


class PhysMaterial(NamedTuple):
    """Density and elastic constants of a cloth under PHYS, the StVK membrane with hinges."""

    areal_density: float
    """ρ [kg/m²]"""
    shear_modulus: float
    """μ [Pa]"""
    first_lame: float
    """λ [Pa]"""
    bending_stiffness: float
    """k [J]"""

    @classmethod
    def default(cls) -> PhysMaterial:
        """HOOD's default material (docs/sources.md, HOOD)."""
        return cls(0.20022, 23600.0, 44400.0, 3.9625778e-05)

    @classmethod
    def at(cls, positions: Float[Tensor, "4"]) -> PhysMaterial:
        """The material at ``positions`` within :data:`RANGES`; undoes :meth:`inputs`."""
        return cls(*material_numbers(positions.double()).tolist())

    @classmethod
    def sampled(cls, generator: torch.Generator) -> PhysMaterial:
        """One of the materials that HOOD trains on: μ and k log-uniform in their ranges, λ and ρ uniform."""
        shares = torch.rand(4, generator=generator, dtype=torch.float64, device=generator.device)
        density = RANGES["areal_density"]._replace(is_logarithmic=False).value(shares[0])
        return cls.at(shares)._replace(areal_density=float(density))

    def inputs(self) -> Float[Tensor, "4"]:
        """The positions of the numbers within :data:`RANGES`, in float64: what a network sees."""
        numbers = torch.tensor(self, dtype=torch.float64)
        return torch.stack([RANGES[name].position(number) for name, number in zip(self._fields, numbers, strict=True)])

    def terms(self, num_meshes: int | None = None) -> list[EnergyTerm]:
        """The energies of a cloth of this material; with its numbers in arrays, as of so many meshes, if they say."""
        numbers: Sequence[PerMesh] = self[1:]
        if num_meshes is not None:
            numbers = [torch.full((num_meshes,), number, dtype=torch.float64) for number in self[1:]]
        shear, lame, bending = numbers
        return [StVK(shear, lame, THICKNESS), Bending(bending)]


def material_numbers(positions: Float[Tensor, "... 4"]) -> Float[Tensor, "... 4"]:
    """The fields of :class:`PhysMaterial`, in order, at ``positions`` within :data:`RANGES`; differentiable."""
    parts = zip(PhysMaterial._fields, positions.unbind(-1), strict=True)
    return torch.stack([RANGES[name].value(position) for name, position in parts], -1)
