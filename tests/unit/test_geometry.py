"""Lengths, angles and areas of edges: known values, symmetries, derivatives, and no bad number for any input."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from drape.geometry.edge_geometry import HALF_TURN, EdgeGeometry, subtract_angles
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from tests.conftest import bent

QUANTITIES = ("length", "area", "twist", "bend", "hinge", "hinge_change", "direction", "midpoint", "vertex_normals")


def of(mesh: ClothMesh) -> MeshBatch:
    return MeshBatch.from_meshes([mesh])


def angle(pair: Tensor) -> Tensor:
    return torch.atan2(pair[..., 1], pair[..., 0])


def rotation(seed: int = 3) -> Tensor:
    q, r = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)))
    q = q * r.diagonal().sign()
    return q * torch.linalg.det(q)


def reference_angles(n_i: np.ndarray, n_j: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """α and β of one edge by the book (docs/sources.md): twist between projections, difference of elevations."""
    p_i, p_j = n_i - n_i @ y * y, n_j - n_j @ y * y
    alpha = math.atan2(np.cross(p_j, p_i) @ y, p_i @ p_j)
    beta = math.atan2(n_i @ y, np.linalg.norm(p_i)) - math.atan2(n_j @ y, np.linalg.norm(p_j))
    return alpha, beta


def test_every_edge_against_a_plain_computation(cloth):
    """Lengths, areas, vertex normals, α and β, written as loops over numpy vectors."""
    mesh = of(cloth)
    x = bent(mesh.rest_positions)
    geometry, p = EdgeGeometry(x, mesh), x.numpy()
    crosses = [np.cross(p[b] - p[a], p[c] - p[a]) for a, b, c in cloth.faces]
    normals = np.zeros_like(p)
    for corners, cross in zip(cloth.faces, crosses, strict=True):
        normals[corners] += cross
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert geometry.vertex_normals.numpy() == pytest.approx(normals, abs=1e-8)
    for e, (i, j) in enumerate(cloth.edges):
        edge = p[j] - p[i]
        length = np.linalg.norm(edge)
        faces = {int(f) for f in cloth.edge_faces[e]}
        alpha, beta = reference_angles(normals[i], normals[j], edge / length)
        assert geometry.length[e].item() == pytest.approx(length, rel=1e-10)
        assert geometry.area[e].item() == pytest.approx(sum(np.linalg.norm(crosses[f]) / 2 for f in faces), rel=1e-10)
        assert angle(geometry.twist)[e].item() == pytest.approx(alpha, abs=1e-8)
        assert angle(geometry.bend)[e].item() == pytest.approx(beta, abs=1e-8)


def test_a_flat_cloth_has_no_angles(cloth_batch):
    geometry = EdgeGeometry(cloth_batch.rest_positions, cloth_batch)
    for pair in (geometry.twist, geometry.bend, geometry.hinge):
        assert torch.allclose(pair, torch.tensor([1.0, 0.0], dtype=torch.float64).expand_as(pair), atol=1e-9)
    assert torch.allclose(geometry.length, cloth_batch.rest_lengths, rtol=1e-10)


def test_area_of_interior_and_boundary_edges(cloth_batch):
    """γ is the sum of the adjacent faces: all areas of a grid are equal, a boundary edge has one of them."""
    area = EdgeGeometry(cloth_batch.rest_positions, cloth_batch).area
    face = 0.5 / 7**2
    expected = torch.where(cloth_batch.boundary, face, 2 * face).to(area)
    assert torch.allclose(area, expected, rtol=1e-6)


@pytest.mark.parametrize("radius", [0.4, 2.0])
def test_bend_of_a_cylinder(radius):
    """Along a cylinder of radius r the normals turn by ℓ/r: |β| between neighbours across the axis, 0 along it."""
    mesh = of(square_grid(1.0, 15))
    x, y, _ = mesh.rest_positions.unbind(-1)
    rolled = torch.stack([radius * torch.sin(x / radius), y, radius * torch.cos(x / radius)], -1)
    geometry = EdgeGeometry(rolled, mesh)
    across = mesh.edges[:, 1] - mesh.edges[:, 0] == 1
    along = mesh.edges[:, 1] - mesh.edges[:, 0] == 15
    inner = (mesh.rest_positions[mesh.edges][..., :2].abs() < 0.4).all(-1).all(-1)
    turned = torch.full_like(angle(geometry.bend)[across & inner], (1 / 14) / radius)
    assert torch.allclose(angle(geometry.bend)[across & inner].abs(), turned, rtol=1e-6)
    assert angle(geometry.bend)[along & inner].abs().max() < 1e-9
    assert angle(geometry.twist)[(across | along) & inner].abs().max() < 1e-7  # rest positions are float32


@pytest.mark.parametrize("degrees", [-120.0, -30.0, 30.0, 90.0, 150.0])
def test_hinge_of_two_faces(degrees):
    theta = math.radians(degrees)
    positions = np.array([[0, 0, 0], [1, 0, 0], [0.5, -1, 0], [0.5, 1, 0.0]])
    mesh = of(ClothMesh.from_faces(positions, np.array([[0, 2, 1], [0, 1, 3]])))
    x = torch.tensor(positions)
    x[3] = torch.tensor([0.5, math.cos(theta), math.sin(theta)])
    geometry = EdgeGeometry(x, mesh)
    hinge = angle(geometry.hinge)
    assert hinge[~mesh.boundary].abs().item() == pytest.approx(abs(theta))
    assert hinge[mesh.boundary].abs().max() < 1e-9


def test_the_sign_of_the_hinge_follows_the_side_of_the_fold(small_cloth):
    mesh = of(small_cloth)
    up, down = (EdgeGeometry(bent(mesh.rest_positions, amount), mesh).hinge for amount in (0.3, -0.3))
    assert torch.allclose(angle(up), -angle(down))
    assert angle(up).abs().max() > 0.1


def test_hinges_are_positive_where_the_cloth_bends_away_from_its_normals_however_it_is_numbered():
    """The sign of θ must not depend on the order of the faces or on the corner that a face begins with."""
    grid, random = square_grid(1.0, 8), np.random.default_rng(0)
    faces = np.stack([np.roll(corners, random.integers(3)) for corners in grid.faces])
    for numbered in (grid.faces, random.permutation(faces)):
        mesh = of(ClothMesh.from_faces(grid.rest_positions, numbered))
        x, y, _ = mesh.rest_positions.unbind(-1)
        convex = EdgeGeometry(torch.stack([x.sin(), y, x.cos()], -1), mesh)
        theta = angle(convex.hinge)[~mesh.boundary]
        assert theta.min() > -1e-6
        assert theta.max().item() == pytest.approx(1 / 7, rel=1e-6)


def fold(degrees: float) -> np.ndarray:
    """Two triangles at an edge along x, the second turned up by an angle; flat at 0."""
    theta = math.radians(degrees)
    return np.array([[0, 0, 0], [1, 0, 0], [0.5, -1, 0], [0.5, math.cos(theta), math.sin(theta)]])


def folded(rest: float, faces: tuple = ((0, 2, 1), (0, 1, 3))) -> MeshBatch:
    """The two triangles, at rest with an angle."""
    return of(ClothMesh.from_faces(fold(rest), np.array(faces)))


ANGLES = [-170.0, -100.0, -10.0, 10.0, 100.0, 170.0]


@pytest.mark.parametrize("degrees", ANGLES)
def test_change_of_the_hinge_of_two_faces(degrees):
    """In full, beyond a right angle too; a fold towards the normals counts negative, and so does the other winding."""
    x = torch.tensor(fold(degrees))
    for faces, sign in ((((0, 1, 2), (0, 3, 1)), 1.0), (((0, 2, 1), (0, 1, 3)), -1.0)):
        mesh = folded(0.0, faces)
        change = EdgeGeometry(x, mesh).hinge_change
        assert change[~mesh.boundary].item() == pytest.approx(sign * math.radians(degrees), abs=1e-9)
        assert (change[mesh.boundary] == 0.0).all()


@pytest.mark.parametrize("rest", [-100.0, 60.0, 165.0])
@pytest.mark.parametrize("degrees", [*ANGLES, 0.0])
def test_a_hinge_changes_from_the_angle_it_has_at_rest(rest, degrees):
    mesh = folded(rest)
    change = EdgeGeometry(torch.tensor(fold(degrees)), mesh).hinge_change[~mesh.boundary].item()
    difference = math.remainder(math.radians(rest - degrees), 2.0 * math.pi)
    assert change == pytest.approx(difference, abs=1e-9)
    assert EdgeGeometry(mesh.rest_positions, mesh).hinge_change.abs().max() < 1e-9


def test_a_hinge_closes_without_a_jump():
    """From one side to the other of the flat cloth, a degree at a time: equal steps, also through right angles."""
    mesh = folded(0.0)
    x = torch.stack([torch.tensor(fold(degrees)) for degrees in range(-179, 180)])
    change = EdgeGeometry(x, mesh).hinge_change[:, ~mesh.boundary]
    torch.testing.assert_close(change[1:] - change[:-1], torch.full_like(change[1:], -math.radians(1.0)))


def test_half_a_turn_is_passed_without_a_jump():
    """The size of the angle falls as it rose; folds of half a turn are on one side, whatever rounding says."""
    mesh, near = folded(0.0), np.array([-1.0, -1e-3, -1e-5, -1e-8, 0.0, 1e-8, 1e-5, 1e-3, 1.0])
    x = torch.stack([torch.tensor(fold(180.0 + degrees)) for degrees in near]).requires_grad_()
    change = EdgeGeometry(x, mesh).hinge_change[:, ~mesh.boundary][:, 0]
    np.testing.assert_allclose(change.abs().detach(), np.pi - np.radians(np.abs(near)), atol=1e-9)
    passed = np.radians(near) >= HALF_TURN
    assert passed.sum() == 2
    assert np.array_equal(np.sign(change.detach()), np.where(np.radians(near) <= -HALF_TURN, -1.0, 1.0))
    (slope,) = torch.autograd.grad(change.sum(), x)
    torch.testing.assert_close(slope, slope[:1].expand_as(slope), rtol=0.0, atol=0.05)


def test_a_face_without_area_has_no_hinge():
    """Wherever its third corner lies on the edge; the gradient there is finite, and so is the next."""
    mesh = folded(20.0)
    for place in (0.5, 0.0, 2.0):
        x = torch.tensor(fold(90.0))
        x[3] = torch.tensor([place, 0.0, 0.0])
        x.requires_grad_()
        change = EdgeGeometry(x, mesh).hinge_change
        (first,) = torch.autograd.grad(change.sum(), x, create_graph=True)
        (second,) = torch.autograd.grad(first.square().sum(), x, allow_unused=True)
        assert (change == 0.0).all()
        assert first.isfinite().all()
        assert second is None or second.isfinite().all()


def test_the_order_of_the_ends_does_not_matter(cloth_batch):
    x = bent(cloth_batch.rest_positions)
    swapped = replace(cloth_batch, edges=cloth_batch.edges.flip(-1))
    here, there = EdgeGeometry(x, cloth_batch), EdgeGeometry(x, swapped)
    for name in ("length", "area", "twist", "bend"):
        assert torch.allclose(getattr(here, name), getattr(there, name), atol=1e-12), name


def test_rigid_motion_changes_nothing(cloth_batch):
    x = bent(cloth_batch.rest_positions)
    turned = x @ rotation().T + torch.tensor([3.0, -2.0, 7.0])
    here, there = EdgeGeometry(x, cloth_batch), EdgeGeometry(turned, cloth_batch)
    for name in ("length", "area", "twist", "bend", "hinge", "hinge_change"):
        assert torch.allclose(getattr(here, name), getattr(there, name), atol=1e-11), name


def test_reversed_winding_negates_bend_only(cloth):
    mesh, flipped = of(cloth), of(ClothMesh.from_faces(cloth.rest_positions, cloth.faces[:, ::-1]))
    x = bent(mesh.rest_positions)
    here, there = EdgeGeometry(x, mesh), EdgeGeometry(x, flipped)
    assert (mesh.edges == flipped.edges).all()
    assert torch.allclose(angle(here.twist), angle(there.twist), atol=1e-10)
    assert torch.allclose(angle(here.bend), -angle(there.bend), atol=1e-10)
    assert angle(here.bend).abs().max() > 0.1


def test_a_mirror_image_negates_twist_only(cloth_batch):
    """Mirrored with the faces as they are, so that the normals follow the mirror with the opposite sign."""
    x = bent(cloth_batch.rest_positions)
    mirror = torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)
    here, there = EdgeGeometry(x, cloth_batch), EdgeGeometry(x * mirror, cloth_batch)
    assert torch.allclose(there.vertex_normals, -here.vertex_normals * mirror, atol=1e-9)
    rewound = of(ClothMesh.from_faces(cloth_batch.rest_positions.numpy(), cloth_batch.faces.numpy()[:, ::-1]))
    there = EdgeGeometry(x * mirror, rewound)
    assert torch.allclose(angle(here.twist), -angle(there.twist), atol=1e-10)
    assert torch.allclose(angle(here.bend), angle(there.bend), atol=1e-10)
    assert angle(here.twist).abs().max() > 0.05


def test_angles_subtract():
    a, b = torch.tensor([0.3, 2.9, -1.0], dtype=torch.float64), torch.tensor([0.1, -2.9, 2.0], dtype=torch.float64)
    pairs = [torch.stack([t.cos(), t.sin()], -1) for t in (a, b, a - b)]
    assert torch.allclose(subtract_angles(pairs[0], pairs[1]), pairs[2])


def test_a_leading_axis_is_a_batch_of_positions(cloth_batch):
    x = torch.stack([cloth_batch.rest_positions, bent(cloth_batch.rest_positions)])
    both = EdgeGeometry(x, cloth_batch)
    for name in QUANTITIES:
        for k in range(2):
            one = getattr(EdgeGeometry(x[k], cloth_batch), name)
            assert torch.allclose(getattr(both, name)[k], one, atol=1e-14), name


def test_components_lie_together_in_memory_on_the_way_there_and_back(cloth_batch):
    """Sums over the components are most of what training does with the geometry, and are slow in the other order."""
    x = bent(cloth_batch.rest_positions).requires_grad_()
    geometry = EdgeGeometry(x, cloth_batch)
    for name in ("vectors", "direction", "midpoint", "vertex_normals", "twist", "bend", "hinge", "turned"):
        value = getattr(geometry, name)
        assert value.mT.is_contiguous(), name
        (slope,) = torch.autograd.grad(value, geometry.vectors, torch.ones_like(value), True, allow_unused=True)
        assert slope is None or slope.mT.is_contiguous(), name


@pytest.mark.parametrize("name", QUANTITIES)
def test_first_and_second_derivatives(name, small_cloth):
    mesh = of(small_cloth)
    x = bent(mesh.rest_positions).requires_grad_()

    def quantity(x: Tensor) -> Tensor:
        return getattr(EdgeGeometry(x, mesh), name)

    value = quantity(x)
    weights = torch.randn(value.shape, dtype=torch.float64)
    (gradient,) = torch.autograd.grad((value * weights).sum(), x, create_graph=True)
    assert gradient.norm() > 1e-2, "a check of zeros would prove nothing"
    assert torch.autograd.gradcheck(quantity, x, atol=1e-6)
    assert torch.autograd.gradgradcheck(lambda x: (quantity(x) * weights).sum(), x, atol=1e-5)


def squeezed(rest: Tensor) -> dict[str, Tensor]:
    """Positions that no formula with an angle or a unit vector in it likes."""
    x, y, z = rest.unbind(-1)
    pinched, spike, crumpled = rest.clone(), rest.clone(), bent(rest)
    pinched[1] = pinched[0]
    spike[4] = torch.tensor([0.0, 0.0, 1e3])
    crumpled[3:6] = crumpled[3]
    upright = torch.stack([torch.zeros_like(x), y, x], -1)
    return {
        "rest": rest,
        "zero-length edge": pinched,
        "all vertices in one point": torch.zeros_like(rest),
        "all vertices on a line": torch.stack([x + 2 * y, z, z], -1),
        "folded onto itself": torch.stack([x.abs(), y, z], -1),
        "folded twice": torch.stack([x.abs(), y.abs(), z], -1),
        "faces without area": torch.stack([x, torch.zeros_like(y), z], -1),
        "a row in one point": crumpled,
        "a far vertex": spike,
        "normals along an edge": torch.where((y > 0.1)[:, None], upright + torch.tensor([0.0, 0.0, 0.5]), rest),
        "tiny": 1e-12 * bent(rest),
        "huge": 1e6 * bent(rest),
    }


DEGENERATE = list(squeezed(torch.zeros(9, 3, dtype=torch.float64)))


@pytest.mark.parametrize("case", DEGENERATE)
def test_values_and_two_derivatives_are_finite(case, small_cloth):
    mesh = of(small_cloth)
    x = squeezed(mesh.rest_positions)[case].requires_grad_()
    for name in QUANTITIES:
        value = getattr(EdgeGeometry(x, mesh), name)
        weights = torch.randn(value.shape, dtype=torch.float64)
        total = (weights * (value + value.square())).sum()
        (first,) = torch.autograd.grad(total, x, create_graph=True)
        (second,) = torch.autograd.grad((first * torch.randn_like(x)).sum(), x)
        for order, tensor in enumerate((value, first, second)):
            assert torch.isfinite(tensor).all(), f"derivative {order} of {name}"


def test_normals_exactly_along_an_edge_and_isolated_vertices():
    """Two vertical walls whose shared corner normal lies along an edge, and a vertex without a face."""
    positions = torch.tensor([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [5, 5, 5.0]], dtype=torch.float64)
    mesh = MeshBatch(
        rest_positions=positions,
        faces=torch.tensor([[0, 1, 2]]),
        edges=torch.tensor([[0, 1], [0, 2], [0, 3], [1, 2], [3, 4]]),
        edge_faces=torch.zeros(5, 2, dtype=torch.long),
        boundary=torch.ones(5, dtype=torch.bool),
        rest_lengths=torch.ones(5, dtype=torch.float64),
        mesh_of_vertex=torch.zeros(5, dtype=torch.long),
        mesh_of_edge=torch.zeros(5, dtype=torch.long),
        length_scale=torch.tensor(1.0, dtype=torch.float64),
        num_meshes=1,
    )
    x = positions.clone().requires_grad_()
    geometry = EdgeGeometry(x, mesh)
    assert (geometry.vertex_normals[0] @ geometry.direction[2]).item() == pytest.approx(1.0)
    assert geometry.vertex_normals[4].norm() == 0
    for name in QUANTITIES:
        value = getattr(geometry, name)
        (first,) = torch.autograd.grad(value.square().sum() + value.sum(), x, create_graph=True)
        (second,) = torch.autograd.grad(first.square().sum() + first.sum(), x, retain_graph=True)
        for order, tensor in enumerate((value, first, second)):
            assert torch.isfinite(tensor).all(), f"derivative {order} of {name}"


def test_regularisation_is_invisible_on_a_real_cloth():
    """Within 1e-12 of the plain norms for edges of ordinary length: ε is a millionth of the mean edge."""
    mesh = of(square_grid(4.8, 22))
    x = bent(mesh.rest_positions)
    ends = x[mesh.edges]
    assert torch.allclose(EdgeGeometry(x, mesh).length, (ends[:, 1] - ends[:, 0]).norm(dim=-1), rtol=1e-12, atol=0)
