"""Graph networks that predict accelerations: what may and what must not change their predictions."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from drape.energy.step import ObstacleStep, Step
from drape.errors import DrapeError
from drape.geometry.disc import disc
from drape.geometry.grid import rectangular_grid, square_grid
from drape.simulators.neural.graph_acceleration import GraphAcceleration
from drape.simulators.neural.heading import Heading
from tests.networks import SCHEDULES, make_network, untrained
from tests.terms import converted, make_step, moved, renumbered


@pytest.fixture(params=SCHEDULES)
def network(request: pytest.FixtureRequest) -> GraphAcceleration:
    return make_network(request.param)


@pytest.fixture
def step() -> Step:
    """Only parts of the cloth are within reach of the body."""
    step, _ = make_step(square_grid(1.0, 8))
    return replace(step, gravity=torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64))


def yaw(angle: float) -> Tensor:
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)


def assert_same(found: Tensor, expected: Tensor, share: float = 1e-5) -> None:
    assert expected.norm(dim=-1).max() > 0.5, "a prediction of zeros would pass any test"
    assert (found - expected).norm(dim=-1).max() < share * expected.norm(dim=-1).max()


def body_off(step: Step, shift: Tensor) -> Step:
    body = step.obstacle
    return replace(step, obstacle=replace(body, x=body.x + shift, x_next=body.x_next + shift))


def test_yaw_turns_the_prediction(network: GraphAcceleration, step: Step):
    expected = network(step)
    for angle in (0.4, 2.0, -3.0):
        turn = yaw(angle)
        assert_same(network(moved(step, turn, torch.zeros(3))), expected @ turn.T)


def test_tilt_does_not(network: GraphAcceleration, step: Step):
    """Up is not sideways, or gravity and the way the cloth hangs would be nothing to learn from."""
    turn = yaw(0.5).roll((1, 1), (0, 1))
    assert (network(moved(step, turn, torch.zeros(3))) - network(step) @ turn.T).abs().max() > 1e-2


def test_translation_leaves_the_prediction(network: GraphAcceleration, step: Step):
    assert_same(network(moved(step, torch.eye(3).double(), torch.tensor([3.0, -50.0, 7.0]))), network(step))


@pytest.mark.parametrize("kind", SCHEDULES)
def test_numbers_of_vertices_play_no_role(kind: str):
    """On a disc, whose centre is one vertex: where several are as central, the first of them makes the hierarchy."""
    network, (step, _) = make_network(kind), make_step(disc(0.6, 5, 0.3))
    order = torch.randperm(step.mesh.num_vertices)
    assert_same(network(renumbered(step, order)), network(step)[order])


def test_batch_equals_singles(network: GraphAcceleration):
    meshes = [square_grid(1.0, 8), disc(0.5, 4, 0.3)]
    batch, singles = make_step(*meshes)[0], [make_step(mesh)[0] for mesh in meshes]
    materials = torch.rand(2, 5, dtype=torch.float64)
    singles = [replace(single, attributes=material[None]) for single, material in zip(singles, materials, strict=True)]
    expected = torch.cat([network(single) for single in singles])
    assert_same(network(replace(batch, attributes=materials)), expected)


def test_pinned_vertices_are_not_accelerated(network: GraphAcceleration, step: Step):
    predicted = network(step)
    assert 0 < (~step.free).sum() < len(step.free)
    assert torch.equal((predicted == 0.0).all(-1), ~step.free)


def test_body_matters_only_within_reach(network: GraphAcceleration, step: Step):
    alone = network(replace(step, obstacle=None))
    far = body_off(step, torch.tensor([0.0, 0.0, -0.06]))
    assert len(far.near_vertices(0.1).points)
    assert_same(network(far), alone)
    assert (network(step) - alone).abs().max() > 1e-2
    assert (network(body_off(step, torch.tensor([0.0, 0.0, -0.01]))) - network(step)).abs().max() > 1e-3


def test_a_vertex_deep_inside_the_body_still_feels_it(network: GraphAcceleration, step: Step):
    """Else it could never find its way out."""
    deep = body_off(step, torch.tensor([0.0, 0.0, 0.06]))
    distance = deep.near_vertices(0.1).distance
    assert (distance < -0.04).any()
    edges = network.inputs.of(deep, Heading(deep.x, deep.mesh)).edges
    assert len(edges["body"]) == len(distance[distance <= 0.04]) > 0


def test_without_obstacle_nothing_is_searched(network: GraphAcceleration, step: Step):
    alone = replace(step, obstacle=None)
    edges = network.inputs.of(alone, Heading(alone.x, alone.mesh)).edges
    assert "body" not in edges
    predicted = network(alone)
    predicted.square().sum().backward()
    assert torch.isfinite(predicted).all()
    assert all(p.grad is None for p in network.net.edge_encoders["body"].parameters())


def test_a_finer_body_is_the_same_body(network: GraphAcceleration, step: Step):
    """Each face cut in four: the closest points, their motion and the normals stay."""
    body = step.obstacle
    corners, count = body.faces, len(body.x)
    sides = torch.stack([corners, corners.roll(-1, 1)], -1).reshape(-1, 2)
    a, b, c = corners.unbind(1)
    ab, bc, ca = (count + torch.arange(len(sides))).reshape(-1, 3).unbind(1)
    faces = torch.cat([torch.stack(f, 1) for f in [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]])
    x, x_next = (torch.cat([p, p[sides].mean(1)]) for p in (body.x, body.x_next))
    fine = replace(body, faces=faces, x=x, x_next=x_next, mesh_of_face=body.mesh_of_face.repeat(4))
    inside = step.near_vertices(0.1).barycentric.amin(1) > 1e-3
    assert inside.sum() > 10
    assert_same(network(replace(step, obstacle=fine)), network(step), 1e-4)


def test_features_over_a_floor():
    """A flat cloth 10 mm above a floor that moves: all that the network is told, in numbers."""
    cloth, floor = square_grid(0.4, 3), square_grid(2.0, 2)
    step, _ = make_step(cloth)
    x, shift = step.mesh.rest_positions, torch.tensor([0.03, 0.0, 0.004], dtype=torch.float64)
    below = torch.from_numpy(floor.rest_positions.astype(float)) - torch.tensor([0.1, 0.2, 0.01])
    faces = torch.from_numpy(floor.faces.copy())
    body = ObstacleStep(faces, below, below + shift, torch.zeros(len(faces), dtype=torch.long))
    step = replace(step, x=x, v=0.1 * step.v, obstacle=body)
    nodes, edges, points = make_network("mgn_h").inputs.of(step, Heading(x, step.mesh))
    count, up = len(x), torch.tensor([0.0, 0.0, 1.0]).double()
    levels = step.mesh.coarse_levels(2)

    velocity, normal, along, mass, drive, attributes, kind, level = nodes[:count].split([3, 3, 3, 1, 3, 5, 3, 3], 1)
    torch.testing.assert_close(velocity, step.v / 2.0)
    torch.testing.assert_close(normal, up.expand_as(x))
    torch.testing.assert_close(along, (shift / step.dt - step.v) / step.dt / 7.0)
    torch.testing.assert_close(mass[:, 0], (step.mass / 0.2).log())
    torch.testing.assert_close(drive, (step.gravity + step.external_force / step.mass[:, None]) / 9.81)
    torch.testing.assert_close(attributes, step.attributes.expand(count, -1))
    assert torch.equal(kind, torch.stack([step.free, ~step.free, torch.zeros_like(step.free)], 1).double())
    assert torch.equal(level.argmax(1), levels.level)
    expected = torch.cat([shift / step.dt / 2.0, up, torch.zeros(14), torch.ones(1), torch.zeros(3)])
    torch.testing.assert_close(nodes[count:], expected.expand(count, -1))

    # 10 mm above the floor at t; without forces at x + dt v, over a floor that has risen; contact begins at 20 mm
    after = 0.01 * up - shift + step.dt * step.v
    arms = torch.stack([(0.01 * up).expand(count, 3), after], 1) / 0.04
    heights = after[:, 2:]
    assert (heights < 0.02).any()
    numbers = [
        arms.norm(dim=2),
        torch.full((count, 1), 0.25).double(),
        heights / 0.04,
        (1 - heights / 0.02).clamp(min=0),
    ]
    expected = torch.cat([arms.flatten(1), up.expand(count, 3), *numbers], 1)
    torch.testing.assert_close(edges["body"].features, expected)
    assert torch.equal(points.vertices, torch.arange(count))
    assert torch.equal(edges["body"].senders, count + torch.arange(count))
    assert torch.equal(edges["body"].receivers, torch.arange(count))
    assert torch.equal(edges["body"].level, levels.level)

    stretched = replace(step, x=1.5 * x, v=0.3 * x / step.dt)
    edges = make_network("mgn_h").inputs.of(stretched, Heading(stretched.x, step.mesh)).edges
    for name, pairs in {"mesh": step.mesh.edges, "coarse_1": levels.edges[0]}.items():
        edge_set = edges[name]
        both = torch.cat([pairs, pairs.flip(1)]).tolist()
        assert sorted(torch.stack([edge_set.senders, edge_set.receivers], 1).tolist()) == sorted(both)
        rest = (x[edge_set.receivers] - x[edge_set.senders]) / 0.1
        length = rest.norm(dim=1, keepdim=True)
        # half as long again is 25 strains of 0.02, and so goes on to 40
        strains = torch.tensor([25.0, 40.0]).double().asinh().expand(len(rest), 2)
        arms = [1.5 * rest, 1.8 * rest, rest, strains[:, 1:] * rest / length]
        expected = torch.cat([*arms, length, strains, step.attributes.expand(len(rest), -1)], 1)
        torch.testing.assert_close(edge_set.features, expected)


def test_the_body_beyond_reach_is_not_gone_with(step: Step):
    """Only vertices within 40 mm are told which acceleration would let them go with the body; no body tells none."""
    network = make_network()
    near = step.near_vertices(0.1)
    reached = near.points[near.distance <= 0.04]
    assert 0 < len(reached) < len(near.points)
    told = network.inputs.of(step, Heading(step.x, step.mesh))[0][: len(step.x), 6:9]
    assert (told[reached] != 0.0).any(1).all()
    assert torch.equal((told != 0.0).any(1).nonzero()[:, 0], reached)
    alone = replace(step, obstacle=None)
    assert not network.inputs.of(alone, Heading(alone.x, alone.mesh))[0][:, 6:9].any()


def test_pinned_vertices_part_as_they_are_led(step: Step):
    """Between a led and a free vertex the edge is told the prescribed velocity, not the one the data had before."""
    first, second = step.mesh.edges.unbind(1)
    across = (step.free[first] != step.free[second]).nonzero()[0, 0]
    v = step.v.clone()
    v[~step.free] += torch.tensor([0.0, 0.0, 0.7], dtype=torch.float64)
    network, heading = make_network(), Heading(step.x, step.mesh)
    before, after = (network.inputs.of(s, heading).edges["mesh"].features for s in (step, replace(step, v=v)))
    sign = -1.0 if step.free[second[across]] else 1.0
    change = torch.tensor([0.0, 0.0, sign * 0.7 * step.dt / 0.1], dtype=torch.float64)
    torch.testing.assert_close((after - before)[across, 3:6], change)
    inside = (step.free[first] == step.free[second]).nonzero()[:, 0]
    torch.testing.assert_close(after[inside], before[inside])


def test_edges_pull_their_ends_together(step: Step):
    """The same answer at both ends, opposite along the edge: what edges add has no sum and no moment."""
    network = make_network()
    with torch.no_grad():
        network.net.decoder[-1].weight.zero_()
        network.net.edge_decoders["body"][-1].weight.zero_()
        network.net.edge_decoders["body"][-1].bias.zero_()
        network.net.decoder[-1].bias.zero_()
    free = replace(step, free=torch.ones_like(step.free))
    added = network(free)
    assert added.norm(dim=1).max() > 1.0
    assert added.sum(0).abs().max() < 1e-5 * added.abs().sum()
    moment = torch.linalg.cross(free.inertial, added)
    assert moment.sum(0).abs().max() < 1e-5 * moment.abs().sum()


def test_the_body_pushes_along_its_normal(step: Step):
    network = make_network()
    with torch.no_grad():
        for decoder in (network.net.decoder, network.net.edge_decoders["mesh"]):
            decoder[-1].weight.zero_()
            decoder[-1].bias.zero_()
    added = network(step)
    points = network.inputs.of(step, Heading(step.x, step.mesh)).points
    expected = torch.zeros_like(added)
    expected[points.vertices] = (added[points.vertices] * points.normal).sum(-1, keepdim=True) * points.normal
    torch.testing.assert_close(added, expected)
    pushed = points.vertices[step.free[points.vertices]]
    assert len(pushed) > 5
    assert (added[pushed].norm(dim=1) > 1e-3).all()


@pytest.mark.parametrize(
    "change",
    [
        lambda s: replace(s, v=s.v + 0.1),
        lambda s: replace(s, mass=1.2 * s.mass, external_force=1.2 * s.external_force),
        lambda s: replace(s, external_force=1.2 * s.external_force),
        lambda s: replace(s, gravity=1.1 * s.gravity),
        lambda s: replace(s, attributes=s.attributes + 0.1),
        lambda s: replace(s, free=s.free.roll(1)),
        lambda s: replace(s, obstacle=replace(s.obstacle, x_next=s.obstacle.x_next + 0.01)),
        lambda s: replace(s, dt=0.5 * s.dt),
        lambda s: replace(s, x=1.05 * s.x),
    ],
    ids=["velocity", "mass", "force", "gravity", "attributes", "pins", "motion of the body", "dt", "positions"],
)
def test_everything_told_is_heard(network: GraphAcceleration, step: Step, change):
    assert (network(change(step)) - network(step)).abs().max() > 1e-3


def test_rest_shape_is_heard(network: GraphAcceleration, step: Step):
    mesh = replace(step.mesh, rest_positions=1.1 * step.mesh.rest_positions)
    assert (network(replace(step, mesh=mesh)) - network(step)).abs().max() > 1e-3


def test_gradients_reach_all(network: GraphAcceleration, step: Step):
    x = step.x.clone().requires_grad_()
    network(replace(step, x=x)).square().sum().backward()
    assert (x.grad != 0.0).any(-1).all()
    silent = [name for name, p in network.named_parameters() if p.grad is None or not p.grad.any()]
    assert silent == []


def test_gradient_is_the_change():
    """Along the edges of the cloth; body points and heading are constants of a step."""
    network, (step, _) = make_network().double(), make_step(square_grid(1.0, 4))
    step = replace(step, obstacle=None)
    weights, direction = torch.randn_like(step.x), torch.randn_like(step.x)
    direction[:, :2] = 0.0

    def value(x: Tensor) -> Tensor:
        return (weights * network(replace(step, x=x))).sum()

    x = step.x.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(x), x)
    h = 1e-7  # longer steps cross kinks of ReLU
    numeric = (value(step.x + h * direction) - value(step.x - h * direction)) / (2 * h)
    assert (gradient * direction).sum().item() == pytest.approx(numeric.item(), rel=1e-4)


def test_double_precision_steps_give_single_precision_answers(network: GraphAcceleration, step: Step):
    predicted = network(step)
    single = network(converted(step, torch.float32))
    assert (predicted.dtype, single.dtype) == (torch.float64, torch.float32)
    assert_same(single.double(), predicted, 2e-5)
    assert_same(predicted, network.double()(step), 2e-5)


def test_double_precision_is_used_where_it_counts(step: Step):
    """A kilometre away positions in single precision are off by 0.06 mm; their differences in double are exact."""
    network, away = make_network(), torch.tensor([1000.0, 0.0, 0.0])
    assert_same(network(moved(step, torch.eye(3).double(), away)), network(step))


def test_hierarchy_reaches_farther():
    """A change at one end of a strip is felt so many edges away."""
    mesh = rectangular_grid((4.0, 0.1), (81, 3))
    step, _ = make_step(mesh)
    step = replace(step, obstacle=None, free=torch.ones_like(step.free))
    v = step.v.clone()
    v[torch.from_numpy(mesh.rest_positions[:, 0] < -1.99)] += 1.0

    def felt(kind: str) -> float:
        network = make_network(kind)
        change = (network(replace(step, v=v)) - network(step)).abs().amax(1)
        return float(step.mesh.rest_positions[change > 0.0, 0].max() + 2.0) / 0.05

    assert felt("mgn") == pytest.approx(3.0)
    assert felt("mgn_h") >= 12.0


def test_untrained_network_predicts_nearly_nothing(step: Step):
    predicted = untrained()(step)
    assert 0.0 < predicted.abs().max() < 0.2


def test_scale_of_the_output(step: Step):
    """Told the same, a network of twice the acceleration predicts twice as much."""
    single, double = make_network(acceleration=7.0), make_network(acceleration=14.0)
    double.inputs = single.inputs
    assert_same(double(step), 2.0 * single(step))


def test_scale_of_accelerations_told(step: Step):
    """Twice the typical acceleration halves the features that are accelerations, and no others."""
    heading = Heading(step.x, step.mesh)
    told, half = (make_network(acceleration=size).inputs.of(step, heading) for size in (7.0, 14.0))
    expected = told.nodes.clone()
    expected[:, 6:9] *= 0.5
    torch.testing.assert_close(half.nodes, expected)
    for name, edge_set in told.edges.items():
        torch.testing.assert_close(half.edges[name].features, edge_set.features)


def test_cloth_without_a_coarse_edge():
    """Two triangles: the coarse levels have no edges, and nothing else is missing."""
    network, (step, _) = make_network("mgn_h"), make_step(square_grid(1.0, 2))
    assert [len(edges) for edges in step.mesh.coarse_levels(2).edges] == [0, 0]
    assert torch.isfinite(network(step)).all()


def test_mistakes_are_sentences(step: Step):
    with pytest.raises(DrapeError, match="reach 0"):
        make_network(reach=0.0)
    with pytest.raises(DrapeError, match="speed 0"):
        make_network(speed=0.0)
    with pytest.raises(DrapeError, match="coarse"):
        untrained("mgn_h", coarse_levels=0)
    with pytest.raises(DrapeError, match="3 material attributes"):
        make_network()(replace(step, attributes=step.attributes[:, :3]))
