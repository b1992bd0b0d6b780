"""Losses on cases whose value can be worked out by hand: weights, powers, signs, and what is averaged over what."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from drape.energy.law.eunet import EUNet
from drape.energy.law.step_energies import StepEnergies
from drape.energy.step import Step
from drape.energy.terms.contact import SurfaceContact
from drape.energy.terms.free_motion import Inertia
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.loss.collision import Collision
from drape.loss.contrastive import Contrastive
from drape.loss.energy_balance import EnergyBalance, EnergyBalancePerMass
from drape.loss.force_residual import ForceResidual
from drape.loss.newton import Newton
from drape.loss.position import Position
from drape.loss.potential import Potential
from drape.loss.prediction import Prediction
from tests.energies import make_window
from tests.terms import make_step
from tests.unit.test_metric_values import Springs

DT = 0.1
BATCH = MeshBatch.from_meshes([square_grid(1.0, 5), square_grid(1.0, 4)])
"""Two cloths of 25 and 16 vertices."""
MASS = torch.where(BATCH.mesh_of_vertex == 0, 0.1, 0.4).double()
UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


def window(batch: MeshBatch = BATCH, **changes: object):
    """Cloths at rest in three frames, without gravity; nothing is pinned. Springs of 2 N/m."""
    rest, count, mass = batch.rest_positions, batch.num_meshes, torch.where(batch.mesh_of_vertex == 0, 0.1, 0.4)
    values = {
        "x_prev": rest, "x": rest, "x_next": rest, "mass": mass.double(), "free": torch.ones(len(rest)).bool(),
        "attributes": torch.full((count, 5), 2.0, dtype=torch.float64), "gravity": 0.0 * UP, "dt": DT,
    }  # fmt: skip
    return replace(make_window(batch), **(values | changes))


def of(seen, offset: float = 0.0) -> StepEnergies:
    """Springs at rest store ``offset`` each."""
    return StepEnergies(EUNet(Springs(offset=offset)), seen, training=True)


def moving(first: float, second: float):
    """Cloths that begin to rise with these speeds [m/s]: ΔV = -M v²/2 each."""
    speed = torch.where(BATCH.mesh_of_vertex == 0, first, second).double()[:, None]
    return window(x_next=BATCH.rest_positions + DT * speed * UP)


# Of energies


def test_energy_balance_is_the_mean_square_over_cloths():
    """M = 2.5 and 6.4 kg, 2 and 1 m/s: energies of 5 and 3.2 J are missing, 2 and 0.5 J/kg."""
    step = of(moving(2.0, 1.0))
    assert step.window.balance.tolist() == pytest.approx([-5.0, -3.2])
    assert EnergyBalance(1.0)(step).item() == pytest.approx((5.0**2 + 3.2**2) / 2)
    assert EnergyBalancePerMass(1.0)(step).item() == pytest.approx((2.0**2 + 0.5**2) / 2)


def test_energy_that_is_stored_does_not_explain_motion_that_appears():
    """Stretched by a tenth within a frame: ½ k Σ Δl² is stored although ½ m v² has come out of nothing."""
    stretched = of(window(x_next=1.1 * BATCH.rest_positions))
    stored = 0.5 * 2.0 * BATCH.sum_edges((0.1 * BATCH.rest_lengths).square())
    kinetic = 0.5 * BATCH.sum_vertices(MASS * (0.1 * BATCH.rest_positions / DT).square().sum(-1))
    expected = (stored + kinetic).square().mean().item()
    assert EnergyBalance(1.0)(stretched).item() == pytest.approx(expected)


def test_force_residual_counts_free_vertices_and_accelerations():
    """3 m/s² at each vertex whatever its mass, half of them pinned: h(3) = 4 (√(1 + 9/4) - 1) at a bend of 2."""
    accelerated = window(x_next=BATCH.rest_positions + DT**2 * 3.0 * UP, free=torch.arange(41) % 2 == 0)
    assert ForceResidual(1.0, bend=2.0)(of(accelerated)).item() == pytest.approx(4.0 * ((1 + 9 / 4) ** 0.5 - 1))


# Contrastive


class Weightless(Springs):
    """Of no energy at all: what rises is inertia and gravity."""

    def energies(self, inputs, attributes):
        return 0.0 * inputs[:, 0]


MANY = MeshBatch.from_meshes([square_grid(1.0, 4)] * 60)


def flying(seed: int, **changes: object) -> Tensor:
    """(δ/σ)² of the disturbed vertices of 60 cloths without a law, which obey it: the rise is m δ²/2dt²."""
    torch.manual_seed(seed)
    step = StepEnergies(EUNet(Weightless()), window(MANY), training=True)
    vertices, rise = Contrastive(1.0, **({"sigma": 0.01} | changes)).rise(step)
    assert len(MANY.mesh_of_vertex[vertices].unique()) == 60
    return 2.0 * DT**2 * rise / step.window.mass[vertices] / 0.01**2


def test_disturbances_have_the_levels_of_the_paper():
    """σ/10, 2σ/10, …, σ, each as often, drawn for each cloth on its own: the mean of δ² is 0.385 · 3σ² in each batch.

    One draw for a whole batch would change its mean by 90 % from batch to batch instead of by some 20 %.
    """
    squares = [flying(seed) for seed in range(16)]
    means = torch.stack([each.mean() for each in squares]).detach()
    assert float(means.mean()) == pytest.approx(3 * 0.385, rel=0.08)
    assert float(means.std() / means.mean()) < 0.4
    assert float(torch.cat(squares).max()) > 6.0, "there is a level of σ itself"


@pytest.mark.parametrize("rows", [7, 4096])
def test_what_fills_up_the_affected_edges_counts_nothing(monkeypatch, rows):
    torch.manual_seed(0)
    step = StepEnergies(EUNet(Springs()), window(BATCH), training=True)
    plain, filled = [], []
    for found, size in ((plain, 1), (filled, rows)):
        monkeypatch.setattr("drape.loss.contrastive.ROWS", size)
        torch.manual_seed(1)
        found += Contrastive(1.0, 0.01).rise(step)
    torch.testing.assert_close(filled, plain, rtol=1e-12, atol=1e-15)


def test_one_level_is_sigma_itself():
    assert float(torch.cat([flying(seed, levels=1) for seed in range(8)]).mean()) == pytest.approx(3.0, rel=0.1)


def test_the_contrastive_loss_is_a_sum_over_vertices_and_a_mean_over_cloths(monkeypatch):
    """Falls of 1 and 3 J and a rise of 5 J, two cloths: (1 + 9) / 2."""
    loss, rise = Contrastive(1.0, 0.01), torch.tensor([-1.0, 5.0, -3.0], dtype=torch.float64)
    monkeypatch.setattr(loss, "rise", lambda step: (torch.arange(3), rise))
    assert loss(of(window())).item() == pytest.approx(5.0)


# Of predictions


def step_of(**changes: object) -> Step:
    seen = window()
    names = ("mesh", "x", "mass", "free", "attributes", "gravity", "dt")
    return Step(**({name: getattr(seen, name) for name in names} | {"v": 0.0 * seen.x} | changes))


def predicted(x_next: Tensor, step: Step) -> Prediction:
    return Prediction(x_next, step, BATCH.rest_positions, [], 1.0)


def test_position_counts_free_vertices_in_accelerations():
    """Twice the acceleration that is typical, at the free half of the vertices; pinned ones are far away."""
    step = step_of(free=torch.arange(41) % 2 == 0)
    off = torch.where(step.free, 2.0 * 5.0 * DT**2, 1.0).double()[:, None] * UP
    loss = Position(3.0, scale=5.0)
    values = loss(predicted(BATCH.rest_positions + off, step))
    assert values["position"].item() == pytest.approx(4.0)
    assert loss.total(values).item() == pytest.approx(12.0)


def test_collision_is_a_mean_over_the_vertices_that_are_too_near():
    """Every second vertex at a third of the thickness, the others beyond it: (2/3)², however many those are."""
    step, x_next = make_step(square_grid(1.0, 5))
    near = step.near_vertices(0.1)
    heights = torch.where(torch.arange(len(near.points)) % 2 == 0, 1e-3, 5e-3)[:, None]
    x = x_next.index_copy(0, near.points, near.end.point + heights * near.end.normal)
    found = Collision(1.0, 3e-3, 0.1)(Prediction(x, step, x_next, [], 1.0))
    assert found["collision"].item() == pytest.approx(4 / 9)


NUMBERS = {"contact": SurfaceContact(1.0, 1e-3, 0.1, per_edge=0), "ramp": (0.1, 0.2, 0.6), "friction": None}


class Inertial(Potential):
    """Inertia alone."""

    def terms(self, prediction):
        return [Inertia()]


def test_the_potential_is_a_mean_over_garments_of_energies_per_mass():
    """Off by 2 and by 4 cm: ½ (0.02² + 0.04²)/2 /dt², whatever they weigh; in joules that of their mean mass."""
    off = torch.where(BATCH.mesh_of_vertex == 0, 0.02, 0.04).double()[:, None] * UP
    loss, prediction = Inertial(weight=2.0, **NUMBERS), predicted(BATCH.rest_positions + off, step_of())
    values = loss(prediction)
    expected = 0.5 * (0.02**2 + 0.04**2) / 2 / DT**2
    assert values["inertia"].item() == pytest.approx(expected)
    assert loss.total(values).item() == pytest.approx(2.0 * expected)
    assert loss.joules(values, prediction)["inertia"].item() == pytest.approx(expected * (2.5 + 6.4) / 2)


class InertialNewton(Newton):
    """Inertia alone: Newton's step ends where the cloth would fly."""

    def terms(self, prediction):
        return [Inertia()]


