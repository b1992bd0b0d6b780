"""Loss terms: values from first principles, and what all of them share."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest
import torch

from drape.energy.law.step_energies import StepEnergies
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.loss.contrastive import Contrastive
from drape.loss.energy_balance import EnergyBalance, EnergyBalancePerMass
from drape.loss.force_residual import ForceResidual
from tests.energies import make_energy, make_window

LOSSES = {
    "energy_balance": lambda: EnergyBalance(1.0),
    "energy_balance_per_mass": lambda: EnergyBalancePerMass(1.0),
    "contrastive": lambda: Contrastive(1.0, sigma=1e-6),
    "contrastive_kinetic": lambda: Contrastive(1.0, sigma=1e-6, inertia="kinetic"),
    "force_residual": lambda: ForceResidual(1.0, bend=1.0),
}


@pytest.fixture
def step(cloth_batch) -> StepEnergies:
    return StepEnergies(make_energy("hinge", "damping", timed=True), make_window(cloth_batch), training=True)


@pytest.mark.parametrize("name", LOSSES)
def test_positive_finite_and_teaches(name, step):
    """A wrong energy has a positive loss, with gradients for its parameters."""
    value = LOSSES[name]()(step)
    value.backward()
    gradients = [p.grad for p in step.energy.parameters() if p.grad is not None]
    assert value > 0
    assert gradients
    assert all(torch.isfinite(g).all() for g in gradients)
    assert sum(float(g.norm()) for g in gradients) > 0


@pytest.mark.parametrize("name", ["energy_balance", "energy_balance_per_mass"])
def test_mean_over_the_batch(name, cloth):
    """Two copies of a window have the loss of one."""
    energy = make_energy("mlp", "speed")
    one = make_window(MeshBatch.from_meshes([cloth]))
    two = make_window(MeshBatch.from_meshes([cloth, cloth]))
    names = ("x_prev", "x", "x_next", "mass", "free", "attributes", "fabric")
    doubled = {name: torch.cat([getattr(one, name)] * 2) for name in names}
    two = replace(two, **doubled)
    values = [LOSSES[name]()(StepEnergies(energy, w, training=False)) for w in (one, two)]
    torch.testing.assert_close(*values, rtol=1e-9, atol=0)


def test_free_fall_has_the_known_balance(cloth_batch):
    """Falling without deformation: dT + dV_g = -M g² dt²/2 (docs/sources.md, Known values)."""
    window = make_window(cloth_batch)
    frame = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    fallen = [window.x - 0.5 * 9.81 * (k * window.dt) ** 2 * frame for k in (3, 4, 5)]
    window = replace(window, x_prev=fallen[0], x=fallen[1], x_next=fallen[2])
    expected = float(window.mass.sum()) * 9.81**2 * window.dt**2 / 2
    assert window.balance.item() == pytest.approx(expected, rel=1e-9)
    assert window.inertial_force.abs().max() < 1e-8


@pytest.mark.parametrize("inertia", ["predicted", "kinetic"])
def test_rise_is_the_difference_of_whole_energies(inertia, cloth_batch):
    """E(x_i + δ) - E(x_i) of every disturbed vertex, against the whole cloth evaluated twice."""
    window, energy = make_window(cloth_batch), make_energy("hinge", "damping")
    loss = Contrastive(1.0, sigma=1e-3, inertia=inertia)
    seen, inputs = [], energy.inputs

    def recorded(geometry, previous, dt):
        seen.append(geometry.x.detach() - window.x_next)
        return inputs(geometry, previous, dt)

    energy.inputs = recorded
    vertices, rise = loss.rise(StepEnergies(energy, window, training=False))
    noise = max(seen, key=torch.linalg.norm)
    start = window.x + (window.dt * window.v if inertia == "predicted" else 0.0)

    def total(x):
        kinetic = (window.mass[:, None] * (x - start) ** 2).sum() / (2 * window.dt**2)
        gravity = -(window.mass[:, None] * x * window.gravity).sum()
        return kinetic + gravity + energy(x, window.x, window.mesh, window.attributes, window.dt).sum()

    assert len(vertices) > 1
    for i, vertex in enumerate(vertices):
        disturbed = window.x_next.clone()
        disturbed[vertex] += noise[vertex]
        expected = total(disturbed) - total(window.x_next)
        torch.testing.assert_close(rise[i], expected, rtol=1e-5, atol=1e-9)


def test_differences_do_not_drown_in_single_precision():
    """On the paper's 4.8 m cloth with disturbances of 10 µm, float32 parameters give the rise to 2 % of its size."""
    window = make_window(MeshBatch.from_meshes([square_grid(4.8, 12)]))
    exact = make_energy("mlp", "speed")
    rises = []
    for energy in (exact, copy.deepcopy(exact).float()):
        torch.manual_seed(2)
        rises.append(Contrastive(1.0, sigma=1e-5).rise(StepEnergies(energy, window, training=False))[1])
    assert (rises[0] - rises[1]).norm() < 0.02 * rises[0].norm()


def test_force_residual_of_no_energy_is_the_inertial_force(cloth_batch):
    """With an energy of constant value the residual is m (a - g), zero at pins; the loss is its smooth mean."""
    window = make_window(cloth_batch)
    energy = make_energy("mlp", "none")
    with torch.no_grad():
        energy.potential.net.decoder[-1].weight.zero_()
    step = StepEnergies(energy, window, training=False)
    torch.testing.assert_close(step.force_residual[window.free], window.inertial_force[window.free])
    assert (step.force_residual[~window.free] == 0).all()
    acceleration = window.inertial_force[window.free].norm(dim=-1) / window.mass[window.free]
    expected = 4.0 * ((1 + (acceleration / 2.0) ** 2).sqrt() - 1).mean()
    assert ForceResidual(1.0, bend=2.0)(step).item() == pytest.approx(expected.item(), rel=1e-9)


def test_unknown_inertia_is_refused():
    """A misspelt kind of inertia names the two that exist."""
    with pytest.raises((ValueError, TypeError), match="inertia"):
        Contrastive(1.0, 1e-5, inertia="kinetical")
