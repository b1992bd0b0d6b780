"""The paper's dissipation units: energy lost to the air by a moving edge."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.units import DissipationUnits
from drape.geometry.edge_geometry import EdgeGeometry, safe_norm
from drape.nets.mlp import EnergyNet
from drape.scene.material import ATTRIBUTES

SLOWEST = 1e-6
"""Speeds are rounded off below this [m/s], to keep the derivative at rest finite."""


class SpeedDissipation(DissipationUnits):
    """``φd = γ · energy_scale · net(speed / speed_scale, a)²`` with γ the area at the edge (paper, eq. 3).

    ``speed`` is that of the edge's midpoint over the step [m/s]. The square keeps the lost energy from being negative
    (docs/sources.md, The official configuration of EUNet).

    Args:
        net: makes the network from its numbers of inputs and outputs; encoder and decoder get no biases.
        speed_scale: standard deviation of the speed in the training data [m/s].
        energy_scale: [J/m²].
        boundary_faces: how often the face at a boundary edge counts in γ: 1 in the paper, 2 in the official code.
    """

    def __init__(
        self, net: Callable[..., EnergyNet], speed_scale: float, energy_scale: float, boundary_faces: float = 1.0
    ):
        super().__init__()
        self.boundary_faces = boundary_faces
        self.net = net(1 + len(ATTRIBUTES), 1, bias=False)
        self.speed_scale = speed_scale
        self.energy_scale = energy_scale

    def inputs(
        self, geometry: EdgeGeometry, previous: EdgeGeometry, dt: float
    ) -> Float[Tensor, "... edges inputs"]:
        speed = safe_norm((geometry.midpoint - previous.midpoint) / dt, SLOWEST)
        area = geometry.area
        if self.boundary_faces != 1.0:
            area = torch.where(geometry.mesh.boundary, self.boundary_faces * area, area)
        return torch.stack([speed, area], -1)

    def energies(
        self, inputs: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        speed, area = inputs.unbind(-1)
        lost = area * self.drag(speed, attributes)
        return lost, lost

    def drag(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        seen = torch.cat([speed[:, None] / self.speed_scale, attributes], -1)
        return self.energy_scale * self.net(seen)[:, 0].double().square()
