"""What holds for every law of an edge as the paper's networks see it: length, twist and bend."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import pytest
import torch

from drape.energy.law.edge_law import NetworkLaw, StretchOnly
from drape.energy.law.load_law import load_law
from drape.energy.law.scaled_law import ScaledEdges
from drape.energy.terms.dissipation import Dissipation
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.scene.material import Material
from tests.energies import PAPER, make_energy, write_checkpoint
from tests.terms import make_step

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
ATTRIBUTE_VECTOR = torch.tensor([0.02, 0.01, 0.05, 0.0, 0.0], dtype=torch.float64)
LAWS = ["settled", "mlp", "stretch", "settled_alone", "light"]
STATIONARY = ["settled", "stretch", "settled_alone", "light"]


@pytest.fixture(scope="module")
def laws():
    """Every kind of law, random but the same each time."""
    torch.manual_seed(1)
    made = {
        "settled": NetworkLaw(make_energy("settled", "speed"), 0.01, 1 / 30),
        "mlp": NetworkLaw(make_energy("mlp", "speed"), 0.01, 1 / 30),
        "stretch": NetworkLaw(make_energy("settled", "none", "stretch"), 0.01, 1 / 30),
    }
    made["settled_alone"] = StretchOnly(made["settled"])
    made["light"] = ScaledEdges(made["settled"], 0.2)
    return {name: copy.deepcopy(law).double().requires_grad_(False) for name, law in made.items()}


def attributes(count: int) -> torch.Tensor:
    return ATTRIBUTE_VECTOR.expand(count, -1)


def deformations(count: int = 12) -> torch.Tensor:
    """Stretched and bent edges, some of them far out or more than a turn."""
    q = torch.randn(count, 3, dtype=torch.float64) * torch.tensor([0.05, 1.0, 1.0])
    q[0, 0], q[1, 0], q[2, 1], q[3, 2] = 1.3, -0.7, 4.0, -7.5
    return q


@pytest.mark.parametrize("name", LAWS)
def test_derivatives(laws, name):
    """Energy, gradient and Hessian in q, drag and its slope in the speed, by finite differences."""
    law, q = laws[name], deformations()
    assert torch.autograd.gradcheck(lambda q: law.potential(q, attributes(len(q))), q.clone().requires_grad_())
    slopes = law.potential_slopes(q, attributes(len(q)), hessian=True)
    assert slopes.hessian.abs().max() > 1e-3
    h = 1e-6
    for k in range(3):
        step = torch.zeros(3, dtype=torch.float64)
        step[k] = h
        up, down = (law.potential_slopes(q + sign * step, attributes(len(q)), hessian=False) for sign in (1, -1))
        size = slopes.hessian[:, k].abs().max()
        assert ((up.gradient - down.gradient) / (2 * h) - slopes.hessian[:, k]).abs().max() < 1e-5 * size + 1e-7
    speed = torch.rand(12, dtype=torch.float64) * 25.0
    assert not law.dissipates or torch.autograd.gradcheck(lambda s: law.drag(s, attributes(12)), speed.requires_grad_())


@pytest.mark.parametrize("name", LAWS)
def test_slopes_are_the_gradient_of_the_potential(laws, name):
    """The analytic way gives what autograd gives, in any order of the edges and for one edge alone."""
    law, q = laws[name], deformations().requires_grad_()
    energy = law.potential(q, attributes(len(q)))
    (gradient,) = torch.autograd.grad(energy.sum(), q)
    slopes = law.potential_slopes(q, attributes(len(q)), hessian=True)
    torch.testing.assert_close(slopes.energy, energy.detach())
    torch.testing.assert_close(slopes.gradient, gradient)
    torch.testing.assert_close(slopes.hessian, slopes.hessian.mT)
    many = law.potential_slopes(q.detach().repeat(50, 1), attributes(50 * len(q)), hessian=True)
    for part, together in zip(many, slopes, strict=True):
        torch.testing.assert_close(part[-len(q) :], together, rtol=1e-7, atol=1e-9)
    for k in range(len(q)):
        one = law.potential_slopes(q[k : k + 1], attributes(1), hessian=True)
        for single, together in zip(one, slopes, strict=True):
            torch.testing.assert_close(single, together[k : k + 1], rtol=1e-7, atol=1e-9)
    if law.dissipates:
        speed = torch.rand(5, dtype=torch.float64).requires_grad_()
        drag = law.drag(speed, attributes(5))
        expected = drag, *torch.autograd.grad(drag.sum(), speed)
        for found, true in zip(law.drag_slopes(speed, attributes(5)), expected, strict=True):
            torch.testing.assert_close(found, true.detach())
            assert found.abs().min() > 0


@pytest.mark.parametrize("name", LAWS)
def test_a_mirror_image_stores_the_same(laws, name):
    q = deformations(200)
    twisted = q * torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64)
    energy = laws[name].potential(q, attributes(200))
    torch.testing.assert_close(laws[name].potential(twisted, attributes(200)), energy, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("dt", [1 / 60, 1 / 10])
def test_a_sheet_in_the_air_loses_energy_as_long_as_it_moves(laws, dt):
    """``dt/dt_law · 3 A φd(u)``: a sheet of A = 4 m² at 1.3 m/s, each of whose faces counts at its three edges."""
    law, u = laws["settled"], torch.tensor([0.3, -0.4, 1.2], dtype=torch.float64)
    step, _ = make_step(square_grid(2.0, 5))
    step = replace(step, x=step.mesh.rest_positions, dt=dt)
    density = float(law.drag(torch.tensor([1.3]).double(), step.attributes))
    assert density > 1e-4
    term, x_next = Dissipation(law), step.x + dt * u
    for energy in (term(x_next, step), term.energy_and_gradient(x_next, step)[0]):
        assert energy.item() == pytest.approx(dt * 30 * 3 * 4.0 * density, rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_finite_at_extremes(laws, name, dtype):
    """Ten metres of stretch, many turns, a bullet's speed: numbers, of the precision that was asked for."""
    law = copy.deepcopy(laws[name]).to(dtype)
    q = torch.cartesian_prod(*[torch.tensor(v, dtype=dtype) for v in ([-10, 0, 10.0], [-9, 0, math.pi], [0, 50.0])])
    slopes = law.potential_slopes(q, attributes(len(q)).to(dtype), hessian=True)
    speed = torch.tensor([0.0, 1e-6, 1e4], dtype=dtype)
    drag = law.drag_slopes(speed, attributes(3).to(dtype)) if law.dissipates else ()
    for part in (*slopes, *drag):
        assert part.isfinite().all()
        assert part.dtype == dtype


