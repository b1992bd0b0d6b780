"""The activation: the library's numbers, and its first and second derivatives."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from drape.nets.mlp import SiLU


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_it_is_the_librarys_twice_differentiated(dtype):
    """To rounding, over all sizes of numbers; values to the last bit."""
    found, weights = [], torch.randn(4000, 3, dtype=dtype)
    start = torch.cat([torch.linspace(-30, 30, 3997), torch.tensor([0.0, -1e4, 1e4])]).to(dtype)
    for activation in (SiLU(), nn.SiLU()):
        x = start.clone().requires_grad_()
        y = activation(x)
        (slope,) = torch.autograd.grad((weights[:, 0] * y).sum(), x, create_graph=True)
        (second,) = torch.autograd.grad((weights[:, 1] * slope.square()).sum() + (weights[:, 2] * y).sum(), x)
        found.append((y, slope, second))
    assert torch.equal(found[0][0], found[1][0])
    size = 1e-5 if dtype == torch.float32 else 1e-12
    for one, other in zip(found[0][1:], found[1][1:], strict=True):
        assert one.isfinite().all()
        torch.testing.assert_close(one, other, rtol=size, atol=size)


def test_derivatives():
    x = torch.randn(20, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(SiLU(), x)
    assert torch.autograd.gradgradcheck(SiLU(), x)
    with torch.no_grad():
        assert not SiLU()(x).requires_grad
