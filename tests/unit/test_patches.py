"""Patches of cloth: a partition into connected pieces of about one size that only geometry decides."""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from drape.geometry.grid import rectangular_grid, square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.patches import COVERING, Patches

SIZE = 0.15


def grid() -> ClothMesh:
    """400 vertices on a square of 1 m with many ties, and none flat in z."""
    mesh = square_grid(1.0, 20, "alternating")
    x = mesh.rest_positions.astype(np.float64)
    x[:, 2] = 0.1 * x[:, 0] ** 2
    return ClothMesh.from_faces(x, mesh.faces)


def two_parts() -> ClothMesh:
    """Two sheets in one mesh that do not touch, 5 mm apart."""
    mesh, other = grid(), square_grid(0.4, 9)
    x = np.concatenate([mesh.rest_positions, other.rest_positions + [0.0, 0.0, 0.005 + 0.1]])
    return ClothMesh.from_faces(x, np.concatenate([mesh.faces, other.faces + mesh.num_vertices]))


def renumbered(mesh: ClothMesh, order: np.ndarray) -> ClothMesh:
    return ClothMesh.from_faces(mesh.rest_positions[order], np.argsort(order)[mesh.faces][::-1])


def lengths(mesh: ClothMesh) -> coo_array:
    i, j = mesh.edges.T
    return coo_array((mesh.rest_lengths, (i, j)), (mesh.num_vertices, mesh.num_vertices)).tocsr()


@pytest.mark.parametrize("make", [grid, two_parts])
def test_connected_pieces_of_the_size(make):
    """Each patch is in one piece, no vertex is far from some seed of it, and the area of a patch is about size²."""
    mesh = make()
    patches = MeshBatch.from_meshes([mesh]).patches(SIZE)
    of = patches.of_vertex.numpy()
    assert np.array_equal(np.unique(of), np.arange(patches.num_patches))
    assert np.array_equal(np.bincount(of), patches.num_vertices.numpy())
    apart = dijkstra(lengths(mesh), directed=False)
    for patch in range(patches.num_patches):
        inside = np.flatnonzero(of == patch)
        assert connected_components(lengths(mesh)[inside][:, inside], directed=False)[0] == 1
        assert apart[np.ix_(inside, inside)].max(1).min() <= COVERING * SIZE
    x = mesh.rest_positions[mesh.faces].astype(np.float64)
    area = 0.5 * np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1).sum()
    assert 0.75 * SIZE < np.sqrt(area / patches.num_patches) < 1.25 * SIZE


def test_neighbours_are_joined_by_edges():
    """Adjacent patches are those with an edge between them, both ways, and no patch is beside itself."""
    mesh = two_parts()
    patches = MeshBatch.from_meshes([mesh]).patches(SIZE)
    ends = patches.of_vertex.numpy()[mesh.edges]
    expected = {pair for a, b in ends.tolist() if a != b for pair in ((a, b), (b, a))}
    found = list(map(tuple, patches.neighbours.T.tolist()))
    assert len(found) == len(set(found))
    assert set(found) == expected


def test_parts_do_not_share_patches():
    """A sheet of its own has patches of its own however near it is, and asks no others."""
    mesh, first = two_parts(), grid().num_vertices
    patches = MeshBatch.from_meshes([mesh]).patches(SIZE)
    upper = set(patches.of_vertex[first:].tolist())
    assert not upper & set(patches.of_vertex[:first].tolist())
    vertex, asked = patches.candidates
    assert set(asked[vertex >= first].tolist()) == upper


@pytest.mark.parametrize("make", [grid, two_parts])
def test_order_of_vertices_does_not_matter(make):
    """Renumbered vertices have the same patches, with the same numbers, ties of a regular grid included."""
    mesh = make()
    order = np.random.default_rng(1).permutation(mesh.num_vertices)
    before, after = (MeshBatch.from_meshes([m]).patches(SIZE) for m in (mesh, renumbered(mesh, order)))
    assert torch.equal(after.of_vertex, before.of_vertex[order])
    assert torch.equal(after.neighbours, before.neighbours)
    vertex, asked = after.candidates
    pairs = torch.stack([torch.from_numpy(order)[vertex], asked])
    assert set(map(tuple, pairs.T.tolist())) == set(map(tuple, before.candidates.T.tolist()))


