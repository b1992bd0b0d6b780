"""LayersNet's accelerations: where the scene stands and faces, who is beside whom, and what is absent."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from torch import nn

from drape.energy.step import ObstacleStep, Step
from drape.errors import DrapeError
from drape.geometry import mesh_distances, nearest_points
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.nearest_faces import NearestFaces
from drape.geometry.nearest_points import NearestPoints
from drape.nets.layers_transformer import LayersTransformer
from drape.simulators.neural.heading import Heading
from drape.simulators.neural.layers_acceleration import LayersAcceleration
from tests.terms import converted, make_step, moved, renumbered

NET = partial(LayersTransformer, width=24, heads=4, layers=2)
SIZES = {
    "attributes": 5, "felt_reach": 0.1, "speed": 1.0, "acceleration": 10.0, "edge_length": 0.14, "mass": 0.2,
    "patch_size": 0.25, "patch_reach": 0.6, "world_neighbours": 5, "body_neighbours": 3,
}  # fmt: skip


def network(**changes) -> LayersAcceleration:
    """In float64, and with a last layer that is heard."""
    found = LayersAcceleration(NET, **SIZES | changes).double()
    nn.init.normal_(found.decoder.last.weight)
    return found


def uneven(resolution: int) -> ClothMesh:
    """A square without ties."""
    mesh = square_grid(1.0, resolution)
    x = mesh.rest_positions + 0.02 * np.random.default_rng(resolution).uniform(-1, 1, mesh.rest_positions.shape)
    return ClothMesh.from_faces(x, mesh.faces)


@pytest.fixture
def step() -> Step:
    return make_step(uneven(8))[0]


def turn(angle: float) -> torch.Tensor:
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0, math.pi, -1.5])
def test_turns_and_moves_with_the_scene(step, angle):
    """Turned about the vertical and moved, the prediction turns with the scene."""
    found, rotation = network(), turn(angle)
    there = moved(step, rotation, torch.tensor([30.0, -20.0, 5.0], dtype=torch.float64))
    expected = found(step) @ rotation.T
    assert expected.abs().max() > 1.0
    torch.testing.assert_close(found(there), expected, rtol=1e-7, atol=1e-8)


def test_tilted_scenes_differ(step):
    """Only turns about the vertical leave the prediction alone: the others are not built in."""
    tilt = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=torch.float64)
    found = network()
    assert (found(moved(step, tilt, torch.zeros(3))) - found(step) @ tilt.T).abs().max() > 0.1


def test_order_of_vertices_does_not_matter(step):
    """The order of vertices and faces is no part of the cloth."""
    order = torch.randperm(step.mesh.num_vertices)
    found = network()
    torch.testing.assert_close(found(renumbered(step, order)), found(step)[order], rtol=1e-8, atol=1e-9)


def test_batch_equals_singles():
    """Two garments of one place and time do not see each other, nor each other's body."""
    meshes, found = [uneven(8), uneven(6)], network()
    singles = [make_step(mesh)[0] for mesh in meshes]
    joined = found(make_step(*meshes)[0])
    torch.testing.assert_close(joined, torch.cat([found(single) for single in singles]), rtol=1e-8, atol=1e-9)


def test_pinned_vertices_do_not_accelerate(step):
    found = network()(step)
    assert (~step.free).any()
    assert (found[~step.free] == 0.0).all()
    assert (found[step.free].abs().sum(-1) > 0).all()


def test_untrained_is_nearly_silent(step):
    """Before training the cloth flies almost straight on."""
    assert LayersAcceleration(NET, **SIZES)(step).abs().max() < 0.05 * SIZES["acceleration"]


def test_nothing_is_searched_without_obstacle(step, monkeypatch):
    """No obstacle: no nearest faces and no senders, but a prediction as of a body far away."""
    found, alone = network(), replace(step, obstacle=None)
    body = step.obstacle
    far = replace(step, obstacle=replace(body, x=body.x + 50.0, x_next=body.x_next + 50.0))
    expected = found(far)

    monkeypatch.setattr(NearestFaces, "find", lambda *_: pytest.fail("searched"))
    torch.testing.assert_close(found(alone), expected)


