"""At which of three frames the forces of a fabric act: what a recorder with steps between its frames does."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.law.deformation import Deformation
from drape.energy.law.quadratic import FabricCoefficients

SHARE = 0.16
"""Of a force that acts as it was at t-1, and as it will be at t+1, before anything is learned: many steps a frame."""


class Timing(nn.Module):
    """Weights w₋, w₀, w₊ of the forces at t-1, t and t+1 in the equation of motion of recorded frames.

    A recorder that takes q steps between two frames gives

        m (x(t+1) - 2 x(t) + x(t-1)) / dt² = w₋ f(t-1) + w₀ f(t) + w₊ f(t+1),   w₋ + w₀ + w₊ = 1,

    for forces that change evenly between frames. Steps that take the force at their end (backward Euler) have
    ``w₊ = (q+1)(q+2)/(6q²)``, ``w₋ = (q-1)(q-2)/(6q²)``; those that take it at their start have
    ``w₊ = w₋ = (q²-1)/(6q²)``. Blender solves one linear system a step: its springs are between the two, its hinges
    have the force at the start. So each feature of the deformation has two weights of its own for each fabric, learned.

    Args:
        deformation: what the elastic units see of an edge; its features have weights of their own.
        width: of the network.
    """

    def __init__(self, deformation: Deformation, width: int):
        super().__init__()
        self.features = deformation.size
        self.shares = FabricCoefficients(2 * self.features, width, start=SHARE)

    def forward(self, attributes: Float[Tensor, "edges attributes"]) -> Float[Tensor, "3 edges features"]:
        """The weights at t-1, t and t+1."""
        before, after = self.shares(attributes).double().unflatten(-1, (2, self.features)).unbind(-2)
        return torch.stack([before, 1.0 - before - after, after])
