"""Dissipation units of edges that are damped along themselves and of vertices that the air slows."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.quadratic import FabricCoefficients
from drape.energy.law.units import DissipationUnits
from drape.geometry.edge_geometry import EdgeGeometry


class Damping(DissipationUnits):
    """``φd = energy_scale · Σ_k c_k(a) q_k`` of each edge; ``lost = energy_scale · Σ_k b_k(a) q_k``.

    ``q_1 = ((e' - e)·y / stretch_scale)²`` is an axial damper, with the edge e, its direction y at t and e' at t + dt;
    ``q_2 = (|Δx_i|²/n_i + |Δx_j|²/n_j) / (speed_scale dt)²`` the drag of the air on its two ends, of which n edges
    share each, so that all vertices have the same drag, as in Blender. Both are properties of a fabric: what belongs
    to the sampling of frames is in :class:`drape.energy.law.timing.Timing`.

    The energy that a step loses is not that whose gradient is the force: a drag ``c v`` derives from ``½ c v² dt`` but
    takes ``c v² dt`` from the motion, and a simulation damps what its steps are too long for. So the two have
    coefficients of their own.
    """

    def __init__(self, width: int, stretch_scale: float, speed_scale: float, energy_scale: float):
        super().__init__()
        self.coefficients = FabricCoefficients(2, width, start=0.0)
        self.lost = FabricCoefficients(2, width, start=0.0)
        self.stretch_scale = stretch_scale
        self.speed_scale = speed_scale
        self.energy_scale = energy_scale

    def inputs(
        self, geometry: EdgeGeometry, previous: EdgeGeometry, dt: float
    ) -> Float[Tensor, "... edges inputs"]:
        rate = ((geometry.vectors - previous.vectors) * previous.direction).sum(-1) / self.stretch_scale
        edges = geometry.mesh.edges
        ends = edges.reshape(-1)
        shared = geometry.x.new_zeros(geometry.x.shape[-2]).index_add(0, ends, geometry.x.new_ones(len(ends)))
        moved = (geometry.x - previous.x).square().sum(-1) / (self.speed_scale * dt) ** 2 / shared.clamp(min=1.0)
        return torch.stack([rate, moved[..., edges[:, 0]] + moved[..., edges[:, 1]]], -2).mT

    def energies(
        self, inputs: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        quantities = torch.stack([inputs[:, 0].square(), inputs[:, 1]], -1)
        potential = (self.coefficients(attributes).double() * quantities).sum(-1)
        lost = (self.lost(attributes).double() * quantities).sum(-1)
        return self.energy_scale * potential, self.energy_scale * lost

    def constants(self, attributes: Float[Tensor, " attributes"], dt: float) -> tuple[float, float]:
        """The axial damper of an edge and the drag on a vertex [kg/s], learned from steps of ``dt`` [s]."""
        axial, air = self.coefficients(attributes[None])[0].double().tolist()
        return (
            2.0 * self.energy_scale * axial * dt / self.stretch_scale**2,
            2.0 * self.energy_scale * air / (self.speed_scale**2 * dt),
        )
