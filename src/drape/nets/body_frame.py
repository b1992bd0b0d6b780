"""Messages from a body, seen in the frame of the face that sends them."""

from __future__ import annotations

import math
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.utils.parametrizations import orthogonal


class BodyFrameMessages(nn.Module):
    """``R Mᵀ Rᵀ f(R M Rᵀ m)``: into the frame M of the sender, a perceptron f, and back (LayersNet).

    Each of the heads has an f of its own.
    R (``size 3``) lifts a rotation of space to one of features. Its columns are orthonormal exactly, by construction,
    so LayersNet's soft penalty on RᵀR - I is not needed. With ``m = R v`` the map is equivariant: turn v and the
    frames, and the result turns with them. Only three numbers of a message pass, those along the columns of R.
    """

    def __init__(self, heads: int, size: int):
        super().__init__()
        self.lift = cast("nn.Linear", orthogonal(nn.Linear(3, size, bias=False)))
        self.first = _HeadwiseLinear(heads, size)
        self.second = _HeadwiseLinear(heads, size)

    def forward(
        self, messages: Float[Tensor, "edges heads size"], frames: Float[Tensor, "edges 3 3"]
    ) -> Float[Tensor, "edges heads size"]:
        """``frames``: the axes of the sender (tangent, tangent, normal), one in each row."""
        lift = self.lift.weight
        inside = (messages @ lift) @ frames.mT @ lift.T
        seen = self.second(nn.functional.silu(self.first(inside)))
        return (seen @ lift) @ frames @ lift.T


class _HeadwiseLinear(nn.Module):
    """A linear layer of its own for each of the heads."""

    def __init__(self, heads: int, size: int):
        super().__init__()
        bound = 1.0 / math.sqrt(size)
        self.weight = nn.Parameter(torch.empty(heads, size, size).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(heads, size).uniform_(-bound, bound))

    def forward(self, x: Float[Tensor, "edges heads size"]) -> Float[Tensor, "edges heads size"]:
        return (x.transpose(0, 1) @ self.weight).transpose(0, 1) + self.bias
