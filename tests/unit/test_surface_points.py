"""Points of the surface of cloths: where they are, what they carry, forces and stiffness back on the vertices."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from drape.energy.terms.point_stencils import point_stencils
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.surface_points import SurfacePoints
from tests.terms import assembled

NUMBERS = [(0, 0), (1, 0), (2, 1), (0, 3), (3, 3)]
counts = pytest.mark.parametrize(("per_edge", "per_face"), NUMBERS)


def two_cloths() -> MeshBatch:
    return MeshBatch.from_meshes([square_grid(1.0, 4, "alternating"), square_grid(0.5, 3)])


def some_positions(mesh: MeshBatch) -> torch.Tensor:
    torch.manual_seed(0)
    return torch.randn(mesh.num_vertices, 3, dtype=torch.float64)


@counts
def test_vertices_come_first_then_edges_then_faces_of_every_cloth(per_edge, per_face):
    """All at equal distances along each edge; in each face so that their mean is its centre."""
    mesh = two_cloths()
    points, x = SurfacePoints.of(mesh, per_edge, per_face), some_positions(mesh)
    y, (v, e, f) = points.at(x), (mesh.num_vertices, mesh.num_edges, len(mesh.faces))
    assert len(y) == v + per_edge * e + per_face * f
    torch.testing.assert_close(y[:v], x)
    ends = x[mesh.edges]
    for k in range(per_edge):
        share = (k + 1) / (per_edge + 1)
        torch.testing.assert_close(y[v + k * e : v + (k + 1) * e], share * ends[:, 0] + (1 - share) * ends[:, 1])
    if per_face:
        inside = y[v + per_edge * e :].reshape(per_face, f, 3)
        torch.testing.assert_close(inside.mean(0), x[mesh.faces].mean(1))
        corners = points.weights[v + per_edge * e :]
        assert len(torch.unique(corners, dim=0)) == per_face
    torch.testing.assert_close(points.mesh_of_point, mesh.mesh_of_vertex[points.vertices[:, 0]])


@counts
def test_weights_and_masses_are_shared_out(per_edge, per_face):
    """Weights of a point sum to 1, shares of the mass of a vertex too; each kind of points carries the same."""
    mesh = two_cloths()
    points = SurfacePoints.of(mesh, per_edge, per_face)
    torch.testing.assert_close(points.weights.sum(1), torch.ones(len(points.weights), dtype=torch.float64))
    assert (points.weights >= 0).all()
    shares = torch.zeros(mesh.num_vertices, dtype=torch.float64)
    shares.index_add_(0, points.vertices.reshape(-1), points.mass_shares.reshape(-1))
    torch.testing.assert_close(shares, torch.ones_like(shares))
    mass = 0.1 + torch.arange(mesh.num_vertices, dtype=torch.float64)
    carried = points.chosen(torch.arange(len(points.vertices)), mesh.num_vertices).mass(mass)
    assert (carried > 0).all()
    firsts = [kind.first for kind in points.kinds] + [len(carried)]
    each = [carried[first:last].sum() for first, last in zip(firsts[:-1], firsts[1:], strict=True)]
    torch.testing.assert_close(torch.stack(each), mass.sum().expand(len(each)) / len(each))


@counts
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_forces_spread_as_positions_gather(per_edge, per_face, dtype):
    """``f · (W x) = (Wᵀ f) · x`` for some of the points, which are where they are among all."""
    mesh = two_cloths()
    points, x = SurfacePoints.of(mesh, per_edge, per_face), some_positions(mesh).to(dtype)
    chosen = torch.arange(1, len(points.vertices), 3)
    some = points.chosen(chosen, mesh.num_vertices)
    force = torch.randn(len(chosen), 3, dtype=dtype)
    rounding = 1e-12 if dtype == torch.float64 else 1e-5
    torch.testing.assert_close(some.at(x), points.at(x)[chosen], atol=rounding, rtol=0)
    assert float((force * some.at(x)).sum()) == pytest.approx(float((some.spread(force) * x).sum()), rel=100 * rounding)


@counts
def test_stencils_are_the_stiffness_of_the_points(per_edge, per_face):
    """Their sum is ``Wᵀ B W`` of the chosen points; edges and faces have a piece each, chosen or not."""
    mesh = two_cloths()
    points = SurfacePoints.of(mesh, per_edge, per_face)
    chosen = torch.arange(0, len(points.vertices), 2)
    torch.manual_seed(1)
    root = torch.randn(len(chosen), 3, 3, dtype=torch.float64)
    blocks = root @ root.mT
    pieces = point_stencils(points.chosen(chosen, mesh.num_vertices), blocks, torch.arange(len(chosen)))
    found = assembled(pieces, mesh.num_vertices)
    gather = np.zeros((len(chosen), mesh.num_vertices))
    for row, point in enumerate(chosen):
        np.add.at(gather[row], points.vertices[point].numpy(), points.weights[point].numpy())
    expected = np.einsum("pv,pij,pw->viwj", gather, blocks.numpy(), gather).reshape(len(found), -1)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-12)
    carriers = [len(vertices) for vertices, _ in pieces[1:]]
    assert carriers == [mesh.num_edges] * (per_edge > 0) + [len(mesh.faces)] * (per_face > 0)


def test_a_mesh_has_its_points_once():
    """Who keeps places in a matrix by the tensors of the points would look for them anew in each step."""
    mesh = MeshBatch.from_meshes([square_grid(1.0, 4)])
    assert SurfacePoints.of(mesh, 1) is SurfacePoints.of(mesh, 1)
    assert SurfacePoints.of(mesh, 1) is not SurfacePoints.of(mesh, 0)
    assert SurfacePoints.of(mesh, 1) is not SurfacePoints.of(MeshBatch.from_meshes([square_grid(1.0, 4)]), 1)
