"""The nearest face of the body, against all faces tried, and against winding numbers for the side."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch
import trimesh

from drape.geometry import mesh_distances, nearest_faces
from drape.geometry.mesh_distances import closest_faces
from drape.geometry.nearest_faces import NearestFaces
from drape.geometry.triangles import closest_on_triangles
from drape.scene.obstacle import Obstacle


def find(x, faces, body, mesh_of_vertex=None, mesh_of_face=None, body_next=None):
    zeros = torch.zeros(max(len(x), len(faces)), dtype=torch.long)
    return NearestFaces.find(
        x, zeros[: len(x)] if mesh_of_vertex is None else mesh_of_vertex,
        faces, zeros[: len(faces)] if mesh_of_face is None else mesh_of_face,
        body, body if body_next is None else body_next,
    )  # fmt: skip


def tensors(mesh: trimesh.Trimesh) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.from_numpy(np.array(mesh.faces, dtype=np.int64)), torch.from_numpy(np.array(mesh.vertices))


def tried(x: torch.Tensor, corners: torch.Tensor) -> torch.Tensor:
    """Distance of each point to the closest of all triangles [F, 3, 3]."""
    triangles = corners.permute(1, 2, 0).repeat_interleave(len(x), -1)
    _, distance = closest_on_triangles(x.T.repeat(1, len(corners)), triangles)
    return distance.view(len(corners), len(x)).amin(0)


def is_inside(x: torch.Tensor, corners: torch.Tensor) -> torch.Tensor:
    """Winding number of a closed surface from solid angles (van Oosterom and Strackee 1983)."""
    a, b, c = (corners[None, :, k] - x[:, None] for k in range(3))
    la, lb, lc = (side.norm(dim=-1) for side in (a, b, c))
    volume = (a * torch.linalg.cross(b, c)).sum(-1)
    rest = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return torch.atan2(volume, rest).sum(-1) / (2.0 * torch.pi) > 0.5


def spiky() -> trimesh.Trimesh:
    """A sphere with random spikes and pits: sharp corners of every kind."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    mesh.vertices = mesh.vertices * np.random.uniform(0.4, 1.3, (len(mesh.vertices), 1))  # noqa: NPY002
    return mesh


def blade() -> trimesh.Trimesh:
    """A thin blade whose right side is cut into slivers: at the tip, most faces look away from what is on its left."""
    right = [(0.02, y, -0.3) for y in np.linspace(0.2, -0.2, 30)]
    corners = [(0.0, 0.0, 0.3), (-0.02, -0.2, -0.3), (-0.02, 0.2, -0.3), *right]
    around = [1, 2, *range(3, 33), 1]
    sides = [(0, after, before) for before, after in pairwise(around)]
    base = [(1, before, after) for before, after in pairwise(around[1:-1])]
    return trimesh.Trimesh(corners, [*sides, *base], process=False)


BODIES = {
    "sphere": lambda: trimesh.creation.icosphere(subdivisions=3, radius=0.3),
    "spiky": spiky,
    "blade": blade,
    "box": lambda: trimesh.creation.box((0.5, 0.3, 0.02)),
    "poles": lambda: trimesh.creation.uv_sphere(radius=0.3, count=(8, 60)),
    "on_a_floor": lambda: trimesh.util.concatenate([
        trimesh.creation.icosphere(subdivisions=3, radius=0.1),
        trimesh.creation.box((20.0, 20.0, 0.2), trimesh.transformations.translation_matrix([0, 0, -0.25])),
    ]),
}


def on_device(monkeypatch):
    """Search as on a device, a few points at a time."""
    def by_distances(points, mesh_of_point, corners, mesh_of_face, *_):
        pairs = closest_faces(points, mesh_of_point, corners, mesh_of_face)
        return nearest_faces._choose(pairs, points, corners)

    monkeypatch.setattr(nearest_faces, "_by_tree", by_distances)
    monkeypatch.setattr(mesh_distances, "CHUNK", 10_000)


@pytest.mark.parametrize("device", ["tree", "chunks"])
@pytest.mark.parametrize("body", BODIES)
def test_nearest_and_side(body, device, monkeypatch):
    """The distance is the smallest of all, the side that of the winding number, the face one at this distance."""
    if device == "chunks":
        on_device(monkeypatch)
    mesh = BODIES[body]()
    assert mesh.is_volume
    faces, vertices = tensors(mesh)
    x = torch.cat([0.8 * torch.rand(200, 3, dtype=torch.float64) - 0.4, *(s * vertices[:50] for s in (1.01, 0.99))])
    x = torch.cat([x, vertices[0] + 0.05 * torch.randn(100, 3, dtype=torch.float64)])
    near = find(x, faces, vertices)
    expected = tried(x, vertices[faces])
    seen = torch.arange(len(x))
    assert torch.equal(near.points, seen)
    torch.testing.assert_close(near.distance.abs(), expected[seen], rtol=1e-9, atol=1e-12)
    clear = expected[seen] > 1e-9
    assert torch.equal((near.distance < 0)[clear], is_inside(x[seen], vertices[faces])[clear])
    assert torch.equal((near.height < 0)[clear], (near.distance < 0)[clear])
    arm = x[seen] - near.end.point
    torch.testing.assert_close(arm.norm(dim=-1), expected[seen], rtol=1e-5, atol=1e-8)  # up to ties
    torch.testing.assert_close((arm * near.end.normal).sum(-1), near.height, rtol=1e-9, atol=1e-12)


