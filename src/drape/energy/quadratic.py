"""Quadratic forms whose coefficients are learned: the well-conditioned skeleton of the stable energy units."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.nets.mlp import EnergyNet, feed_forward
from drape.scene.material import ATTRIBUTES

BASE_WIDTH = 64


class LearnedCoefficients(nn.Module):
    """``c(z, a) = base(a) + net(z, a)``: coefficients of a fabric, and how they change with the deformation.

    ``base`` is a small network of the fabric alone. It carries almost everything and is learned in a few hundred
    steps, since it does not see the heavy-tailed deformation; ``net`` starts at zero and bends the law where the data
    ask for it.
    """

    def __init__(self, net: Callable[..., EnergyNet], size_in: int, size_out: int, start: float):
        super().__init__()
        self.net = net(size_in + len(ATTRIBUTES), size_out)
        self.base = feed_forward([len(ATTRIBUTES), BASE_WIDTH, BASE_WIDTH, size_out])
        nn.init.zeros_(self.net.head[-1].weight)
        nn.init.zeros_(self.net.head[-1].bias)
        nn.init.constant_(self.base[-1].bias, start)

    def forward(
        self, z: Float[Tensor, "edges size"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, "edges out"]:
        """Coefficients of each edge."""
        base = self.base(attributes.to(self.net.norm.weight.dtype))
        return base + self.net(torch.cat([z, attributes], -1))


def squared_norm(
    lower: Float[Tensor, "edges entries"], z: Float[Tensor, "edges size"]
) -> Float[Tensor, " edges"]:
    """``|Lᵀ z|²`` with the lower-triangular L given by its entries, row by row: never negative, zero at ``z = 0``."""
    size = z.shape[-1]
    rows, columns = torch.tril_indices(size, size, device=z.device)
    full = lower.new_zeros(*lower.shape[:-1], size * size).index_copy(-1, rows * size + columns, lower)
    return (full.unflatten(-1, (size, size)) * z[..., :, None]).sum(-2).square().sum(-1)