def test_batch_equals_singles():
    """Cloths of a batch have the patches that they have alone, numbered one cloth after the other."""
    meshes = [grid(), two_parts(), grid()]
    joined = MeshBatch.from_meshes(meshes).patches(SIZE)
    vertex = patch = 0
    for number, mesh in enumerate(meshes):
        single = MeshBatch.from_meshes([mesh]).patches(SIZE)
        own = slice(vertex, vertex + mesh.num_vertices)
        assert torch.equal(joined.of_vertex[own] - patch, single.of_vertex)
        beside = joined.neighbours[:, joined.mesh_of_patch[joined.neighbours[0]] == number]
        assert torch.equal(beside - patch, single.neighbours)
        asked = joined.candidates[:, joined.mesh_of_patch[joined.candidates[1]] == number]
        assert torch.equal(asked - torch.tensor([[vertex], [patch]]), single.candidates)
        vertex, patch = vertex + mesh.num_vertices, patch + single.num_patches
    assert joined.num_patches == patch


def test_remembered_for_the_next_batch(monkeypatch):
    """The patches of a mesh are not looked for again in another batch, or on another device."""
    batch = MeshBatch.from_meshes([grid(), two_parts()])
    before = batch.patches(SIZE)
    monkeypatch.setattr(Patches, "of", None)
    assert torch.equal(batch.to("cpu").patches(SIZE).candidates, before.candidates)
    assert MeshBatch.from_meshes([two_parts()]).patches(SIZE).num_patches < before.num_patches


def test_candidates_are_the_nearest():
    """Of the own patch and those beside it the four with the nearest centres."""
    mesh = grid()
    x = mesh.rest_positions + 1e-3 * np.random.default_rng(0).normal(size=mesh.rest_positions.shape)  # no ties
    patches = MeshBatch.from_meshes([ClothMesh.from_faces(x, mesh.faces)]).patches(SIZE)
    centre = patches.mean(torch.tensor(x)).numpy()
    own, (first, second) = patches.of_vertex.numpy(), patches.neighbours.numpy()
    vertex, asked = patches.candidates.numpy()
    assert (np.diff(vertex) >= 0).all()
    for v in range(mesh.num_vertices):
        beside = np.concatenate([own[v : v + 1], second[first == own[v]]])
        distance = np.linalg.norm(centre[beside] - x[v], axis=1)
        assert asked[vertex == v].tolist() == beside[np.argsort(distance)[:4]].tolist()


def test_means_and_coarse_meshes():
    """The centre is the mean of the vertices; where edges are longer than the size each vertex is a patch."""
    mesh = MeshBatch.from_meshes([grid()])
    patches = mesh.patches(SIZE)
    assert mesh.patches(SIZE) is patches
    inside = patches.of_vertex == 3
    torch.testing.assert_close(patches.mean(mesh.rest_positions)[3], mesh.rest_positions[inside].mean(0))
    fine = mesh.patches(0.01)
    assert fine.num_patches == mesh.num_vertices
    torch.testing.assert_close(fine.mean(mesh.rest_positions)[fine.of_vertex], mesh.rest_positions)
    assert isinstance(fine, Patches)


def test_ten_thousand_vertices_in_time():
    """A garment of 10 k vertices has its patches in at most 5 s of the processor, however busy that is."""
    mesh = MeshBatch.from_meshes([rectangular_grid((1.6, 1.0), (128, 80))])
    start = time.process_time()
    assert 700 < mesh.patches(0.04).num_patches < 1400
    assert time.process_time() - start < 5.0
