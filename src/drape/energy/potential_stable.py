"""Potential units that are zero at rest and never negative, whatever the network says."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.deformation import Deformation
from drape.energy.quadratic import LearnedCoefficients, squared_norm
from drape.energy.units import PotentialUnits


class StablePotential(PotentialUnits):
    """``φp = energy_scale · |L(asinh z, a)ᵀ z|²``, z = (Δl/stretch_scale, sin Δα, 1-cos Δα, sin Δβ, 1-cos Δβ).

    The lower-triangular L is ``base(a) + bent(asinh z, a)``: near rest the law is the quadratic form of the fabric, and
    the second network, which sees |Δl| over several decades through asinh, only has to learn how it departs from that.
    That φp is zero at rest and never negative is thermodynamics, not a choice of a material law.

    Args:
        deformation: what the units see of an edge.
        width: of the networks.
        stretch_scale: typical |Δl| [m].
        energy_scale: [J].
    """

    def __init__(self, deformation: Deformation, width: int, stretch_scale: float, energy_scale: float):
        super().__init__(deformation)
        size = deformation.size
        self.coefficients = LearnedCoefficients(size, size * (size + 1) // 2, width, start=1.0)
        self.stretch_scale = stretch_scale
        self.energy_scale = energy_scale

    def energies(
        self, inputs: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        stretch, cosines, sines = inputs[:, :1] / self.stretch_scale, inputs[:, 1::2], inputs[:, 2::2]
        z = torch.cat([stretch, sines, 1.0 - cosines], -1)
        lower = self.coefficients(torch.asinh(z), attributes)
        return self.energy_scale * squared_norm(lower.double(), z)
