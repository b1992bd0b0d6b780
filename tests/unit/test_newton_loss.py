"""The length of Newton's step as a loss: against potentials whose minimum is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.energy.terms.contact import SurfaceContact
from drape.energy.terms.elastic import ElasticEnergy
from drape.geometry.disc import disc
from drape.geometry.grid import square_grid
from drape.loss.newton import Newton
from drape.loss.potential import Potential
from drape.loss.prediction import Prediction
from tests.terms import law, make_step

CONTACT = {"contact": SurfaceContact(2e4, 2e-3, 0.05, per_edge=0), "ramp": (1.0, 0.0, 0.0), "friction": None}


class Tethers(EnergyTerm):
    """``½ k |x_i' - x_j' - r|²`` along the edges: quadratic, couples vertices, exact stencils."""

    name = "tethers"

    def __init__(self, stiffness: float):
        super().__init__()
        self.stiffness = stiffness

    def forward(self, x_next: Tensor, step: Step) -> Tensor:
        first, second = step.mesh.edges.unbind(1)
        rest = step.mesh.rest_positions
        stretch = (x_next[first] - x_next[second]) - 1.1 * (rest[first] - rest[second])
        return step.sum_stencils(0.5 * self.stiffness * stretch.square().sum(-1), first)

    def stencils(self, x_next: Tensor, step: Step) -> list[Stencils]:
        pair = torch.tensor([[1.0, -1.0], [-1.0, 1.0]], dtype=x_next.dtype)
        block = self.stiffness * torch.einsum("ab,cd->acbd", pair, torch.eye(3, dtype=x_next.dtype))
        return [Stencils(step.mesh.edges, block.expand(len(step.mesh.edges), 2, 3, 2, 3))]


def newton(longest: float = 10.0, energies: float = 0.0, **changes: object) -> Newton:
    return Newton(energies=energies, scale=9.81, longest=longest, **({"weight": 1.0} | CONTACT | changes))


def free_of_body(*meshes) -> tuple[Step, Tensor]:
    step, x_next = make_step(*meshes)
    return replace(step, obstacle=None), x_next


def potential(x: Tensor, step: Step, terms: Sequence[EnergyTerm], loss: Potential) -> Tensor:
    found = loss.terms(Prediction(x, step, x, terms, 1.0))
    return torch.stack([term(x, step).sum() for term in found]).sum()


def minimum(step: Step, terms: Sequence[EnergyTerm], loss: Newton, start: Tensor, steps: int) -> Tensor:
    """By whole Newton's steps with the true Hessian over the free coordinates."""
    slots = step.free.repeat_interleave(3)
    x = start.clone()
    for _ in range(steps):
        gradient = torch.autograd.functional.jacobian(lambda p: potential(p, step, terms, loss), x).reshape(-1)
        hessian = torch.autograd.functional.hessian(lambda p: potential(p, step, terms, loss), x)
        hessian = hessian.reshape(len(slots), -1)[slots][:, slots]
        move = torch.zeros_like(gradient)
        move[slots] = torch.linalg.solve(hessian, gradient[slots])
        x = x - move.view(-1, 3)
    return x


def judged(loss: Newton, x: Tensor, step: Step, terms: Sequence[EnergyTerm]) -> tuple[dict[str, Tensor], Tensor]:
    """Values, and the gradient of the total."""
    x = x.detach().clone().requires_grad_()
    values = loss(Prediction(x, step, x.detach(), terms, 1.0))
    (gradient,) = torch.autograd.grad(loss.total(values), x)
    return {name: value.detach() for name, value in values.items()}, gradient


def landing(loss: Newton, x: Tensor, step: Step, terms: Sequence[EnergyTerm]) -> Tensor:
    """Where the gradient of the loss says that the step ends: x' - z."""
    _, gradient = judged(loss, x, step, terms)
    return x - gradient * step.free.sum() * (step.dt**2 * loss.scale) ** 2


