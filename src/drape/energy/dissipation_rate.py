"""Dissipation units that also see how fast an edge deforms."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.deformation import Deformation
from drape.energy.dissipation_speed import SLOWEST
from drape.energy.quadratic import FabricCoefficients, LearnedCoefficients
from drape.energy.units import DissipationUnits
from drape.scene.geometry import EdgeGeometry, safe_norm


class RateDissipation(DissipationUnits):
    """``φd = energy_scale · Σ_k c_k q_k``, c = base(a) + bent(asinh z, a); ``lost = energy_scale · Σ_k b_k(a) q_k``.

    The q are the squares of the changes of z = (Δl/stretch_scale, sin and cos of Δα, Δβ) over the step (internal
    damping), the product of the change of length and the present Δl with the turn of the edge, ``Δl (l' - e'·d)``
    (which lets the tension at t act along the direction d that the edge had at t), and ``γ speed²`` in units of
    ``area_scale`` and ``speed_scale`` (air). All vanish at rest, so a cloth that does not move loses nothing.

    What a step loses is not the potential of its force: a drag ``c v`` has the potential ``½ c v² dt`` but takes
    ``c v² dt`` from the motion. So the two have coefficients of their own; the paper takes them for the same.

    The coefficients are free in sign. The trajectories are frames of a simulation with finer steps inside, and the
    second difference of positions is centred at t: seen as one implicit step to t+1, forces lag behind, which is a
    negative damping of the frame's own making (measured for silk: 71 % of the tension acts as it was at t).
    """

    def __init__(
        self,
        deformation: Deformation,
        width: int,
        stretch_scale: float,
        speed_scale: float,
        area_scale: float,
        energy_scale: float,
    ):
        super().__init__()
        size = deformation.size
        self.deformation = deformation
        self.coefficients = LearnedCoefficients(2 * size + 1, size + 2, width, start=0.0)
        self.lost = FabricCoefficients(size + 2, width, start=0.0)
        self.stretch_scale = stretch_scale
        self.speed_scale = speed_scale
        self.area_scale = area_scale
        self.energy_scale = energy_scale

    def inputs(
        self, geometry: EdgeGeometry, previous: EdgeGeometry, dt: float
    ) -> Float[Tensor, "... edges inputs"]:
        before = self.deformation(previous)
        change = self.deformation(geometry) - before
        turn = geometry.length - (geometry.vectors * previous.direction).sum(-1)
        speed = safe_norm((geometry.midpoint - previous.midpoint) / dt, SLOWEST)
        air = (speed / self.speed_scale).square() * geometry.area / self.area_scale
        motion = torch.stack([before[..., 0] * turn / self.stretch_scale**2, air, speed / self.speed_scale], -2)
        return torch.cat([before.mT, change.mT, motion], -2).mT

    def energies(
        self, inputs: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        size = self.deformation.size
        scale = inputs.new_tensor([self.stretch_scale] + [1.0] * (size - 1))
        before, change = inputs[:, :size] / scale, inputs[:, size : 2 * size] / scale
        turn, air, speed = inputs[:, 2 * size :].unbind(-1)
        seen = torch.cat([before, change, speed[:, None]], -1)
        quantities = torch.cat([change.square(), turn[:, None], air[:, None]], -1)
        potential = (self.coefficients(torch.asinh(seen), attributes).double() * quantities).sum(-1)
        lost = (self.lost(attributes).double() * quantities).sum(-1)
        return self.energy_scale * potential, self.energy_scale * lost

    def drag(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        """The last of the terms for an edge that is and stays at rest in itself; a negative coefficient counts as 0."""
        speed = speed / self.speed_scale
        seen = torch.cat([speed.new_zeros(len(speed), 2 * self.deformation.size), speed[:, None]], -1)
        coefficient = self.coefficients(torch.asinh(seen), attributes)[:, -1].double().clamp(min=0.0)
        return self.energy_scale / self.area_scale * coefficient * speed.square()
