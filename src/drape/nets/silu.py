"""The activation of all networks, ``x/(1 + exp(-x))``, twice differentiable at low cost: forces train through that."""

from __future__ import annotations

import torch
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
