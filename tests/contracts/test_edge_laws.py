"""What holds for every law of an edge: the networks', and the table that is baked from them."""

from __future__ import annotations

import copy
import json
import math

import numpy as np
import pytest
import torch

from drape.data.windows import Window
from drape.energy.baked_file import read_baked, save_baked
from drape.energy.baking import Resolution, bake
from drape.energy.certificate import Bounds, Differences
from drape.energy.checkpoint import describe
from drape.energy.cubic_spline import SplineTable, coefficients
from drape.energy.edge_law import NetworkLaw
from drape.energy.load_law import load_baked, load_law
from drape.energy.stretch_only import StretchOnly
from drape.errors import DrapeError
from drape.scene.material import ATTRIBUTES, Material
from tests.energies import make_energy, make_window

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
ATTRIBUTE_VECTOR = torch.tensor([0.02, 0.01, 0.05, 0.0, 0.0], dtype=torch.float64)
RESOLUTION = Resolution((-1.0, 4.0), 0.25, 24, 20.0, 0.05)
LAWS = ["stable", "mlp", "baked", "baked_mlp", "stretch", "baked_stretch", "stable_alone", "table_alone"]
STATIONARY = ["stable", "baked", "stretch", "baked_stretch", "stable_alone", "table_alone"]
BAKED = [name for name in LAWS if name.startswith("baked")]
BOUNDS = Bounds(energy=1e-3, force=1e-2, rest_energy=2e-2, rest_force=5e-2)


@pytest.fixture(scope="module")
def laws():
    """Every kind of law, random but the same each time; the baked ones are of the network of the same name."""
    torch.manual_seed(1)
    made = {
        "stable": NetworkLaw(make_energy("stable", "rate"), 0.01, 1 / 30),
        "mlp": NetworkLaw(make_energy("mlp", "speed"), 0.01, 1 / 30),
        "stretch": NetworkLaw(make_energy("stable", "none", "stretch"), 0.01, 1 / 30),
    }
    for name, of in {"baked": "stable", "baked_mlp": "mlp", "baked_stretch": "stretch"}.items():
        made[name] = bake(made[of], ATTRIBUTE_VECTOR, RESOLUTION, fabric=SILK)
    made |= {"stable_alone": StretchOnly(made["stable"]), "table_alone": StretchOnly(made["baked"])}
    return {name: copy.deepcopy(law).double().requires_grad_(False) for name, law in made.items()}


def attributes(count: int) -> torch.Tensor:
    return ATTRIBUTE_VECTOR.expand(count, -1)


def deformations(count: int = 12) -> torch.Tensor:
    """Stretched and bent edges, some of them outside the table or more than a turn."""
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
    many = law.potential_slopes(q.detach().repeat(2000, 1), attributes(2000 * len(q)), hessian=True)
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
    """φp and its gradient vanish at rest and φp is positive around it; φd and its slope vanish at no speed."""
    q = torch.zeros(1, 3, dtype=torch.float64)
    slopes = laws[name].potential_slopes(q, attributes(1), hessian=True)
    assert slopes.energy.abs() < 1e-9
    assert (slopes.gradient.abs() < 1e-7 * slopes.hessian[0, 0, 0]).all()
    around = 1e-3 * torch.randn(500, 3, dtype=torch.float64)
    assert (laws[name].potential(around, attributes(500)) > 0).all()
    if laws[name].dissipates:
        assert laws[name].drag_slopes(torch.zeros(1, dtype=torch.float64), attributes(1)) == (0.0, 0.0)


