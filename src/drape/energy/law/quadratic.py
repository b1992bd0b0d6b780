"""Coefficients of quadratic energies that are learned: the well-conditioned skeleton of energy units."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.nets.mlp import feed_forward
from drape.scene.material import ATTRIBUTES


class FabricCoefficients(nn.Module):
    """Coefficients that depend on the fabric alone, by a network of two hidden layers of ``4 √a``.

    Stiffnesses of fabrics span two decades, and coefficients are square roots of them: in
    √a soft fabrics lie as far apart as stiff ones, and the main coefficient is nearly linear.
    """

    def __init__(self, size_out: int, width: int, start: float):
        super().__init__()
        self.layers = feed_forward([len(ATTRIBUTES), width, width, size_out])
        *_, bias = self.layers.parameters()
        nn.init.constant_(bias, start)

    def forward(self, attributes: Float[Tensor, "edges attributes"]) -> Float[Tensor, "edges out"]:
        """Coefficients of each edge."""
        return self.layers(4.0 * attributes.to(next(self.layers.parameters()).dtype).sqrt())


class LearnedCoefficients(nn.Module):
    """``c(z, a) = base(a) + bent(z, a)``: coefficients of a fabric, and how they change with the deformation.

    ``base`` sees the fabric alone. It carries almost everything and is learned in a few hundred steps, since the
    heavy-tailed deformation does not reach it; ``bent`` starts at zero and departs from it where the data ask for it.
    As a correction ``bent`` needs no more than two hidden layers, and training on forces differentiates it twice,
    which is what a step costs.
    """

    def __init__(self, size_in: int, size_out: int, width: int, start: float):
        super().__init__()
        self.base = FabricCoefficients(size_out, width, start)
        self.bent = feed_forward([size_in + len(ATTRIBUTES), width, width, size_out])
        *_, weight, bias = self.bent.parameters()
        nn.init.zeros_(weight)
        nn.init.zeros_(bias)

    def forward(
        self, z: Float[Tensor, "edges size"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, "edges out"]:
        """Coefficients of each edge."""
        seen = torch.cat([z, attributes], -1).to(next(self.bent.parameters()).dtype)
        return self.base(attributes) + self.bent(seen)

