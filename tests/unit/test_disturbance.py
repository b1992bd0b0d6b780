"""Disturbed vertices are far enough apart, as many as fit, and every edge that they change is known with its cause."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
import torch

from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.loss.disturbance import HOPS_APART, affected_edges, disturbed_vertices
from tests.conftest import bent

MESHES = {
    "uniform": [square_grid(1.0, 14)],
    "alternating": [square_grid(1.0, 13, "alternating")],
    "batch": [square_grid(1.0, 9), square_grid(1.0, 6, "alternating"), square_grid(2.0, 9)],
    "smaller than the distance": [square_grid(1.0, 2), square_grid(1.0, 3)],
}


@pytest.fixture(params=MESHES, scope="module")
def mesh(request) -> MeshBatch:
    return MeshBatch.from_meshes(MESHES[request.param])


def hops(mesh: MeshBatch) -> np.ndarray:
    """Number of edges between every two vertices, by breadth-first search; -1 where there is no way."""
    neighbours = [[] for _ in range(mesh.num_vertices)]
    for i, j in mesh.edges.tolist():
        neighbours[i].append(j)
        neighbours[j].append(i)
    distance = np.full((mesh.num_vertices, mesh.num_vertices), -1)
    for start in range(mesh.num_vertices):
        distance[start, start] = 0
        queue = deque([start])
        while queue:
            here = queue.popleft()
            for there in neighbours[here]:
                if distance[start, there] < 0:
                    distance[start, there] = distance[start, here] + 1
                    queue.append(there)
    return distance


def everywhere(mesh: MeshBatch) -> torch.Tensor:
    return torch.ones(mesh.num_vertices, dtype=torch.bool)


@pytest.mark.parametrize("reach", [1, 2, 3])
def test_pairs_within_some_hops_agree_with_a_search(mesh, reach):
    distance = hops(mesh)
    expected = {(int(i), int(j)) for i, j in zip(*np.nonzero((distance > 0) & (distance <= reach)), strict=True)}
    found = [tuple(pair) for pair in mesh.pairs_within(reach).T.tolist()]
    assert len(found) == len(expected)
    assert set(found) == expected


@pytest.mark.parametrize("seed", range(5))
def test_no_two_are_closer_than_four_edges_and_no_more_fit(mesh, seed):
    torch.manual_seed(seed)
    distance = hops(mesh)
    chosen = disturbed_vertices(mesh, everywhere(mesh)).numpy()
    between = distance[np.ix_(chosen, chosen)]
    apart = between[~np.eye(len(chosen), dtype=bool)]
    assert ((apart >= HOPS_APART) | (apart < 0)).all()
    near = ((distance[:, chosen] >= 0) & (distance[:, chosen] < HOPS_APART)).any(axis=1)
    assert near.all(), "a vertex far from all chosen ones was left out"


def test_only_allowed_vertices_are_chosen_and_no_more_fit_among_them(mesh):
    allowed = torch.rand(mesh.num_vertices) < 0.5
    chosen = disturbed_vertices(mesh, allowed)
    assert allowed[chosen].all()
    distance = hops(mesh)
    near = ((distance[:, chosen] >= 0) & (distance[:, chosen] < HOPS_APART)).any(axis=1)
    assert near[allowed.numpy()].all()


def test_every_mesh_of_a_batch_is_disturbed(mesh):
    chosen = disturbed_vertices(mesh, everywhere(mesh))
    assert set(mesh.mesh_of_vertex[chosen].tolist()) == set(range(mesh.num_meshes))


def test_nothing_allowed_nothing_chosen(mesh):
    chosen = disturbed_vertices(mesh, torch.zeros(mesh.num_vertices, dtype=torch.bool))
    edges, cause = affected_edges(mesh, chosen)
    assert len(chosen) == len(edges) == len(cause) == 0


def test_the_choice_is_random_and_repeatable():
    mesh = MeshBatch.from_meshes(MESHES["uniform"])
    draws = [disturbed_vertices(mesh, everywhere(mesh), torch.Generator().manual_seed(s)).tolist() for s in (1, 1, 2)]
    assert draws[0] == draws[1] != draws[2]


def test_every_vertex_has_its_turn():
    """Over many draws the pinned corners excepted, no vertex is left out for good."""
    mesh = MeshBatch.from_meshes([square_grid(1.0, 8)])
    allowed = everywhere(mesh)
    allowed[[0, 7]] = False
    seen = torch.zeros(mesh.num_vertices, dtype=torch.long)
    for _ in range(300):
        seen[disturbed_vertices(mesh, allowed)] += 1
    assert (seen[allowed] > 0).all()
    assert (seen[~allowed] == 0).all()


def test_affected_edges_are_exactly_those_that_change(mesh):
    """Moves one vertex at a time and compares all that an energy can see of every edge."""
    chosen = disturbed_vertices(mesh, everywhere(mesh))
    edges, cause = affected_edges(mesh, chosen)
    x = bent(mesh.rest_positions)
    before = EdgeGeometry(x, mesh)
    for k, vertex in enumerate(chosen.tolist()):
        moved = x.clone()
        moved[vertex] += torch.tensor([0.01, -0.02, 0.03])
        after = EdgeGeometry(moved, mesh)
        changed = torch.zeros(mesh.num_edges, dtype=torch.bool)
        for name in ("length", "twist", "bend", "area"):
            difference = getattr(after, name) != getattr(before, name)
            changed |= difference.any(-1) if difference.ndim == 2 else difference
        assert changed.any()
        told = set(edges[cause == k].tolist())
        assert set(changed.nonzero().squeeze(-1).tolist()) == told


def test_the_cause_of_an_edge_is_unique(mesh):
    chosen = disturbed_vertices(mesh, everywhere(mesh))
    edges, cause = affected_edges(mesh, chosen)
    assert len(edges.unique()) == len(edges)
    distance = hops(mesh)
    of_each = distance[np.ix_(chosen.numpy(), mesh.edges[edges].numpy().reshape(-1))]
    of_each = of_each.reshape(len(chosen), -1, 2).astype(float)
    of_each[of_each < 0] = np.inf
    assert (of_each.min(axis=2).argmin(axis=0) == cause.numpy()).all()
    assert ((of_each.min(axis=2) <= 1).sum(axis=0) == 1).all(), "an edge within one hop of two disturbed vertices"


def test_about_six_percent_of_a_grid_is_disturbed():
    mesh = MeshBatch.from_meshes([square_grid(4.8, 22)])
    share = np.mean([len(disturbed_vertices(mesh, everywhere(mesh))) for _ in range(20)]) / mesh.num_vertices
    assert 0.04 < share < 0.09
