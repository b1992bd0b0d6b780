"""Cloth that goes with the body and hardly stretches: against a body in uniform motion and stretched cloth."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from drape.energy.step import ObstacleStep, Step
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.simulators.advance import advance
from drape.simulators.kinematic.edge_lengths import nearer_to_rest
from drape.simulators.kinematic.prior import KinematicPrior
from tests.networks import make_network
from tests.terms import make_step, moved

VELOCITY = torch.tensor([0.3, -0.6, 0.15], dtype=torch.float64)
"""Of the floor [m/s]."""


class Constant(nn.Module):
    """A network that always predicts the same accelerations, 0 at pinned vertices."""

    def __init__(self, value: float):
        super().__init__()
        self.value = value

    def forward(self, step: Step) -> Tensor:
        return torch.full_like(step.x, self.value) * step.free[:, None]


def over_floor(heights: list[float]) -> Step:
    """A cloth of four vertices at ``heights`` above a floor in uniform motion; all are free."""
    step, _ = make_step(square_grid(0.2, 2))
    floor = square_grid(2.0, 2)
    x = step.mesh.rest_positions.clone()
    x[:, 2] = torch.tensor(heights, dtype=torch.float64)
    # off the middle: no vertex lies above an edge of the floor
    below = torch.from_numpy(floor.rest_positions.astype(float)) - torch.tensor([0.31, 0.2, 0.0])
    faces = torch.from_numpy(floor.faces.copy())
    body = ObstacleStep(faces, below, below + step.dt * VELOCITY, torch.zeros(len(faces), dtype=torch.long))
    return replace(step, x=x, free=torch.ones_like(step.free), obstacle=body)


def goes_with(inner: nn.Module, share: float, reach: float = 0.1) -> KinematicPrior:
    """Without :func:`nearer_to_rest`."""
    return KinematicPrior(inner, share, 0, reach)


def network() -> KinematicPrior:
    return goes_with(make_network(), 0.8)


def test_on_the_body_cloth_goes_with_it():
    """Share 1 at distance 0: after the step the cloth has the velocity of the body, and stays where it is on it."""
    step = over_floor([0.0, 0.0, 0.0, 0.0])
    following = goes_with(Constant(0.0), 1.0)
    torch.testing.assert_close(following(step), (VELOCITY - step.v) / step.dt)
    torch.testing.assert_close(advance(following, step), step.x + step.dt * VELOCITY)


def test_the_share_decays_with_distance():
    """0.8 (1 - (d / 100 mm)²) of the relative velocity is gone after a step, on top of what the network says."""
    heights = [0.0, 0.01, 0.02, 0.06]
    step = over_floor(heights)
    gone = 0.8 * (1.0 - (torch.tensor(heights, dtype=torch.float64) / 0.1) ** 2)
    expected = 2.5 + gone[:, None] * (VELOCITY - step.v) / step.dt
    torch.testing.assert_close(goes_with(Constant(2.5), 0.8)(step), expected)


def test_inside_the_body_the_share_does_not_grow():
    step = over_floor([-0.03, -0.001, 0.0, 0.0])
    found = goes_with(Constant(0.0), 0.8)(step)
    torch.testing.assert_close(found, 0.8 * (VELOCITY - step.v) / step.dt)


def test_beyond_the_reach_nothing_is_felt():
    """Of heights on both sides of the reach, those beyond have exactly what the network says."""
    step = over_floor([0.039, 0.041, 0.02, 0.3])
    found = goes_with(Constant(1.0), 1.0, 0.04)(step)
    assert torch.equal((found == 1.0).all(1), torch.tensor([False, True, False, True]))


def test_cloth_that_moves_with_the_body_is_left_alone():
    step = over_floor([0.0, 0.01, 0.02, 0.06])
    step = replace(step, v=VELOCITY.expand_as(step.v))
    torch.testing.assert_close(goes_with(Constant(1.5), 0.8)(step), torch.full_like(step.x, 1.5))


def test_cloth_goes_on_turning_with_a_turning_body():
    """A floor that turns about an axis of space: with share 1 cloth above it keeps its place over it, rigidly, however
    high it is; velocities that point elsewhere do not matter."""
    step, _ = make_step(square_grid(0.2, 4))
    generator = torch.Generator().manual_seed(3)
    x = step.mesh.rest_positions + 0.01 * torch.rand(16, 3, generator=generator, dtype=torch.float64)
    floor = square_grid(2.0, 2)
    below = torch.from_numpy(floor.rest_positions.astype(float)) - torch.tensor([0.31, 0.2, 0.03])
    turn = torch.linalg.matrix_exp(torch.tensor([[0.0, -0.3, 0.1], [0.3, 0.0, -0.2], [-0.1, 0.2, 0.0]]).double())
    faces = torch.from_numpy(floor.faces.copy())
    body = ObstacleStep(faces, below, below @ turn.T + 0.01, torch.zeros(len(faces), dtype=torch.long))
    step = replace(step, x=x, free=torch.ones_like(step.free), obstacle=body)
    gone = 1.0 - ((x[:, 2:] + 0.03) / 0.1) ** 2
    expected = x + gone * (x @ turn.T + 0.01 - x) + (1.0 - gone) * step.dt * step.v
    torch.testing.assert_close(advance(goes_with(Constant(0.0), 1.0), step), expected, rtol=0.0, atol=1e-6)


def test_pinned_vertices_are_not_accelerated():
    step = over_floor([0.0, 0.0, 0.0, 0.0])
    step = replace(step, free=torch.tensor([True, False, True, False]))
    found = goes_with(Constant(1.0), 1.0)(step)
    assert torch.equal((found == 0.0).all(1), ~step.free)


def test_yaw_turns_the_prediction_and_translation_leaves_it():
    step, _ = make_step(square_grid(1.0, 8))
    step = replace(step, gravity=torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64))
    following = network()
    expected = following(step)
    assert (expected - following.network(step)).norm(dim=1).max() > 1.0, "the body must have a part in it"
    c, s = math.cos(2.0), math.sin(2.0)
    turn = torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    found = following(moved(step, turn, torch.tensor([3.0, -5.0, 0.7])))
    assert (found - expected @ turn.T).abs().max() < 1e-5 * expected.abs().max()


def test_batch_equals_singles():
    """Each cloth of a batch follows its own body: here one floor moves, and the other one rests."""
    batch, _ = make_step(square_grid(0.2, 2), square_grid(0.2, 2))
    single = over_floor([0.0, 0.01, 0.02, 0.03])
    body = single.obstacle
    still = replace(single, obstacle=replace(body, x_next=body.x))
    both = ObstacleStep(
        torch.cat([body.faces, body.faces + len(body.x)]),
        body.x.repeat(2, 1),
        torch.cat([body.x_next, body.x]),
        torch.arange(2).repeat_interleave(len(body.faces)),
    )
    batch = replace(batch, x=single.x.repeat(2, 1), free=single.free.repeat(2), obstacle=both)
    following = goes_with(Constant(0.0), 0.8)
    expected = torch.cat([following(single), following(still)])
    torch.testing.assert_close(following(batch), expected)
    assert (expected[:4] - expected[4:]).abs().max() > 1.0


def test_share_zero_and_no_obstacle_are_the_network_alone():
    """Bit for bit, and without a search."""
    step = over_floor([0.0, 0.01, 0.02, 0.03])
    alone = replace(step, obstacle=None)
    assert torch.equal(goes_with(Constant(1.0), 0.0)(step), Constant(1.0)(step))
    assert "near" not in vars(step)
    assert torch.equal(goes_with(Constant(1.0), 1.0)(alone), Constant(1.0)(alone))


def test_only_the_network_learns():
    """What is added is a constant of the step: gradients are those of the network, and it has the only parameters."""
    step, _ = make_step(square_grid(1.0, 8))
    following = network()
    weights = torch.randn_like(step.x)
    names = [name for name, _ in following.named_parameters()]
    assert all(name.startswith("network.") for name in names)
    parameters = list(following.parameters())
    alone = replace(step, obstacle=step.obstacle)
    found = torch.autograd.grad((weights * following(step)).sum(), parameters)
    expected = torch.autograd.grad((weights * following.network(following._following(alone))).sum(), parameters)
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other)


def test_single_precision_stays_single():
    step = over_floor([0.0, 0.01, 0.02, 0.03])
    body = step.obstacle
    single = replace(
        step,
        x=step.x.float(),
        v=step.v.float(),
        obstacle=replace(body, x=body.x.float(), x_next=body.x_next.float()),
    )
    following = goes_with(Constant(0.0), 0.8)
    found = following(single)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found.double(), following(step), rtol=1e-4, atol=1e-3)


def test_the_network_is_told_the_velocity_with_the_body():
    """And what it has predicted comes on top."""

    class Telling(nn.Module):
        def forward(self, step: Step) -> Tensor:
            return 10.0 * step.v

    step = over_floor([0.0, 0.01, 0.02, 0.06])
    gone = 0.8 * (1.0 - (step.x[:, 2:] / 0.1) ** 2)
    v = step.v + gone * (VELOCITY - step.v)
    torch.testing.assert_close(goes_with(Telling(), 0.8)(step), (v - step.v) / step.dt + 10.0 * v)


def test_an_edge_between_two_free_vertices_gets_its_length_from_both():
    """A cloth stretched about a vertex at rest: an edge of two ends, by hand; and rest is left as it is."""
    mesh = MeshBatch.from_meshes([square_grid(0.2, 2)])
    free = torch.ones(4, dtype=torch.bool)
    rest = mesh.rest_positions
    torch.testing.assert_close(nearer_to_rest(rest, mesh, free, 3), rest)
    x = rest.clone()
    x[0] *= 1.1
    expected = x.clone()
    for i in range(4):
        ends = [pair for pair in mesh.edges.tolist() if i in pair]
        for pair in ends:
            j = pair[0] + pair[1] - i
            arm = x[j] - x[i]
            expected[i] += (1.0 - (rest[j] - rest[i]).norm() / arm.norm()) * arm / len(ends)
    torch.testing.assert_close(nearer_to_rest(x, mesh, free, 1), expected)


def test_edges_come_nearer_to_rest_and_pins_stay():
    mesh = MeshBatch.from_meshes([square_grid(1.0, 8)])
    free = torch.ones(64, dtype=torch.bool)
    free[:3] = False
    generator = torch.Generator().manual_seed(0)
    x = 1.05 * mesh.rest_positions + 0.01 * torch.randn(64, 3, generator=generator, dtype=torch.float64)

    def off(x: Tensor) -> float:
        first, second = mesh.edges.unbind(1)
        return float(((x[second] - x[first]).norm(dim=1) / mesh.rest_lengths - 1.0).square().mean())

    errors = [off(nearer_to_rest(x, mesh, free, rounds)) for rounds in (0, 4, 16, 64)]
    assert all(after < 0.9 * before for before, after in zip(errors[:-1], errors[1:], strict=True))
    plain = x
    for _ in range(16):  # each by itself: Jacobi's, without Chebyshev's weights
        plain = nearer_to_rest(plain, mesh, free, 1)
    assert errors[2] < 0.8 * off(plain)
    assert torch.equal(nearer_to_rest(x, mesh, free, 4)[:3], x[:3])


def test_stiffness_does_not_blow_up_positions_far_from_rest():
    """The iteration never grows: crumpled at random, after a thousand rounds nothing is farther apart than at first."""
    mesh = MeshBatch.from_meshes([square_grid(1.0, 8)])
    x = torch.randn(64, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    after = nearer_to_rest(x, mesh, torch.ones(64, dtype=torch.bool), 1000)
    assert torch.isfinite(after).all()
    assert after.norm(dim=1).max() < x.norm(dim=1).max()


def test_gradient_through_the_rounds():
    mesh = MeshBatch.from_meshes([square_grid(0.2, 3)])
    free = torch.arange(9) != 4
    x = (mesh.rest_positions + 0.01 * torch.randn(9, 3, dtype=torch.float64)).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: nearer_to_rest(x, mesh, free, 3), (x,))


def test_rounds_are_the_last_word():
    """What the step ends at is what the network and the body say, with edges nearer to rest."""
    step = over_floor([0.0, 0.01, 0.02, 0.06])
    step = replace(step, x=1.2 * step.x, free=torch.tensor([True, True, False, True]))
    before = advance(goes_with(Constant(1.5), 0.8), step)
    after = advance(KinematicPrior(Constant(1.5), 0.8, 2, 0.1), step)
    torch.testing.assert_close(after, nearer_to_rest(before, step.mesh, step.free, 2))


@pytest.mark.parametrize(
    "numbers",
    [
        (-0.1, 1, 0.1),
        (1.1, 1, 0.1),
        (0.5, 1, math.inf),
        (0.5, -1, 0.1),
        (0.5, 1, 0.0),
        (math.nan, 1, 1.0),
    ],
)
def test_numbers_out_of_range_are_refused(numbers):
    with pytest.raises(DrapeError, match="kinematic prior: share .* expected a share from 0 to 1, no less than 0"):
        KinematicPrior(Constant(0.0), *numbers)
