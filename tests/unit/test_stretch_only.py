"""A law without its bending: what it keeps of the law, and that a cloth with it does not feel a fold."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from drape.energy.law.edge_law import StretchOnly
from drape.energy.step import Step
from drape.energy.terms.elastic import ElasticEnergy
from drape.geometry.grid import square_grid
from tests.terms import law, make_step

ATTRIBUTES = torch.linspace(0.1, 0.9, 5, dtype=torch.float64).expand(40, -1)


def deformations() -> Tensor:
    torch.manual_seed(0)
    return torch.randn(40, 3, dtype=torch.float64) * torch.tensor([0.02, 1.0, 1.0])


def folded(step: Step, angle: float) -> Tensor:
    """The flat cloth, one half of it turned about its middle line of vertices, which are edges of the mesh."""
    x = step.mesh.rest_positions.clone()
    right = x[:, 0] > 0
    x[right, 2] = math.sin(angle) * x[right, 0]
    x[right, 0] *= math.cos(angle)
    return x


@pytest.fixture
def flat() -> Step:
    """A square of 5 x 5 vertices around the origin: the column in the middle is the hinge."""
    step, _ = make_step(square_grid(1.0, 5))
    assert (step.mesh.rest_positions[:, 0].abs() < 1e-9).sum() == 5
    return replace(step, obstacle=None)


def test_energy_is_that_of_the_law_at_zero_angles():
    full, q = law(), deformations()
    alone = q * torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    found = StretchOnly(full).potential(q, ATTRIBUTES)
    torch.testing.assert_close(found, full.potential(alone, ATTRIBUTES))
    assert (found - full.potential(q, ATTRIBUTES)).abs().max() > 1e-3, "the angles must matter to the law"


def test_slopes_are_along_the_stretch_alone():
    """∂φp/∂Δl and ∂²φp/∂Δl² of the law at zero angles, and nothing else: to the last bit."""
    full, q = law(), deformations()
    alone = q * torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    found, true = (
        each.potential_slopes(at, ATTRIBUTES, hessian=True) for each, at in ((StretchOnly(full), q), (full, alone))
    )
    assert found.gradient[:, 0].abs().min() > 0.0
    torch.testing.assert_close(found.gradient[:, 0], true.gradient[:, 0])
    torch.testing.assert_close(found.hessian[:, 0, 0], true.hessian[:, 0, 0])
    assert not found.gradient[:, 1:].any()
    assert not found.hessian[:, 1:].any()
    assert not found.hessian[:, :, 1:].any()
    assert StretchOnly(full).potential_slopes(q, ATTRIBUTES, hessian=False).hessian is None


def test_what_is_not_potential_stays():
    full = law()
    kept, speed = StretchOnly(full), torch.rand(40, dtype=torch.float64)
    assert (kept.face_area, kept.dt, kept.dissipates) == (full.face_area, full.dt, full.dissipates)
    assert full.bends
    assert not kept.bends
    torch.testing.assert_close(kept.drag(speed, ATTRIBUTES), full.drag(speed, ATTRIBUTES))
    for one, other in zip(kept.drag_slopes(speed, ATTRIBUTES), full.drag_slopes(speed, ATTRIBUTES), strict=True):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize("transfer", [False, True])
def test_a_fold_costs_nothing(flat: Step, transfer: bool):
    """Turned about its middle, no edge changes its length: energy and forces of the flat cloth, of the law others."""
    alone, full = (ElasticEnergy(each, transfer=transfer) for each in (StretchOnly(law()), law()))
    energy, gradient = alone.energy_and_gradient(folded(flat, 0.0), flat)
    bending = full.energy_and_gradient(folded(flat, 0.0), flat)[0]
    for angle in (0.5, 1.5, 3.0):
        x = folded(flat, angle)
        found, slope = alone.energy_and_gradient(x, flat)
        torch.testing.assert_close(found, energy, rtol=1e-9, atol=1e-12)
        assert slope.abs().max() < 1e-6
        assert gradient.abs().max() < 1e-6
        assert full.energy_and_gradient(x, flat)[0] > bending + 1e-3


def test_a_stretch_costs_what_it_costs_flat(flat: Step):
    """Stretched and not bent, a cloth has the energy of the whole law, its forces in the plane, and no others."""
    x = flat.mesh.rest_positions * torch.tensor([1.05, 1.0, 1.0], dtype=torch.float64)
    alone, full = (
        ElasticEnergy(each, transfer=False).energy_and_gradient(x, flat) for each in (StretchOnly(law()), law())
    )
    assert alone[0] > 1e-3
    torch.testing.assert_close(alone[0], full[0])
    torch.testing.assert_close(alone[1][:, :2], full[1][:, :2], rtol=1e-6, atol=1e-8)
    assert not alone[1][:, 2].any()


def test_gradient_and_stencils_of_a_cloth(flat: Step):
    """The forces are the slope of the energy; there are stencils of edges only, none of hinges."""
    term, (_, x) = ElasticEnergy(StretchOnly(law()), transfer=False), make_step(square_grid(1.0, 5))
    moved = x.clone().requires_grad_()
    (expected,) = torch.autograd.grad(term(moved, flat).sum(), moved)
    torch.testing.assert_close(term.energy_and_gradient(x, flat)[1], expected)
    assert [piece.vertices.shape[1] for piece in term.stencils(x, flat)] == [2]
