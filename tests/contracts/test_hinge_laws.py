"""What holds for every law of springs and hinges: networks', a table of them, and either without hinges."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import pytest
import torch

from drape.energy.law.baked.baking import Resolution, bake
from drape.energy.law.baked.file import save_baked
from drape.energy.law.baked.hinges import Bounds, Samples
from drape.energy.law.damping import Damping
from drape.energy.law.eunet import EUNet
from drape.energy.law.hinge_law import NetworkHinges, WithoutHinges, fabrics_damper
from drape.energy.law.load_law import load_baked, load_law
from drape.energy.law.scaled_law import at_density, learned_density
from drape.errors import DrapeError
from drape.scene.material import Material
from tests.energies import make_energy, write_checkpoint

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
DENIM = Material("denim", 40.0, 10.0, 25.0, 0.0, 1.0, 1.0)
VECTOR = torch.tensor([0.02, 0.01, 0.05, 0.0, 0.0], dtype=torch.float64)
RESOLUTION = Resolution((-1.0, 4.0), 0.25)
BOUNDS = Bounds(energy=1e-3, force=1e-2)
LAWS = ["network", "baked", "stretch", "baked_stretch", "network_alone", "baked_alone", "light", "baked_light"]
ALONE = LAWS[2:6]
BAKED = {"baked": "network", "baked_stretch": "stretch"}
"""Tables, and the networks that they are of."""

every_law = pytest.mark.parametrize("name", LAWS)


@pytest.fixture(scope="module")
def laws():
    """Every kind of law, random but the same each time."""
    torch.manual_seed(1)
    made = {
        "network": NetworkHinges(make_energy("hinge", "damping").requires_grad_(False), VECTOR, 0.01, 1 / 30),
        "stretch": NetworkHinges(make_energy("hinge", "none", "stretch").requires_grad_(False), VECTOR, 0.01, 1 / 30),
    }
    made["network"].damper, made["network"].drag = 2.0, 0.3
    made |= {name: bake(made[of], RESOLUTION, fabric=SILK) for name, of in BAKED.items()}
    light = 0.2 * learned_density(SILK, 0.01)
    made |= {"light": at_density(made["network"], SILK, light), "baked_light": at_density(made["baked"], SILK, light)}
    return made | {f"{name}_alone": WithoutHinges(made[name]) for name in ("network", "baked")}


def deformations(count: int = 12) -> torch.Tensor:
    """Stretched and bent edges, some of them outside a table, folded, or at rest in one of the two."""
    q = torch.randn(count, 2, dtype=torch.float64) * torch.tensor([0.05, 1.0], dtype=torch.float64)
    q[0, 0], q[1, 0], q[2, 1], q[3, 1], q[4, 0], q[5, 1] = 1.3, -0.7, 3.1, -3.1, 0.0, 0.0
    return q


@every_law
def test_derivatives(laws, name):
    """Energy, gradient and Hessian in q, by finite differences."""
    law, q = laws[name], deformations()
    assert torch.autograd.gradcheck(law.potential, q.clone().requires_grad_())
    slopes, h = law.slopes(q), 1e-6
    for one, other in zip(law.energy_and_gradient(q), slopes, strict=False):
        torch.testing.assert_close(one, other)
    torch.testing.assert_close(slopes.energy, law.potential(q))
    torch.testing.assert_close(slopes.hessian, slopes.hessian.mT)
    assert slopes.hessian.abs().max() > 1.0
    for k in range(2):
        step = torch.zeros(2, dtype=torch.float64)
        step[k] = h
        up, down = (law.slopes(q + sign * step) for sign in (1, -1))
        torch.testing.assert_close((up.energy - down.energy) / (2 * h), slopes.gradient[:, k], rtol=1e-5, atol=1e-5)
        size = slopes.hessian[:, k].abs().max() + 1.0
        assert ((up.gradient - down.gradient) / (2 * h) - slopes.hessian[:, k]).abs().max() < 1e-5 * size


@every_law
def test_rest_costs_nothing_and_all_else_something(laws, name):
    """To the last bit: no energy, no force; around it energy, and a Hessian without negative directions."""
    law, rest = laws[name], torch.zeros(1, 2, dtype=torch.float64)
    slopes = law.slopes(rest)
    assert slopes.energy == 0.0
    assert (slopes.gradient == 0.0).all()
    stretch, hinge = slopes.hessian[0].diagonal().tolist()
    assert slopes.hessian[0, 0, 1] == 0.0
    assert stretch > 0.0
    assert (hinge == 0.0) if name in ALONE else (hinge > 0.0)
    q = torch.cat([deformations(500), 1e-3 * torch.randn(500, 2, dtype=torch.float64)])
    assert law.potential(q).min() >= 0.0
    assert (law.potential(q[q[:, 0] != 0.0]) > 0.0).all()


@every_law
def test_a_fabric_has_no_preferred_side(laws, name):
    q = deformations(200)
    over = q * torch.tensor([1.0, -1.0], dtype=torch.float64)
    torch.testing.assert_close(laws[name].potential(over), laws[name].potential(q), rtol=1e-12, atol=0.0)


@every_law
def test_hinges_matter_unless_left_out(laws, name):
    """Only then is there no energy of an angle, no force in it, and no stiffness."""
    q = deformations(50)
    q[:, 0] *= 0.01
    bent = laws[name].slopes(q)
    flat = laws[name].slopes(q * torch.tensor([1.0, 0.0], dtype=torch.float64))
    felt = bent.energy - flat.energy, bent.gradient[:, 1], bent.hessian[:, 1], bent.hessian[:, :, 1]
    assert all((one.abs().max() < 1e-9) if name in ALONE else (one.abs().max() > 1e-3) for one in felt)


def test_a_law_without_its_hinges_keeps_the_rest(laws):
    """φp, its slope and its curvature in Δl on the flat cloth; mesh, damper and drag."""
    q = deformations() * torch.tensor([1.0, 0.0], dtype=torch.float64)
    for name in ("network", "baked"):
        found, full = laws[f"{name}_alone"], laws[name]
        for each in (found, full):
            assert (each.face_area, each.damper, each.drag) == (0.01, 2.0, 0.3)
        for one, other in zip(found.slopes(q)[:2], full.slopes(q)[:2], strict=True):
            torch.testing.assert_close(one, other)
        torch.testing.assert_close(found.slopes(q).hessian[:, 0, 0], full.slopes(q).hessian[:, 0, 0])


@every_law
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_finite_at_extremes(laws, name, dtype):
    """Ten metres of stretch, many turns: numbers, of the precision that was asked for."""
    law = copy.deepcopy(laws[name]).to(dtype)
    q = torch.cartesian_prod(*[torch.tensor(v, dtype=dtype) for v in ([-10, 0, 10.0], [-50, 0, math.pi])])
    for part in law.slopes(q):
        assert part.isfinite().all()
        assert part.dtype == dtype


@every_law
def test_single_precision_is_close(laws, name):
    """Law and deformation in float32 against float64: 0.1 % of the largest."""
    q = deformations(200)
    exact, rounded = laws[name].slopes(q), copy.deepcopy(laws[name]).float().slopes(q.float())
    for found, expected in zip(rounded, exact, strict=True):
        assert (found - expected).abs().amax() < 1e-3 * expected.abs().amax()


# Networks


def test_what_is_negative_does_not_damp():
    """A damper or a drag below zero would drive the motion: it counts as none."""
    damping = Damping(16, stretch_scale=0.01, speed_scale=1.0, energy_scale=0.1).double()
    energy = EUNet(make_energy("hinge", "none").potential, damping)
    for axial, air in ((10.0, -2e-3), (-10.0, 2e-3)):
        with torch.no_grad():
            damping.coefficients.layers[-1].weight.zero_()
            damping.coefficients.layers[-1].bias.copy_(torch.tensor([axial, air]))
        law = NetworkHinges(energy, VECTOR, 0.01, 1 / 30)
        assert law.damper == pytest.approx(max(2 * 0.1 * axial / 30 / 0.01**2, 0.0))
        assert law.drag == pytest.approx(max(2 * 0.1 * air * 30 / 1.0**2, 0.0))


def test_law_of_a_checkpoint(cloth_batch, tmp_path):
    """The fabric's vector in the checkpoint's scales, the area that it was trained on, its forces; or a refusal."""
    sees = {"_target_": "drape.energy.law.deformation.StretchHinge"}
    model = {
        "_target_": "drape.energy.law.eunet.EUNet",
        "potential": {
            "_target_": "drape.energy.law.potential_hinge.HingePotential", "deformation": sees,
            "width": 16, "stretch_scale": 0.01, "angle_scale": 0.2, "energy_scale": 0.1,
        },
        "dissipation": {
            "_target_": "drape.energy.law.damping.Damping",
            "width": 16, "stretch_scale": 0.01, "speed_scale": 1.0, "energy_scale": 0.1,
        },
        "timing": {"_target_": "drape.energy.law.timing.Timing", "deformation": sees, "width": 16},
    }  # fmt: skip
    energy = make_energy("hinge", "damping", timed=True).float()
    write_checkpoint(tmp_path / "last.ckpt", energy, model, cloth_batch)
    law, vector = load_law(str(tmp_path / "last.ckpt"), SILK)
    assert isinstance(law, NetworkHinges)
    assert vector.tolist() == [0.5, 0.05, 0.015, 0.0, 0.0]
    assert law.face_area == pytest.approx(0.5 / 49)
    damper, drag = energy.units["dissipation"].constants(vector, 1 / 30)
    stiffness = float(law.slopes(torch.zeros(1, 2).double()).hessian[0, 0, 0])
    assert law.damper == pytest.approx(fabrics_damper(damper, stiffness, 1 / 30))
    assert law.drag == pytest.approx(max(drag, 0.0))
    q = deformations()
    expected = energy.potential.energies(q, vector.expand(len(q), -1))
    torch.testing.assert_close(law.potential(q), expected, rtol=1e-6, atol=1e-9)
    with pytest.raises(DrapeError, match="found a law of silk; expected one of denim"):
        load_law(str(tmp_path / "last.ckpt"), DENIM)


# Tables


@pytest.mark.parametrize("name", BAKED)
def test_a_table_says_what_its_network_says(laws, name):
    """Energies and slopes relative to themselves, from the smallest deformations to the largest of the table."""
    table, network = laws[name], laws[BAKED[name]]
    low, high = table.certificate.stretch
    assert (low, high) == pytest.approx((-2 * math.sqrt(0.01), 8 * math.sqrt(0.01)))
    size = 10.0 ** (-7.0 * torch.rand(400, 2, dtype=torch.float64))
    stretch = torch.where(torch.rand(400) < 0.5, low, high) * size[:, 0]
    q = torch.stack([stretch, math.pi * size[:, 1]], 1)
    assert max(Samples.of(network, q).differences(table).values()) < 2e-3
    rest = torch.zeros(1, 2, dtype=torch.float64)
    torch.testing.assert_close(table.slopes(rest).hessian, network.slopes(rest).hessian, rtol=1e-3, atol=0.0)
    assert (table.damper, table.drag, table.face_area) == (network.damper, network.drag, network.face_area)


@pytest.mark.parametrize("name", BAKED)
def test_beyond_the_table_the_law_goes_on_as_a_parabola(laws, name):
    law = laws[name]
    for end in law.certificate.stretch:
        far = torch.tensor([[30.0 * end, 0.3], [60.0 * end, 0.3]], dtype=torch.float64)
        slopes = law.slopes(far)
        assert slopes.hessian[0, 0, 0] > 0.0
        torch.testing.assert_close(slopes.hessian[0, 0, 0], slopes.hessian[1, 0, 0])
        energy = slopes.energy - law.potential(far * torch.tensor([0.0, 1.0], dtype=torch.float64))
        assert energy[1] == pytest.approx(4.0 * energy[0].item(), rel=1e-3)


@pytest.mark.parametrize("name", BAKED)
def test_certificate_is_true(laws, name):
    """Measured again on other samples, no error is twice what the certificate says; and it says little enough."""
    law, network = laws[name], laws[BAKED[name]]
    certificate = law.certificate
    certificate.check(BOUNDS)
    low, high = (math.asinh(end / law.stretch_scale) for end in certificate.stretch)
    stretch = (low + (high - low) * torch.rand(5000, dtype=torch.float64)).sinh() * law.stretch_scale
    q = torch.stack([stretch, math.pi * (2.0 * torch.rand(5000, dtype=torch.float64) - 1.0)], 1)
    found = Samples.of(network, q).differences(law)
    assert found.pop("constants") == certificate.constants == 0.0
    for key, share in found.items():
        assert 0.0 < share <= 2.0 * getattr(certificate, key)


def test_differences_are_relative_to_what_is_stored(laws):
    """A hundredth more of everything is a hundredth, of the smallest deformation too."""
    q = torch.tensor([[0.1, 0.0], [1e-6, 0.0], [0.0, 1.0], [0.0, 1e-6]], dtype=torch.float64)
    for row in q[:, None]:
        true = Samples.of(laws["baked"], row)
        found = true._replace(energy=1.01 * true.energy).differences(laws["baked"])
        assert found == pytest.approx({"energy": 0.01 / 1.01, "force": 0.0, "constants": 0.0}, abs=1e-9)
        found = true._replace(slopes=1.01 * true.slopes).differences(laws["baked"])
        spring = float((true.slopes * row).sum() / (2.0 * true.energy))
        assert found == pytest.approx({"energy": 0.0, "force": 0.01 * spring, "constants": 0.0}, abs=1e-9)
        assert 0.3 < spring < 3.0


def test_half_the_step_is_many_times_as_exact(laws):
    rough, fine = (bake(laws["network"], Resolution((-1.0, 4.0), step), fabric=SILK) for step in (0.5, 0.25))
    assert fine.certificate.energy < 0.2 * rough.certificate.energy
    assert fine.certificate.force < 0.3 * rough.certificate.force


def test_certificate_refuses_and_says_what_it_knows(laws):
    """A table that is too coarse is named with the number, the bound, and what to change."""
    coarse = bake(laws["network"], Resolution((-1.0, 4.0), 4.0), fabric=SILK, checkpoint="last.ckpt", sha256="12" * 32)
    with pytest.raises(DrapeError, match=r"table of silk: .* from the network; expected at most .*table.step smaller"):
        coarse.certificate.check(BOUNDS)
    for bad in ("energy", "force"):
        with pytest.raises(DrapeError, match=f"table of silk: {bad}: found a difference of nan"):
            replace(laws["baked"].certificate, **{bad: math.nan}).check(BOUNDS)
    rows, columns = coarse.plane.nodes
    for words in ("silk of last.ckpt (sha256 121212121212)", f"{rows} x {columns} nodes", "from -0.2 to 0.8 m"):
        assert words in coarse.certificate.text()


BAD = [{"stretch": stretch} for stretch in ((0.1, 4.0), [-1.0, 0.0, 4.0], (-1.0, math.inf))]
BAD += [{"step": 0.0}, {"step": math.nan}]


@pytest.mark.parametrize("bad", BAD, ids=str)
def test_resolution_is_checked(bad):
    with pytest.raises(DrapeError, match=f"table.{next(iter(bad))}: found .*; expected"):
        Resolution(**({"stretch": (-1.0, 4.0), "step": 0.1} | bad))


@pytest.mark.parametrize("name", BAKED)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_file_keeps_everything(laws, name, dtype, tmp_path):
    """What is read is what was saved: energies to the last bit, certificate, fabric, attributes, damping."""
    law = laws[name]
    save_baked(copy.deepcopy(law).to(dtype), tmp_path / "law.npz")
    found, vector = load_baked(str(tmp_path / "law.npz"), SILK)
    q = deformations()
    assert all(torch.equal(a, b) for a, b in zip(found.slopes(q), law.slopes(q), strict=True))
    assert (found.certificate, found.fabric) == (law.certificate, SILK)
    assert (found.face_area, found.damper, found.drag) == (law.face_area, law.damper, law.drag)
    assert torch.equal(vector, VECTOR)