@pytest.mark.parametrize("name", BAKED)
def test_rest_is_the_network_s(laws, name):
    """Energy, force and stiffness at rest: a table may round near rest, not at it."""
    network = {"baked": "stable", "baked_mlp": "mlp", "baked_stretch": "stretch"}[name]
    q = torch.zeros(1, 3, dtype=torch.float64)
    found, true = (laws[n].potential_slopes(q, attributes(1), hessian=True) for n in (name, network))
    torch.testing.assert_close(found.energy, true.energy, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(found.gradient, true.gradient, rtol=1e-5, atol=1e-6)
    # tables are stored in single precision: 6e-8 of some 0.1 J, over (0.25 * 0.01 m)²
    torch.testing.assert_close(found.hessian, true.hessian, rtol=1e-5, atol=5e-4)


@pytest.mark.parametrize("name", ["baked", "baked_stretch"])
def test_convex_and_smooth_outside(laws, name):
    """Beyond the table φp opens upwards in Δl, and its second derivatives have no jump, at the border or anywhere."""
    low, high = laws[name].certificate.stretch
    angles = 6.0 * torch.rand(4000, 2, dtype=torch.float64) - 3.0
    out = torch.cat([torch.linspace(high, 30 * high, 2000), torch.linspace(30 * low, low, 2000)]).double()
    outside = laws[name].potential_slopes(torch.cat([out[:, None], angles], 1), attributes(4000), hessian=True)
    assert (outside.hessian[:, 0, 0] >= 0).all()
    # even in asinh, and finer than the nodes, so that it crosses cells, the border and the end of the last cell
    scale = laws[name].stretch_scale
    u = torch.linspace(math.asinh(30 * low / scale), math.asinh(30 * high / scale), 200001, dtype=torch.float64)
    q = torch.stack([scale * u.sinh(), 0.4 + 0.01 * u, -1.0 + 0.3 * u], 1)
    hessian = laws[name].potential_slopes(q, attributes(len(q)), hessian=True).hessian
    jumps = (hessian[1:] - hessian[:-1]).abs() / (hessian[1:].abs() + hessian.abs().amax(0) * 1e-3 + 1e-9)
    assert jumps.max() < 2e-2


def test_table_is_smooth_across_cells_and_ends():
    """Derivatives up to the second of a rough table are continuous everywhere, and it is constant far out."""
    values = np.random.default_rng(0).normal(size=(6, 5, 5))
    table = SplineTable(torch.from_numpy(coefficients(values, (1, 2))), -2, 0.5)
    places = torch.rand(16, 3, dtype=torch.float64) * 4.0 - 2.0
    turns = 2.0 * math.pi / 5 * torch.arange(-6, 7).double()
    for axis, edges in enumerate((0.5 * torch.arange(-8, 10).double(), turns, turns)):
        for edge in edges:
            q = places.clone()
            sides = []
            for side in (-1e-9, 1e-9):
                q[:, axis] = edge + side
                sides.append(table(*q.unbind(-1), 3))
            for order, part in sides[0].items():
                torch.testing.assert_close(part, sides[1][order], rtol=1e-5, atol=1e-5)
    far = table(torch.tensor([-3.0, -50.0, 3.5, 50.0]).double(), *torch.full((2, 4), 0.3).double(), 2)
    assert far[1, 0, 0].abs().max() < 1e-5
    nodes = torch.cartesian_prod(0.5 * torch.arange(2).double(), *[2.0 * math.pi / 5 * torch.arange(5).double()] * 2)
    found = table(*nodes.unbind(-1), 1)[0, 0, 0]
    torch.testing.assert_close(found, torch.from_numpy(values[2:4]).flatten())


def test_drag_is_never_negative(laws):
    """Where the drag of a network sets in at some speed, the spline does not swing below zero before."""
    law = copy.deepcopy(laws["stable"])
    law.drag = lambda speed, attributes: (speed - 2.0).clamp(min=0.0) * speed**2
    baked = bake(law, ATTRIBUTE_VECTOR, RESOLUTION, fabric=SILK)
    assert baked.drag(torch.linspace(0.0, 30.0, 5001, dtype=torch.float64), attributes(5001)).min() >= 0
    assert baked.certificate.drag < 1e-3


@pytest.mark.parametrize("name", BAKED)
def test_certificate_is_true(laws, name):
    """Measured again on other samples, no error is twice what the certificate says; and it says little enough."""
    network = laws[{"baked": "stable", "baked_mlp": "mlp", "baked_stretch": "stretch"}[name]]
    law = copy.deepcopy(laws[name])
    certificate = law.certificate
    again = Differences(network, ATTRIBUTE_VECTOR, law, seed=5).measure(
        certificate.stretch, law.stretch_scale, certificate.speed
    )
    for key in ("energy", "rest_energy", "drag", "drag_slope"):
        assert again[key] <= 2 * getattr(certificate, key) + 1e-6
    for key in ("force", "rest_force"):
        assert all(a <= 2 * c + 1e-6 for a, c in zip(again[key], getattr(certificate, key), strict=True))
    if name != "baked_mlp":  # far rougher than trained networks are; it is for the other tests
        certificate.check(BOUNDS)


def test_certificate_refuses(laws):
    """A table that is too coarse is named with the number, the bound, and what to change."""
    stretch = (-1.0, 4.0)
    coarse = bake(laws["stable"], ATTRIBUTE_VECTOR, Resolution(stretch, 2.0, 4, 20.0, 0.05), fabric=SILK)
    with pytest.raises(DrapeError, match=r"table of silk: .* from the network; expected at most .*table.step smaller"):
        coarse.certificate.check(BOUNDS)


@pytest.mark.parametrize("bad", [{"stretch": (0.1, 4.0)}, {"step": 0.0}, {"angles": 3}, {"speed": math.nan}])
def test_resolution_is_checked(bad):
    with pytest.raises(DrapeError, match=f"table.{next(iter(bad))}: found .*; expected"):
        Resolution(**({"stretch": (-1.0, 4.0), "step": 0.1, "angles": 8, "speed": 1.0, "speed_step": 0.1} | bad))


@pytest.mark.parametrize("name", BAKED)
def test_file_keeps_everything(laws, name, tmp_path):
    """What is read is what was saved: energies, certificate, fabric, attributes."""
    law = copy.deepcopy(laws[name]).float()
    save_baked(law, tmp_path / "law.npz")
    found, vector = load_baked(str(tmp_path / "law.npz"), SILK)
    q = deformations()
    for a, b in zip(found._derivatives(q, 3), law._derivatives(q, 3), strict=True):
        assert torch.equal(a, b)
    if law.dissipates:
        assert torch.equal(found.drag(q[:, 0].abs(), attributes(len(q))), law.drag(q[:, 0].abs(), attributes(len(q))))
    assert found.certificate == law.certificate
    assert (found.fabric, found.bends, found.dissipates) == (SILK, law.bends, law.dissipates)
    assert (found.face_area, found.dt) == (law.face_area, law.dt)
    assert torch.equal(vector, ATTRIBUTE_VECTOR)


def test_bad_files_are_named(laws, tmp_path):
    """Absent, damaged, foreign, of another version, of another fabric: a sentence each."""
    path = tmp_path / "law.npz"
    with pytest.raises(DrapeError, match="no such table"):
        read_baked(path)
    save_baked(laws["baked"], path)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], b"", b"text"):
        path.write_bytes(damaged)
        with pytest.raises(DrapeError, match="cannot be read as a table .* bake it again"):
            read_baked(path)
    np.savez(path, content=np.array(json.dumps({"format": "drape baked law", "version": 99})))
    with pytest.raises(DrapeError, match=r"found format .*99.*; expected .*1.*; bake it again"):
        read_baked(path)
    np.savez(path, content=np.array(json.dumps({"format": "drape baked law", "version": 1})))
    with pytest.raises(DrapeError, match="damaged: KeyError"):
        read_baked(path)
    path.write_bytes(whole)
    with pytest.raises(DrapeError, match="found a table of silk; expected one of denim"):
        load_baked(str(path), Material("denim", 40.0, 10.0, 25.0, 0.0, 1.0, 1.0))
    with pytest.raises(DrapeError, match=r"bending_stiffness of silk: found a table baked for 0.5, .* has 5"):
        load_baked(str(path), Material("silk", 5.0, 5.0, 0.0, 0.0, 1.0, 0.15))


