"""Multi-layer perceptrons in the shapes that EUNet uses, and their activation."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.autograd.function import once_differentiable


class SiLU(nn.Module):
    """``y = x s`` with ``s = 1/(1 + exp(-x))``; the library derives the second derivative, in twice as many passes."""

    def forward(self, x: Tensor) -> Tensor:
        return _Value.apply(x) if x.requires_grad and torch.is_grad_enabled() else nn.functional.silu(x)


class _Value(torch.autograd.Function):
    @staticmethod
    def forward(ctx, x):
        ctx.save_for_backward(x)
        return nn.functional.silu(x)

    @staticmethod
    def backward(ctx, cotangent):
        return _Slope.apply(cotangent, *ctx.saved_tensors)


class _Slope(torch.autograd.Function):
    """``cotangent · y'``, y' = s (1 + x (1 - s))."""

    @staticmethod
    def forward(ctx, cotangent, x):
        ctx.save_for_backward(cotangent, x)
        return torch.ops.aten.silu_backward(cotangent, x)

    @staticmethod
    @once_differentiable
    def backward(ctx, outer):
        """Also ``outer · cotangent · y''``, y'' = s (1 - s) (2 + x (1 - 2 s))."""
        cotangent, x = ctx.saved_tensors
        s = torch.sigmoid(x)
        second = s.mul(-2.0).add_(1.0).mul_(x).add_(2.0).mul_(s).mul_(s.neg_().add_(1.0)).mul_(cotangent).mul_(outer)
        return torch.ops.aten.silu_backward(outer, x), second


def feed_forward(sizes: Sequence[int], *, bias: bool = True, last_activation: bool = False) -> nn.Sequential:
    """Linear layers of the given sizes with SiLU between them, and after the last one if asked."""
    layers: list[nn.Module] = []
    for size_in, size_out in zip(sizes[:-1], sizes[1:], strict=True):
        layers += [nn.Linear(size_in, size_out, bias=bias), SiLU()]
    return nn.Sequential(*(layers if last_activation else layers[:-1]))


class ResidualBlock(nn.Module):
    """Pre-norm residual block: ``e + FFN(LayerNorm(e))``, each fully connected layer followed by SiLU."""

    def __init__(self, width: int, layers: int):
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.layers = feed_forward([width] * (layers + 1), last_activation=True)

    def forward(self, e: Float[Tensor, "... width"]) -> Float[Tensor, "... width"]:
        return e + self.layers(self.norm(e))


class EnergyNet(nn.Module):
    """EUNet's network: encoder of three layers, residual blocks, LayerNorm, decoder of three layers that narrow.

    Paper, section 4.1: four blocks of two fully connected layers, width 128; activations, encoder and decoder from the
    official configuration (docs/sources.md), whose blocks have three layers. ``bias=False`` leaves the biases out of
    encoder and decoder, as for the dissipation units.
    """

    def __init__(
        self, size_in: int, size_out: int = 1, *, width: int, blocks: int, layers_per_block: int, bias: bool = True
    ):
        super().__init__()
        self.encoder = feed_forward([size_in, width, width, width], bias=bias, last_activation=True)
        self.blocks = nn.Sequential(*(ResidualBlock(width, layers_per_block) for _ in range(blocks)))
        self.norm = nn.LayerNorm(width)
        self.decoder = feed_forward([width, width // 2, width // 4, size_out], bias=bias)

    def forward(self, features: Float[Tensor, "... size_in"]) -> Float[Tensor, "... size_out"]:
        """Cast to the precision of the parameters, then apply."""
        features = features.to(self.norm.weight.dtype)
        return self.decoder(self.norm(self.blocks(self.encoder(features))))
