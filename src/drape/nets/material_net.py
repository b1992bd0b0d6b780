"""EST: a small network that says which material of PHYS behaves most like a fabric."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.nets.mlp import feed_forward
from drape.scene.material import ATTRIBUTES

WIDTH = 64
"""Of the hidden layers (paper, appendix)."""


class MaterialNet(nn.Module):
    """``(m, μ, λ, k) = F(m̂, a)`` of the paper: three layers, from the scaled attributes of a fabric, mass included.

    The outputs are the positions from 0 to 1 of the four numbers within HOOD's ranges; activations are SiLU, as in
    the other networks (the paper names none).
    """

    def __init__(self) -> None:
        super().__init__()
        self.layers = feed_forward([len(ATTRIBUTES), WIDTH, WIDTH, 4])

    def forward(self, attributes: Float[Tensor, "fabrics attributes"]) -> Float[Tensor, "fabrics 4"]:
        """Positions in float64; the layers work in the precision of their parameters."""
        features = attributes.to(next(self.layers.parameters()).dtype)
        return torch.sigmoid(self.layers(features).double())
