"""Contact and friction where the answer is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh

from drape.energy.step import ObstacleStep, Step
from drape.energy.terms.contact import Contact, PaperContact, SurfaceContact
from drape.energy.terms.free_motion import Gravity, Inertia
from drape.energy.terms.friction import Friction
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.nearest_faces import NearestFaces
from tests.terms import make_step, written_out

UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


def over_a_floor(height: float, turn: torch.Tensor | None = None) -> Step:
    """A cloth at rest ``height`` above a floor, turned about the origin with the floor; 1 N of weight a vertex."""
    turn = torch.eye(3, dtype=torch.float64) if turn is None else turn
    cloth, floor = square_grid(1.0, 5), square_grid(4.0, 4)
    step, _ = make_step(cloth)
    positions = torch.from_numpy(floor.rest_positions.astype(float)) @ turn.T
    faces = torch.from_numpy(floor.faces.copy())
    return replace(
        step,
        x=(step.mesh.rest_positions + height * UP) @ turn.T,
        v=torch.zeros_like(step.v),
        mass=torch.full_like(step.mass, 0.1),
        gravity=-10.0 * UP,
        obstacle=ObstacleStep(faces, positions, positions, torch.zeros(len(faces), dtype=torch.long)),
    )


def tilt(angle: float) -> torch.Tensor:
    """About the y axis: the floor falls towards +x."""
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]], dtype=torch.float64)


def with_body(step: Step, **changes: torch.Tensor) -> Step:
    return replace(step, obstacle=replace(step.obstacle, **changes))


def test_weight_rests_on_the_floor():
    """3 k (thickness - d)² = m g: the gradients of contact and weight cancel there, and only there."""
    contact = PaperContact(stiffness=1e6, thickness=2e-3)
    depth = math.sqrt(1.0 / 3e6)
    step = over_a_floor(2e-3 - depth)
    energy, push = contact.energy_and_gradient(step.x, step)
    _, weight = Gravity().energy_and_gradient(step.x, step)
    assert energy.item() == pytest.approx(25 * 1e6 * depth**3)
    assert (push + weight).abs().max() < 1e-9
    _, deeper = contact.energy_and_gradient(step.x - 1e-4 * UP, step)
    assert (deeper + weight)[:, 2].max() < -0.1


@pytest.mark.parametrize("kind", [PaperContact, SurfaceContact])
def test_in_a_scene_three_times_as_large_contact_begins_three_times_as_far_away(kind):
    """The contact itself stays as it is; its stiffness is that of both."""
    contact = kind(thickness=2e-3, reach=0.1)
    large = contact.enlarged(3.0)
    assert (large.thickness, large.reach, large.stiffness) == pytest.approx((6e-3, 0.3, contact.stiffness))
    assert (contact.thickness, contact.reach) == (2e-3, 0.1)
    step = touching(over_a_floor(5e-3), large)
    assert large(step.x, step).item() > 0
    assert contact(step.x, touching(step, contact)).item() == 0


def touching(step: Step, contact: Contact) -> Step:
    """The same step with the points that this contact asks for."""
    return replace(step, touching=contact.surface(step.mesh))


@pytest.mark.parametrize(("per_edge", "per_face"), [(0, 0), (1, 0), (2, 3)])
@pytest.mark.parametrize("areal_density", [0.2, 100.0])
def test_fabrics_of_any_weight_sink_in_alike(areal_density, per_edge, per_face):
    """By sqrt(g / (3 stiffness)): there all forces of a sheet on a floor cancel, whatever its vertices weigh."""
    contact = SurfaceContact(stiffness=2e7, thickness=5e-3, per_edge=per_edge, per_face=per_face)
    depth = math.sqrt(10.0 / (3 * 2e7))
    step = over_a_floor(5e-3 - depth)
    step = touching(replace(step, mass=areal_density / 25 * step.mass / step.mass.mean()), contact)
    weight = step.mass[:, None] * 10.0 * UP
    _, push = contact.energy_and_gradient(step.x, step)
    assert push.sum(0)[2].item() == pytest.approx(-weight.sum().item(), rel=1e-9)
    assert (push + weight).norm() < 0.5 * weight.norm(), "points of edges share the load of their two ends"
    _, deeper = contact.energy_and_gradient(step.x - 1e-5 * UP, step)
    assert deeper.sum(0)[2].item() < 1.01 * push.sum(0)[2].item()


def test_contact_is_felt_inside_a_face():
    """A small ball under the middle of a large triangle: felt by a point there, not by the vertices."""
    ball = trimesh.creation.icosphere(2, 0.05)
    mesh = square_grid(1.0, 2)
    step, _ = make_step(mesh)
    x = step.mesh.rest_positions
    under = torch.from_numpy(np.array(ball.vertices)) + x[step.mesh.faces[0]].mean(0) - 0.048 * UP
    faces = torch.from_numpy(np.array(ball.faces, dtype=np.int64))
    body = ObstacleStep(faces, under, under, torch.zeros(len(faces), dtype=torch.long))
    step = replace(step, x=x, obstacle=body)
    for contact, is_felt in ((PaperContact(), 0), (SurfaceContact(per_edge=1), 0), (SurfaceContact(per_face=1), 1)):
        there = touching(step, contact)
        energy, push = contact.energy_and_gradient(x, there)
        assert (energy.item() > 0) == is_felt
        corners = torch.zeros(len(x), dtype=torch.bool)
        corners[step.mesh.faces[0]] = is_felt
        assert torch.equal(push[:, 2] < 0, corners), "it lifts the three corners of the face"


def test_no_contact_beyond_the_thickness():
    """No energy at the thickness, none beyond."""
    for height in (2e-3, 1e-2):
        step = over_a_floor(height)
        energy, push = PaperContact().energy_and_gradient(step.x, step)
        assert energy.item() < 1e-30
        assert push.norm() < 1e-12


def test_the_body_is_met_where_it_will_be():
    """A floor that rises by 5 cm pushes a cloth that was 2 cm above it; one that sinks does not."""
    step = over_a_floor(0.02)
    rising = with_body(step, x_next=step.obstacle.x + 0.05 * UP)
    energy = PaperContact(stiffness=1.0)(step.x, rising)
    assert energy.item() == pytest.approx(25 * (0.03 + 2e-3) ** 3)
    sinking = with_body(step, x_next=step.obstacle.x - 0.05 * UP)
    assert PaperContact(stiffness=1.0)(step.x - 0.04 * UP, sinking).item() == 0.0


def test_what_is_far_at_the_start_takes_no_part():
    """Beyond the search range there is nothing to evaluate, even for a cloth that ends inside the body."""
    step = over_a_floor(0.2)
    contact = PaperContact(reach=0.1)
    assert len(step.near.within(0.1).points) == 0
    assert contact(step.x - 0.3 * UP, step).item() == 0.0
    assert not any(piece.blocks.any() for piece in written_out(contact.stencils(step.x - 0.3 * UP, step)))


def test_the_body_is_searched_once_a_step(monkeypatch):
    """Contact and friction of all iterations share one search."""
    searches = []
    find = NearestFaces.find
    monkeypatch.setattr(NearestFaces, "find", lambda *args: searches.append(0) or find(*args))
    step = over_a_floor(1e-3)
    contact = PaperContact()
    for term in (contact, Friction(0.5, contact)):
        for _ in range(3):
            term.energy_and_gradient(step.x, step)
            term.stencils(step.x, step)
    assert len(searches) == 1


def test_cloth_that_moves_with_the_body_does_not_slip():
    """Body and cloth turned and moved over the step: no friction energy, no force; also beside edges of the body."""
    step, _ = make_step(square_grid(1.0, 8))
    friction = Friction(0.5, PaperContact(thickness=0.05))
    near = step.near.within(0.1)
    assert near.along.norm(dim=-1).max() > 1e-4
    turn, shift = tilt(0.5), torch.tensor([0.1, 0.2, -0.3], dtype=torch.float64)
    carried = with_body(step, x_next=step.obstacle.x @ turn.T + shift)
    x_next = step.x @ turn.T + shift
    energy, gradient = friction.energy_and_gradient(x_next, carried)
    _, slipping = friction.energy_and_gradient(x_next + 0.01, carried)
    assert energy.item() < 1e-9
    assert slipping.norm() > 1.0
    assert gradient.norm() < 1e-6 * slipping.norm()


def test_friction_is_coulombs():
    """Against the slip, μ N above the slip speed whatever the slip, less below, nothing at rest and without contact."""
    contact = PaperContact(stiffness=1e6)
    depth = math.sqrt(1.0 / 3e6)
    step = over_a_floor(2e-3 - depth)
    friction = Friction(0.4, contact, slip_speed=1e-3)
    direction = torch.tensor([0.6, 0.8, 0.0], dtype=torch.float64)
    forces = []
    for speed in (0.0, 2e-4, 1.001e-3, 1.0):
        _, gradient = friction.energy_and_gradient(step.x + speed * step.dt * direction + 1e-3 * UP, step)
        assert (gradient - gradient[0]).abs().max() < 1e-9
        forces.append(float(gradient[0] @ direction))
        assert (gradient[0] - forces[-1] * direction).norm() < 1e-9
    assert forces == pytest.approx([0.0, 0.4 * (2 * 0.2 - 0.2**2), 0.4, 0.4], abs=1e-9)
    assert friction(over_a_floor(3e-3).x + direction, over_a_floor(3e-3)).item() == 0.0


@pytest.mark.parametrize(("coefficient", "slides"), [(0.3, True), (1.0, False)])
def test_a_slope(coefficient, slides):
    """On 30°, one step from rest: dt² g (sin α - μ cos α) down the slope, or creep below the slip speed."""
    angle = math.pi / 6.0
    turn = tilt(angle)
    contact = PaperContact(stiffness=1e6)
    depth = math.sqrt(math.cos(angle) / 3e6)
    step = over_a_floor(2e-3 - depth, turn)
    down = turn @ torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    terms = (Inertia(), Gravity(), contact, Friction(coefficient, contact))
    way = torch.zeros((), dtype=torch.float64)
    for _ in range(100):  # Newton along the slope; the other directions are in balance
        x = step.x + way * down
        slope = sum(term.energy_and_gradient(x, step)[1][0] @ down for term in terms)
        pieces = [s.blocks[0, 0, :, 0] for term in terms for s in written_out(term.stencils(x, step))]
        way = way - slope / sum(down @ piece @ down for piece in pieces)
    if slides:
        assert way.item() == pytest.approx(10.0 * (math.sin(angle) - coefficient * math.cos(angle)) * step.dt**2)
    else:
        assert 0.0 < way.item() < 1e-3 * step.dt


@pytest.mark.parametrize("make", [
    lambda: PaperContact(stiffness=0.0), lambda: PaperContact(thickness=-1e-3), lambda: PaperContact(reach=1e-3),
    lambda: PaperContact(reach=math.inf), lambda: Friction(0.0, PaperContact()),
    lambda: Friction(0.5, PaperContact(), 0.0),
])
def test_impossible_numbers_are_refused(make):
    with pytest.raises(DrapeError, match="expected finite numbers"):
        make()


def test_no_body_no_contact():
    step, x = make_step(square_grid(1.0, 3))
    with pytest.raises(DrapeError, match="no obstacle"):
        PaperContact()(x, replace(step, obstacle=None))