def newton(longest: float) -> Newton:
    return InertialNewton(energies=3.0, scale=5.0, longest=longest, weight=2.0, **NUMBERS)


def test_newtons_step_is_half_a_square_in_accelerations():
    """Off by 2 · 5 m/s² dt²: ½ 2² = 2 with a gradient towards the end; total = weight · it + energies · weight · E."""
    x_next = (BATCH.rest_positions + 10.0 * DT**2 * UP).requires_grad_()
    loss = newton(1.0)
    values = loss(predicted(x_next, step_of()))
    assert values["newton"].item() == pytest.approx(2.0)
    energy = 0.5 * (10.0 * DT**2) ** 2 / DT**2
    assert values["inertia"].item() == pytest.approx(energy)
    assert loss.total(values).item() == pytest.approx(2.0 * 2.0 + 3.0 * 2.0 * energy)
    values["newton"].backward()
    assert x_next.grad[:, 2].tolist() == pytest.approx([10.0 * DT**2 / (5.0 * DT**2) ** 2 / 41] * 41)


def test_newtons_step_counts_with_its_longest_length():
    """A tenth of the way: a hundredth of the square."""
    x_next = BATCH.rest_positions + 10.0 * DT**2 * UP
    assert newton(1.0 * DT**2)(predicted(x_next, step_of()))["newton"].item() == pytest.approx(0.02)