def test_law_of_a_checkpoint(cloth_batch, tmp_path):
    """The fabric's vector in the checkpoint's scales, the area and the time that it was trained on; or a refusal."""
    model = {
        "_target_": "drape.energy.eunet.EUNet",
        "potential": {
            "_target_": "drape.energy.potential_stable.StablePotential",
            "deformation": {"_target_": "drape.energy.deformation.StretchBending"},
            "width": 8, "stretch_scale": 0.01, "energy_scale": 0.1,
        },
    }  # fmt: skip
    energy = make_energy("stable", "none").float()
    model["potential"]["width"] = 16
    scales = dict.fromkeys(ATTRIBUTES, 10.0)
    config = {"model": model, "material": {"silk": {}}, "datamodule": {"attribute_scales": scales}}
    window: Window = make_window(cloth_batch)
    state = {f"energy.{key}": value for key, value in energy.state_dict().items()}
    torch.save({"state_dict": state, "drape": describe(config, energy, window)}, tmp_path / "last.ckpt")
    law, vector = load_law(str(tmp_path / "last.ckpt"), SILK)
    assert vector.tolist() == [0.5, 0.05, 0.015, 0.0, 0.0]
    assert law.face_area == pytest.approx(0.5 / 49)
    assert law.dt == pytest.approx(1 / 30)
    with pytest.raises(DrapeError, match="found a law of silk; expected one of denim"):
        load_law(str(tmp_path / "last.ckpt"), Material("denim", 40.0, 10.0, 25.0, 0.0, 1.0, 1.0))