@pytest.mark.parametrize("name", ["x", "v", "mass", "attributes", "gravity", "external_force"])
def test_everything_matters(step, name):
    """Each part of the step changes the prediction."""
    found = network()
    changed = replace(step, **{name: getattr(step, name) * 1.1})
    assert (found(changed) - found(step)).abs().max() > 1e-3


@pytest.mark.parametrize("name", ["x", "x_next"])
def test_the_body_matters_to_patches_and_to_vertices(step, name):
    """A body out of reach of the vertices is heard by the patches, and one in reach of the vertices only is felt."""
    body = step.obstacle
    shift = torch.tensor([0.0, 0.0, 0.01], dtype=torch.float64)
    pushed = replace(step, obstacle=replace(body, **{name: getattr(body, name) - shift}))
    for changes in ({"felt_reach": 1e-6}, {"body_reach": 1e-6}):
        found = network(**changes)
        assert (found(pushed) - found(step)).abs().max() > 1e-5


def test_rows_that_do_not_count_change_nothing(step, request):
    """As on a device, where the body near a vertex has a row for each of them."""
    found = network(felt_reach=0.02)
    expected, felt = found(step), found.inputs.near_body(step, Heading(step.x, step.mesh))
    assert 10 < int((felt == 0.0).all(-1).sum()) < len(felt) - 10
    request.getfixturevalue("fixed")
    torch.testing.assert_close(found(replace(step)), expected)


def test_gradients_are_finite(step):
    """All parameters are trained; at rest, where vertices lie at the centres of their patches, nothing breaks."""
    found = network(patch_size=0.01)
    x = step.mesh.rest_positions.clone().requires_grad_()
    resting = replace(step, x=x, v=torch.zeros_like(x))
    assert resting.mesh.patches(0.01).num_patches == resting.mesh.num_vertices
    found(resting).square().sum().backward()
    assert torch.isfinite(x.grad).all()
    assert x.grad.abs().max() > 0
    for name, parameter in found.named_parameters():
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().max() > 0, name


def test_gradient_of_positions(step):
    """Through all features, against differences; what is searched is constant."""
    found = network()
    direction, weights = torch.randn_like(step.x), torch.randn_like(step.x)
    still = replace(step, obstacle=None)

    def value(x: torch.Tensor) -> torch.Tensor:
        return (weights * found(replace(still, x=x))).sum()

    x = step.x.clone().requires_grad_()
    (slope,) = torch.autograd.grad(value(x), x)
    heading = Heading(step.x, step.mesh)
    with torch.no_grad(), pytest.MonkeyPatch.context() as patch:
        patch.setattr("drape.simulators.neural.layers_acceleration.Heading", lambda *_: heading)
        difference = (value(step.x + 1e-6 * direction) - value(step.x - 1e-6 * direction)) / 2e-6
    torch.testing.assert_close((slope * direction).sum(), difference, rtol=1e-5, atol=1e-6)


def test_single_precision_far_away(step):
    """The same prediction in single precision, also with the step in double and a kilometre away."""
    found = network()
    expected = found(step)
    found.float()
    single = found(converted(step, torch.float32))
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), expected, rtol=1e-2, atol=2e-3)
    far = found(moved(step, turn(0.0), torch.tensor([1000.0, 0.0, 0.0], dtype=torch.float64)))
    assert far.dtype == torch.float64
    torch.testing.assert_close(far, expected, rtol=1e-2, atol=2e-3)