@pytest.fixture
def no_contact(monkeypatch):
    """Potentials of a step without a body: contact has nothing to search there."""
    terms = Potential.terms
    monkeypatch.setattr(Potential, "terms", lambda self, p: [t for t in terms(self, p) if t.name != "contact"])


@pytest.mark.usefixtures("no_contact")
def test_free_fall_is_known():
    """Inertia and gravity alone: from anywhere the step lands on x + dt v + dt² g, and no fall at all costs ½."""
    step, x_next = free_of_body(square_grid(1.0, 4))
    step = replace(step, gravity=torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64), external_force=None)
    fallen = step.inertial + step.dt**2 * step.gravity
    torch.testing.assert_close(landing(newton(), x_next, step, [])[step.free], fallen[step.free])
    values, _ = judged(newton(), step.inertial, step, [])
    assert float(values["newton"]) == pytest.approx(0.5, rel=1e-9)
    values, gradient = judged(newton(), fallen, step, [])
    assert float(values["newton"]) < 1e-20
    assert gradient.abs().max() < 1e-9


@pytest.mark.usefixtures("no_contact")
def test_a_quadratic_potential_is_left_in_one_step():
    """With coupled vertices and pins: x' - z is the minimiser, and the loss is half the squared way there."""
    step, x_next = free_of_body(square_grid(1.0, 5))
    terms, loss = [Tethers(40.0)], newton()
    lowest = minimum(step, terms, loss, x_next, steps=1)
    uncoupled = step.inertial + step.dt**2 * step.gravity
    assert (lowest - uncoupled)[step.free].norm(dim=1).max() > 1e-3, "the tethers must have a part in it"
    torch.testing.assert_close(landing(loss, x_next, step, terms)[step.free], lowest[step.free])
    values, _ = judged(loss, x_next, step, terms)
    way = (x_next - lowest)[step.free] / (step.dt**2 * loss.scale)
    torch.testing.assert_close(values["newton"], 0.5 * way.square().sum(1).mean())


def test_at_a_minimum_the_loss_and_its_gradient_vanish():
    """Of the whole potential with a fabric and a body, not quadratic at all; beside it they do not."""
    step, x_next = make_step(square_grid(1.0, 4))
    terms, loss = [ElasticEnergy(law(), transfer=False)], newton()
    lowest = step.inertial
    for _ in range(120):  # damped, with the Hessian of the loss itself
        lowest = torch.where(step.free[:, None], lowest + 0.5 * (landing(loss, lowest, step, terms) - lowest), lowest)
    p = lowest.clone().requires_grad_()
    (slope,) = torch.autograd.grad(potential(p, step, terms, loss), p)
    assert slope[step.free].abs().max() < 1e-6, "the test has found no minimum"
    values, gradient = judged(loss, lowest, step, terms)
    assert float(values["newton"]) < 1e-12
    assert gradient.abs().max() < 1e-6
    assert float(judged(loss, x_next, step, terms)[0]["newton"]) > 1e-3


@pytest.mark.usefixtures("no_contact")
def test_longest_caps_steps_and_keeps_their_direction():
    step = replace(free_of_body(square_grid(1.0, 4))[0], external_force=None)
    away = (
        torch.linspace(0.02, 0.3, len(step.x), dtype=torch.float64)[:, None] * torch.tensor([0.6, 0.0, -0.8]).double()
    )
    x_next = step.inertial + step.dt**2 * step.gravity + away
    capped = (x_next - landing(newton(longest=0.1), x_next, step, []))[step.free]
    length = away.norm(dim=1, keepdim=True)[step.free]
    assert (length > 0.1).any()
    assert (length < 0.1).any()
    torch.testing.assert_close(capped, away[step.free] * length.clamp(max=0.1) / length)


