"""Splines of a baked law: they go through their nodes, are smooth everywhere, constant far out, never negative."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from drape.energy.law.baked.spline_plane import SplinePlane

FIRST, STEP = (-4, 0), (0.5, 0.25)


def smooth(nodes: tuple[int, int] = (30, 26)) -> np.ndarray:
    """Two functions far from zero on the nodes."""
    u, v = (np.arange(count) / count for count in nodes)
    one = 3.0 + np.sin(6.0 * u)[:, None] * np.cos(5.0 * v)
    return np.stack([one, 2.0 + u[:, None] ** 2 - v])


def rough(nodes: tuple[int, int] = (9, 7)) -> np.ndarray:
    return np.random.default_rng(0).uniform(0.0, 1.0, (2, *nodes))


def at(plane: SplinePlane, u: Tensor, v: Tensor) -> Tensor:
    return torch.stack(plane(u, v))


def test_values_at_nodes():
    """Some nodes inside: exactly what was given there."""
    values = smooth()
    plane = SplinePlane(values, FIRST, STEP)
    i, j = torch.cartesian_prod(torch.arange(9, 21), torch.arange(9, 17)).unbind(1)
    found = at(plane, (FIRST[0] + i).double() * STEP[0], (FIRST[1] + j).double() * STEP[1])
    np.testing.assert_allclose(found.numpy(), values[:, i, j], atol=1e-5)


def test_between_nodes_it_is_the_function_that_was_sampled():
    """To the fourth power of the step, by a factor that is known for cubic splines."""
    plane = SplinePlane(smooth(), FIRST, STEP)
    i, j = 10.0 + 8.0 * torch.rand(2, 500, dtype=torch.float64)
    found = at(plane, (FIRST[0] + i) * STEP[0], (FIRST[1] + j) * STEP[1])
    u, v = i / 30, j / 26
    expected = torch.stack([3.0 + (6.0 * u).sin() * (5.0 * v).cos(), 2.0 + u**2 - v])
    assert (found - expected).abs().max() < 2e-5


def test_a_plane_stays_a_plane():
    """A straight line is a cubic spline: slopes are those of the line, curvatures zero."""
    i, j = np.meshgrid(np.arange(30), np.arange(26), indexing="ij")
    plane = SplinePlane(np.stack([2.0 + 0.3 * i + 0.5 * j, 60.0 - i - j]), FIRST, STEP)
    place = torch.tensor([[3.1], [3.3]], dtype=torch.float64)
    jacobian = torch.autograd.functional.jacobian(lambda p: at(plane, *p), place)[..., 0].view(2, 2)
    expected = torch.tensor([[0.3 / 0.5, 0.5 / 0.25], [-1.0 / 0.5, -1.0 / 0.25]], dtype=torch.float64)
    torch.testing.assert_close(jacobian, expected, rtol=1e-4, atol=0.0)


@pytest.mark.parametrize("axis", [0, 1])
def test_smooth_across_cells_and_ends(axis):
    """Values, slopes and curvatures have no jump between cells, at the ends, or where it is constant."""
    values = rough()
    plane = SplinePlane(values, FIRST, STEP)
    other = torch.rand(40, dtype=torch.float64) * 4.0 - 2.0
    for cell in range(-6, values.shape[1 + axis] + 6):
        edge, sides = STEP[axis] * (FIRST[axis] + cell), []
        for side in (-1e-9, 1e-9):
            place = torch.full_like(other, edge + side).requires_grad_()
            value = at(plane, *((place, other) if axis == 0 else (other, place)))
            (slope,) = torch.autograd.grad(value[0].sum(), place, create_graph=True)
            curve = torch.autograd.grad(slope.sum(), place)[0]
            sides.append((value.detach(), slope.detach(), curve))
        for one, two in zip(*sides, strict=True):
            torch.testing.assert_close(one, two, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("axis", [0, 1])
def test_slopes_and_curvatures_are_the_derivatives(axis):
    plane = SplinePlane(rough(), FIRST, STEP)
    place = torch.stack([torch.rand(30) * 6.0 - 3.0, torch.rand(30) * 2.5 - 0.5]).double().requires_grad_()
    assert torch.autograd.gradcheck(lambda p: at(plane, *p), place)
    assert torch.autograd.gradgradcheck(lambda p: at(plane, *p), place)


def test_constant_far_outside():
    """Two steps beyond the last node it is what it is at any distance; between, it is on its way there."""
    plane = SplinePlane(rough(), FIRST, STEP)
    u = torch.tensor([-2.0 - 1.01, -10.0, -1e9, 2.0 + 1.01, 10.0, 1e9], dtype=torch.float64)
    found = at(plane, u, torch.full_like(u, 0.6)).view(2, 2, 3)
    torch.testing.assert_close(found, found[:, :, :1].expand(2, 2, 3), rtol=1e-12, atol=1e-12)
    assert (found[:, 0] - found[:, 1]).abs().min() > 1e-3
    v = torch.tensor([-0.26 * 2, -9.0, -torch.inf, 1.5 + 0.26 * 2, 9.0, torch.inf], dtype=torch.float64)
    found = at(plane, torch.full_like(v, 0.6), v).view(2, 2, 3)
    torch.testing.assert_close(found, found[:, :, :1].expand(2, 2, 3), rtol=1e-12, atol=1e-12)


def test_never_negative():
    """Also where values jump from zero to a number and a spline through them would swing below."""
    values = np.zeros((2, 12, 12))
    values[0, 6:], values[1, :, 6:] = 5.0, 3.0
    plane = SplinePlane(values, (0, 0), (1.0, 1.0))
    u, v = torch.cartesian_prod(*[torch.linspace(-3.0, 14.0, 120, dtype=torch.float64)] * 2).unbind(1)
    found = at(plane, u, v)
    assert found.min() >= 0.0
    assert found.amax(1).tolist() == pytest.approx([5.0, 3.0], rel=0.3)


def test_what_is_not_a_number_stays_so_and_looks_nowhere_else():
    plane = SplinePlane(rough(), FIRST, STEP)
    u = torch.tensor([float("nan"), 0.3], dtype=torch.float64)
    for place in ((u, u.flip(0)), (u, torch.zeros_like(u)), (torch.zeros_like(u), u)):
        found = at(plane, *place)
        assert (found.isfinite() == torch.stack(place).isfinite().all(0)).all()


def test_precision_is_that_of_the_place():
    plane = SplinePlane(rough(), FIRST, STEP)
    u, v = torch.rand(2, 50, dtype=torch.float64)
    found = at(plane, u.float(), v.float())
    assert found.dtype == torch.float32
    torch.testing.assert_close(found.double(), at(plane, u, v), rtol=1e-5, atol=1e-5)
