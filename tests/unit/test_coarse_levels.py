"""HOOD's coarse levels against the rules as HOOD's code has them, followed by hand."""

from __future__ import annotations

import time
from itertools import combinations, product

import numpy as np
import pytest
import torch
from scipy import sparse

from drape.geometry.coarse_levels import CoarseLevels, centres
from drape.geometry.disc import disc
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch


def grid_graph(size: int) -> list[tuple[int, int]]:
    return [tuple(edge) for edge in square_grid(1.0, size, "alternating").edges.tolist()]


def random_graph(seed: int, count: int = 24, edges: int = 34) -> list[tuple[int, int]]:
    """Triangles, long ways round, dead ends and several components."""
    pairs = np.random.default_rng(seed).integers(0, count, (edges, 2))
    return [(i, j) for i, j in pairs.tolist() if i != j and abs(i - j) < 9]


GRAPHS = {
    "path": (9, [(i, i + 1) for i in range(8)]),
    "ring": (11, [(i, (i + 1) % 11) for i in range(11)]),
    "star": (6, [(0, i) for i in range(1, 6)]),
    "grid": (36, grid_graph(6)),
    "two parts and a lone vertex": (14, [(i, i + 1) for i in range(6)] + [(7 + i, 7 + (i + 1) % 6) for i in range(6)]),
    **{f"random {seed}": (24, random_graph(seed)) for seed in range(20)},
}


def distances(neighbours: dict[int, set[int]], source: int) -> dict[int, int]:
    found, front = {source: 0}, [source]
    while front:
        front = [j for i in front for j in neighbours[i] if j not in found and not found.update({j: found[i] + 1})]
    return found


def joined(count: int, edges: set[frozenset[int]]) -> dict[int, set[int]]:
    neighbours = {i: set() for i in range(count)}
    for i, j in edges:
        neighbours[i].add(j)
        neighbours[j].add(i)
    return neighbours


def by_hand(count: int, edges: set[frozenset[int]], ring: dict[int, int]) -> set[frozenset[int]]:
    """One level: the three rules, each looked up in the graph that the rule before it left."""

    def apart(graph: set[frozenset[int]], i: int, j: int) -> float:
        return distances(joined(count, graph), i).get(j, float("inf"))

    around = joined(count, edges)
    odd = [i for i in ring if ring[i] % 2]
    coarse = set()
    for i in odd:
        nearer, farther = ([j for j in around[i] if ring[j] == ring[i] + k] for k in (-1, 1))
        coarse |= {frozenset(pair) for pair in product(nearer, farther) if apart(edges, *pair) == 2}
    ends = [i for i in odd if all(ring[j] <= ring[i] for j in around[i])]
    pairs = [pair for i in ends for pair in combinations([j for j in around[i] if ring[j] == ring[i] - 1], 2)]
    coarse = coarse | {frozenset(pair) for pair in pairs if apart(coarse, *pair) > 2}
    both = [tuple(edge) for edge in edges if all(ring[i] % 2 == 0 for i in edge)]
    return coarse | {frozenset(pair) for pair in both if apart(coarse, *pair) > 2}


def levels_of(count: int, edges: list[tuple[int, int]], number: int) -> CoarseLevels:
    return CoarseLevels.of(torch.tensor(edges, dtype=torch.long).reshape(-1, 2), count, number)


def centres_of(count: int, edges: list[tuple[int, int]]) -> list[int]:
    first, second = np.array(edges).T
    graph = sparse.coo_array((np.ones(len(edges)), (first, second)), (count, count))
    return centres((graph + graph.T).tocsr()).tolist()


def as_set(edges: torch.Tensor) -> set[frozenset[int]]:
    return {frozenset(edge) for edge in edges.tolist()}


@pytest.mark.parametrize("name", GRAPHS)
def test_rules(name: str):
    count, edges = GRAPHS[name]
    levels = levels_of(count, edges, 3)
    graph, left = {frozenset(edge) for edge in edges}, set(range(count))
    for number, found in enumerate(levels.edges, 1):
        around = joined(count, graph)
        ring = {i: d for c in centres_of(count, edges) for i, d in distances(around, c).items() if i in left}
        graph, left = by_hand(count, graph, ring), {i for i in left if ring[i] % 2 == 0}
        assert as_set(found) == graph
        assert len(found) == len(graph)
        assert {i for i, level in enumerate(levels.level.tolist()) if level >= number} == left


@pytest.mark.parametrize("name", GRAPHS)
def test_centres_have_the_lowest_eccentricity(name: str):
    count, edges = GRAPHS[name]
    around = joined(count, {frozenset(edge) for edge in edges})
    reached = [distances(around, i) for i in range(count)]
    parts = {frozenset(found) for found in reached}
    found = centres_of(count, edges)
    assert len(found) == len(parts)
    for centre in found:
        assert max(reached[centre].values()) == min(max(reached[i].values()) for i in reached[centre])


def test_a_path_halves():
    levels = levels_of(9, GRAPHS["path"][1], 3)
    assert [sorted(map(sorted, edges.tolist())) for edges in levels.edges] == [
        [[0, 2], [2, 4], [4, 6], [6, 8]],
        [[0, 4], [4, 8]],
        [],
    ]
    assert levels.level.tolist() == [2, 0, 1, 0, 3, 0, 1, 0, 2]


@pytest.mark.parametrize(("size", "joins"), [(6, False), (10, True)])
def test_rule_2_closes_rings_that_would_come_apart(size: int, joins: bool):
    """The vertex opposite the centre leaves; its two neighbours are 2 apart through the centre of the smaller ring."""
    ring = [(i, (i + 1) % size) for i in range(size)]
    tail = [(0, size)] + [(size + i, size + i + 1) for i in range(size // 2 - 1)]
    count, opposite = size + size // 2, size // 2
    assert centres_of(count, ring + tail) == [0]
    joint = frozenset((opposite - 1, opposite + 1))
    assert (joint in as_set(levels_of(count, ring + tail, 1).edges[0])) == joins


def test_batch_equals_single():
    meshes = [square_grid(1.0, 7), disc(1.0, 4, 0.5)]
    both = MeshBatch.from_meshes(meshes).coarse_levels(3)
    singles = [MeshBatch.from_meshes([mesh]).coarse_levels(3) for mesh in meshes]
    assert both.level.tolist() == singles[0].level.tolist() + singles[1].level.tolist()
    for number, edges in enumerate(both.edges):
        first, second = (single.edges[number] for single in singles)
        assert as_set(edges) == as_set(first) | as_set(second + meshes[0].num_vertices)


def test_computed_once():
    mesh = MeshBatch.from_meshes([square_grid(1.0, 5)])
    assert mesh.coarse_levels(2) is mesh.coarse_levels(2)
    assert len(mesh.coarse_levels(1).edges) == 1


def test_ten_thousand_vertices_in_seconds():
    """Of the processor, however busy that is."""
    mesh = MeshBatch.from_meshes([square_grid(1.0, 100)])
    start = time.process_time()
    levels = mesh.coarse_levels(3)
    assert time.process_time() - start < 5.0
    assert (levels.level >= 1).double().mean() == pytest.approx(0.5, abs=0.05)


def test_without_edges():
    levels = levels_of(3, [], 2)
    assert [len(edges) for edges in levels.edges] == [0, 0]
    assert levels.level.tolist() == [2, 2, 2]