@pytest.mark.usefixtures("no_contact")
def test_pinned_vertices_do_not_move_and_do_not_count():
    """No gradient there; where they are held matters for their neighbours only through the terms."""
    step, x_next = free_of_body(square_grid(1.0, 5))
    loss = newton()
    _, gradient = judged(loss, x_next, step, [Tethers(40.0)])
    assert 0 < (~step.free).sum() < len(step.free)
    assert torch.equal((gradient == 0.0).all(1), ~step.free)
    shifted = torch.where(step.free[:, None], x_next, x_next + 5.0)
    alone, same = (judged(loss, x, step, [])[0]["newton"] for x in (x_next, shifted))
    torch.testing.assert_close(alone, same)
    coupled, other = (judged(loss, x, step, [Tethers(40.0)])[0]["newton"] for x in (x_next, shifted))
    assert abs(float(coupled - other)) > 1e-3


@pytest.mark.usefixtures("no_contact")
def test_batch_equals_singles():
    """Two meshes of different size in one batch: the steps of each alone; the loss is the mean over all vertices."""
    meshes, loss, terms = [square_grid(1.0, 5), disc(0.5, 3, 0.3)], newton(), [Tethers(40.0)]
    step, x_next = free_of_body(*meshes)
    singles = [free_of_body(mesh) for mesh in meshes]
    expected = torch.cat([landing(loss, x, single, terms) for single, x in singles])
    torch.testing.assert_close(landing(loss, x_next, step, terms), expected)
    counts = torch.tensor([float(single.free.sum()) for single, _ in singles], dtype=torch.float64)
    parts = torch.stack([judged(loss, x, single, terms)[0]["newton"] for single, x in singles])
    torch.testing.assert_close(judged(loss, x_next, step, terms)[0]["newton"], (counts * parts).sum() / counts.sum())


def test_a_second_step_of_the_same_mesh_is_not_the_first_again():
    """What is remembered of a mesh is the places of entries, not their values."""
    step, x_next = make_step(square_grid(1.0, 4))
    terms, loss = [ElasticEnergy(law(), transfer=False)], newton()
    judged(loss, x_next, step, terms)
    heavier, moved = replace(step, mass=3.0 * step.mass, v=0.5 * step.v), 1.01 * x_next
    again, fresh = (judged(each, moved, heavier, terms) for each in (loss, newton()))
    torch.testing.assert_close(again[0]["newton"], fresh[0]["newton"])
    torch.testing.assert_close(again[1], fresh[1])


def test_energies_are_those_of_the_potential():
    """They are logged, and count as much as they are asked to, with their gradient."""
    step, x_next = make_step(square_grid(1.0, 4))
    terms = [ElasticEnergy(law(), transfer=False)]
    logged, slope = judged(Potential(1.0, **CONTACT), x_next, step, terms)
    alone, of_step = judged(newton(), x_next, step, terms)
    assert set(alone) == {*logged, "newton"} == {"inertia", "gravity", "external", "elastic", "contact", "newton"}
    torch.testing.assert_close({name: alone[name] for name in logged}, logged)
    x = x_next.clone().requires_grad_()
    values = newton()(Prediction(x, step, x.detach(), terms, 1.0))
    assert values["newton"].requires_grad
    assert newton().total(values) == values["newton"]
    assert newton(weight=0.5).total(values) == 0.5 * values["newton"]
    loss = newton(energies=0.3, weight=0.5)
    both, gradient = judged(loss, x_next, step, terms)
    torch.testing.assert_close(gradient, 0.5 * (of_step + 0.3 * slope))
    energies = torch.stack(list(logged.values())).sum()
    torch.testing.assert_close(loss.total(both), 0.5 * (alone["newton"] + 0.3 * energies))


def test_the_graph_is_that_of_the_prediction_alone():
    """The step is taken as given: the gradient is z / (dt² scale)², as if x' - z were a recorded frame."""
    step, x_next = make_step(square_grid(1.0, 4))
    terms, loss = [ElasticEnergy(law(), transfer=False)], newton()
    values, gradient = judged(loss, x_next, step, terms)
    z = gradient * step.free.sum() * (step.dt**2 * loss.scale) ** 2
    way = z[step.free] / (step.dt**2 * loss.scale)
    torch.testing.assert_close(values["newton"], 0.5 * way.square().sum(1).mean())
