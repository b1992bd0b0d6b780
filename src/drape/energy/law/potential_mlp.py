"""The paper's potential units: a plain network of the deformation of an edge."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.deformation import Deformation
from drape.energy.law.units import PotentialUnits
from drape.nets.mlp import EnergyNet
from drape.scene.material import ATTRIBUTES


class MLPPotential(PotentialUnits):
    """``φp = energy_scale · net(Δl / stretch_scale, cos and sin of Δα and Δβ, a)`` (paper, eq. 2).

    The sign and the value at rest are free: only differences are trained.

    Args:
        deformation: what the units see of an edge.
        net: makes the network from its numbers of inputs and outputs.
        stretch_scale: standard deviation of Δl in the training data [m].
        energy_scale: [J].
    """

    def __init__(
        self, deformation: Deformation, net: Callable[..., EnergyNet], stretch_scale: float, energy_scale: float
    ):
        super().__init__(deformation)
        self.net = net(deformation.size + len(ATTRIBUTES), 1)
        self.stretch_scale = stretch_scale
        self.energy_scale = energy_scale

    def energies(
        self, inputs: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        scaled = torch.cat([inputs[:, :1] / self.stretch_scale, inputs[:, 1:], attributes], -1)
        return self.energy_scale * self.net(scaled)[:, 0].double()