@pytest.mark.parametrize("name", LAWS)
def test_single_precision_is_close(laws, name):
    """Law and deformation in float32 against float64: 0.1 % of the largest."""
    q = deformations(200)
    exact = laws[name].potential_slopes(q, attributes(200), hessian=True)
    rounded = copy.deepcopy(laws[name]).float().potential_slopes(q.float(), attributes(200).float(), hessian=True)
    for found, expected in zip(rounded, exact, strict=True):
        assert (found - expected).abs().amax() < 1e-3 * expected.abs().amax()


@pytest.mark.parametrize("name", STATIONARY)
def test_rest_costs_nothing(laws, name):
    """φp and its gradient vanish at rest and φp is positive around it."""
    q = torch.zeros(1, 3, dtype=torch.float64)
    slopes = laws[name].potential_slopes(q, attributes(1), hessian=True)
    assert slopes.energy.abs() < 1e-9
    assert (slopes.gradient.abs() < 1e-7 * slopes.hessian[0, 0, 0]).all()
    around = 1e-3 * torch.randn(500, 3, dtype=torch.float64)
    assert (laws[name].potential(around, attributes(500)) > 0).all()


def test_law_of_a_checkpoint(cloth_batch, tmp_path):
    """The fabric's vector in the checkpoint's scales, the area and the time that it was trained on; or a refusal."""
    energy = make_energy("mlp", "none").float()
    write_checkpoint(tmp_path / "last.ckpt", energy, PAPER, cloth_batch)
    law, vector = load_law(str(tmp_path / "last.ckpt"), SILK)
    assert isinstance(law, NetworkLaw)
    assert vector.tolist() == [0.5, 0.05, 0.015, 0.0, 0.0]
    assert law.face_area == pytest.approx(0.5 / 49)
    assert law.dt == pytest.approx(1 / 30)
    with pytest.raises(DrapeError, match="found a law of silk; expected one of denim"):
        load_law(str(tmp_path / "last.ckpt"), Material("denim", 40.0, 10.0, 25.0, 0.0, 1.0, 1.0))