def test_a_body_that_has_moved_is_searched_as_exactly():
    """The tree keeps the order of the faces of the first frame: however a body moves, only time is lost by that."""
    faces, vertices = tensors(spiky())
    find(vertices, faces, vertices)
    moved = vertices[torch.randperm(len(vertices), generator=torch.Generator().manual_seed(0))]
    x = 0.8 * torch.rand(200, 3, dtype=torch.float64) - 0.4
    torch.testing.assert_close(find(x, faces, moved).distance.abs(), tried(x, moved[faces]), rtol=1e-9, atol=1e-12)
    flat = vertices.clone()
    flat[faces[:20]] = 0.0  # fewer faces have an area
    seen = trimesh.triangles.area(flat[faces].numpy()) > 1e-12
    assert 0 < int(seen.sum()) < len(faces)
    expected = tried(x, flat[faces[seen]])
    torch.testing.assert_close(find(x, faces, flat).distance.abs(), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("device", ["tree", "chunks"])
def test_only_within_range_and_only_the_own_body(device, monkeypatch):
    """Two cloths at one place: each sees the body that is its own; far vertices are not in the result."""
    if device == "chunks":
        on_device(monkeypatch)
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    faces, vertices = tensors(sphere)
    both = torch.cat([vertices, vertices + torch.tensor([0.0, 0.0, 1.0])])
    x = torch.tensor([[0.0, 0.0, 0.35], [0.0, 0.0, 0.9], [0.0, 0.0, 0.35], [0.0, 0.0, 0.9]], dtype=torch.float64)
    mesh_of_face = torch.arange(2).repeat_interleave(len(faces))
    near = find(
        x, torch.cat([faces, faces + len(vertices)]), both,
        mesh_of_vertex=torch.tensor([0, 0, 1, 1]), mesh_of_face=mesh_of_face,
    ).within(0.4)  # fmt: skip
    assert near.points.tolist() == [0, 2, 3]
    assert mesh_of_face[near.faces].tolist() == [0, 1, 1]
    assert near.distance.tolist() == pytest.approx([0.05, 0.35, -0.2], abs=0.02)


@pytest.mark.parametrize("body", BODIES)
def test_corners_of_its_own_for_each_face_change_no_side(body):
    """As files have it for shading: the welded faces of such a body find what those of the body itself find."""
    faces, vertices = tensors(BODIES[body]())
    loose = Obstacle(np.arange(3 * len(faces)).reshape(-1, 3), vertices[faces].reshape(1, -1, 3).numpy())
    x = torch.cat([s * vertices[:100] for s in (1.01, 0.99)] + [0.8 * torch.rand(100, 3, dtype=torch.float64) - 0.4])
    whole = find(x, faces, vertices)
    found = find(x, torch.tensor(loose.welded_faces), torch.tensor(loose.at(0)))
    torch.testing.assert_close(found.distance, whole.distance)
    assert torch.equal(found.distance < 0, whole.distance < 0)


def test_nothing_near():
    """A result of no vertices, also without any face that has an area."""
    faces, vertices = tensors(trimesh.creation.box((1.0, 1.0, 1.0)))
    x = torch.full((3, 3), 10.0, dtype=torch.float64)
    assert len(find(x, faces, vertices).within(0.5).points) == 0
    assert len(find(x, faces, torch.zeros_like(vertices)).points) == 0


def test_faces_without_area_are_no_obstacle():
    """A body with collapsed faces is seen through its other faces."""
    faces, vertices = tensors(trimesh.creation.box((1.0, 1.0, 1.0)))
    flat = torch.tensor([[0, 0, 1], [2, 2, 2]])
    x = torch.tensor([[0.1, 0.2, 0.6]], dtype=torch.float64)
    near = find(x, torch.cat([flat, faces]), vertices)
    assert near.distance.item() == pytest.approx(0.1)
    assert near.faces.item() >= 2


def test_closest_points_of_a_triangle():
    """Inside, on sides, on corners, and of triangles that are a line or a point."""
    corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=torch.float64)
    cases = {
        (0.2, 0.2, 0.5): (0.6, 0.2, 0.2), (0.5, -1.0, 0.0): (0.5, 0.5, 0.0), (1.0, 1.0, 1.0): (0.0, 0.5, 0.5),
        (-1.0, -1.0, 0.0): (1.0, 0.0, 0.0), (3.0, 0.0, 0.0): (0.0, 1.0, 0.0), (0.0, 0.0, 0.0): (1.0, 0.0, 0.0),
    }  # fmt: skip
    points = torch.tensor(list(cases), dtype=torch.float64)
    found, distance = closest_on_triangles(points.T, corners[..., None].expand(3, 3, len(points)))
    expected = torch.tensor(list(cases.values()), dtype=torch.float64)
    torch.testing.assert_close(found.T, expected)
    torch.testing.assert_close(distance, (points - expected @ corners).norm(dim=-1))
    line = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=torch.float64)
    point = torch.zeros(3, 3, dtype=torch.float64)
    _, distance = closest_on_triangles(torch.ones(3, 2, dtype=torch.float64), torch.stack([line, point], -1))
    torch.testing.assert_close(distance, torch.tensor([2.0, 3.0], dtype=torch.float64).sqrt())
