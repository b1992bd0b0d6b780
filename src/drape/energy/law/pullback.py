"""Carry the slopes of energies in their inputs back to forces on vertices."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def _laid_out_as(pattern: Tensor, values: Tensor) -> Tensor:
    """A copy of ``values`` in the order in memory of ``pattern``, which the geometry is fastest in."""
    return torch.empty_like(pattern.detach()).copy_(values.detach())


class _Pullback(torch.autograd.Function):
    @staticmethod
    def forward(ctx, x, count, *inputs_and_slopes):
        inputs, slopes = inputs_and_slopes[:count], inputs_and_slopes[count:]
        with torch.enable_grad():
            slopes = [_laid_out_as(one, slope).requires_grad_() for one, slope in zip(inputs, slopes, strict=True)]
            (pulled,) = torch.autograd.grad(inputs, x, slopes, create_graph=True)
        ctx.pulled, ctx.slopes = pulled, slopes
        return pulled.detach()

    @staticmethod
    def backward(ctx, cotangent):
        pushed = torch.autograd.grad(ctx.pulled, ctx.slopes, _laid_out_as(ctx.pulled, cotangent))
        return None, None, *(None for _ in pushed), *pushed


def pullback(inputs: Sequence[Tensor], x: Tensor, slopes: Sequence[Tensor]) -> Tensor:
    """``Σ_k (∂inputs_k/∂x)ᵀ slopes_k``, the gradient of an energy in ``x`` from its slopes in its inputs.

    Differentiable in ``slopes`` only: the geometry has no parameters, so differentiating it twice more in ``x``, as
    ``create_graph=True`` alone would, is work that training never uses. ``inputs`` carry their graph to ``x``.
    """
    return _Pullback.apply(x, len(inputs), *inputs, *slopes)