def test_cloth_in_two_parts(step):
    """A garment of two sheets that do not touch: they hear each other in space, in any order."""
    mesh, other = uneven(8), square_grid(0.4, 5)
    rest = np.concatenate([mesh.rest_positions, other.rest_positions + [0.0, 0.1, 0.05]])
    both, _ = make_step(ClothMesh.from_faces(rest, np.concatenate([mesh.faces, other.faces + mesh.num_vertices])))
    found, upper = network(), both.v.clone()
    upper[mesh.num_vertices :] += 0.5
    change = found(replace(both, v=upper)) - found(both)
    assert (change[: mesh.num_vertices].abs().sum(-1)[both.free[: mesh.num_vertices]] > 0).any()
    order = torch.randperm(both.mesh.num_vertices)
    torch.testing.assert_close(found(renumbered(both, order)), found(both)[order], rtol=1e-8, atol=1e-9)


def test_faces_without_area(step):
    """A body with collapsed faces, and one with nothing else, break nothing."""
    flat = torch.zeros(1, 3, dtype=torch.long)
    body = step.obstacle
    faces = torch.cat([flat, body.faces])
    some = ObstacleStep(faces, body.x, body.x_next, torch.zeros(len(faces), dtype=torch.long))
    only = ObstacleStep(flat, body.x, body.x_next, torch.zeros(1, dtype=torch.long))
    none = ObstacleStep(flat[:0], body.x, body.x_next, torch.zeros(0, dtype=torch.long))
    for obstacle in (some, only, none):
        assert torch.isfinite(network()(replace(step, obstacle=obstacle))).all()


@pytest.mark.parametrize("device", ["tree", "chunks"])
def test_nearest_points(device, monkeypatch):
    """The few nearest of the own mesh within reach, against all distances."""
    if device == "chunks":
        other = lambda *_: nearest_points._from_distances(points, of_point, targets, of_target, 4)  # noqa: E731
        monkeypatch.setattr(nearest_points, "_from_tree", other)
        monkeypatch.setattr(mesh_distances, "CHUNK", 200)
    points, targets = torch.rand(40, 3).double(), torch.rand(60, 3).double()
    of_point, of_target = torch.arange(40) % 2, torch.arange(60) % 3
    near = NearestPoints.find(points, of_point, targets, of_target, 4, 0.4)
    distance = torch.cdist(points, targets).masked_fill(of_point[:, None] != of_target, torch.inf)
    for k in range(40):
        expected = distance[k].argsort()[:4]
        assert near.targets[k][near.found[k]].tolist() == expected[distance[k][expected] <= 0.4].tolist()
    assert 0 < near.found.sum() < 160
    assert torch.equal(near.pairs(near.found)[1], near.targets[near.found])


def test_world_and_mesh_neighbours_are_apart(step):
    """In space a patch hears others than those beside it on the cloth, at most so many, the nearest first."""
    found = network()
    patches = step.mesh.patches(SIZES["patch_size"])
    bodies = found.inputs.of_bodies(patches, step, Heading(step.x, step.mesh))
    edges = found.inputs.interactions(patches, bodies, step)
    mesh, world = (set(map(tuple, pairs.T.tolist())) for pairs in (edges.mesh, edges.world))
    assert mesh == set(map(tuple, patches.neighbours.T.tolist())) | {(p, p) for p in range(patches.num_patches)}
    place = patches.mean(step.x)
    for p in range(patches.num_patches):
        order = torch.cdist(place[p : p + 1], place)[0].argsort().tolist()
        others = [s for s in order if (p, s) not in mesh and (place[s] - place[p]).norm() <= SIZES["patch_reach"]]
        assert {s for r, s in world if r == p} == set(others[: SIZES["world_neighbours"]])
    assert edges.body[0].bincount().max() == SIZES["body_neighbours"]


@pytest.mark.parametrize("wrong", [{"speed": 0.0}, {"patch_size": -1.0}, {"mass": math.inf}, {"body_neighbours": 0}])
def test_impossible_numbers(wrong):
    with pytest.raises(DrapeError, match=next(iter(wrong))):
        network(**wrong)


def test_another_number_of_attributes(step):
    with pytest.raises(DrapeError, match="5 material attributes"):
        network(attributes=4)(step)
