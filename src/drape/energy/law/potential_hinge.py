"""Potential units of edges and hinges that are zero at rest, never negative, and the same on both sides of a fabric."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.deformation import Deformation, Stretch, StretchHinge
from drape.energy.law.quadratic import LearnedCoefficients
from drape.energy.law.units import PotentialUnits
from drape.errors import DrapeError


class HingePotential(PotentialUnits):
    """``φp = energy_scale · Σ_k c_k(asinh z_1, ln(1 + z_2²), a)² z_k²``, z = (Δl/stretch_scale, Δθ/angle_scale).

    Near rest these are a spring and a hinge, ½kΔl² + ½bΔθ²; the coefficients say how the law departs from that as the
    edge deforms. φp does not change with the sign of Δθ: a fabric has no preferred side, and turning all faces of a
    mesh over changes nothing. Zero at rest and never negative, whatever the network says.

    Args:
        deformation: what the units see of an edge: (Δl, Δθ), or Δl alone.
        width: of the networks.
        stretch_scale: typical |Δl| [m].
        angle_scale: typical |Δθ| [rad].
        energy_scale: [J].

    Raises:
        DrapeError: another deformation.
    """

    def __init__(
        self, deformation: Deformation, width: int, stretch_scale: float, angle_scale: float, energy_scale: float
    ):
        super().__init__(deformation)
        if not isinstance(deformation, Stretch | StretchHinge):
            raise DrapeError(
                "model.potential: hinge units see the stretch and the hinge of an edge; found "
                f"{type(deformation).__name__}, expected model/deformation=stretch_hinge or stretch"
            )
        size = deformation.size
        self.coefficients = LearnedCoefficients(size, size, width, start=1.0)
        self.scales = (stretch_scale, angle_scale)[:size]
        self.energy_scale = energy_scale

    def energies(
        self, inputs: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        # filled in on the device: numbers copied there from here would be waited for
        z = inputs / torch.cat([inputs.new_full((1,), scale) for scale in self.scales])
        seen = torch.cat([torch.asinh(z[:, :1]), torch.log1p(z[:, 1:].square())], -1)
        return 0.5 * (self.stiffness(seen, attributes) * z.square()).sum(-1)

    def stiffness(
        self, seen: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, "edges inputs"]:
        """``2 energy_scale c²`` [J] where (asinh z_1, ln(1 + z_2²)) are ``seen``."""
        return 2.0 * self.energy_scale * self.coefficients(seen, attributes).double().square()
