"""HOOD's coarse levels of a graph: every second ring around the centre of each connected component."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Int
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from torch import Tensor

SWEEPS = 16
"""Vertices that are tried as the centre at most; a sheet of cloth takes two or three."""


class CoarseLevels(NamedTuple):
    """The edges of each level, finest first, and the deepest level that each vertex is in; the mesh is level 0."""

    edges: tuple[Int[Tensor, "_ _"], ...]
    level: Int[Tensor, " vertices"]

    @classmethod
    def of(cls, edges: Int[Tensor, "edges 2"], num_vertices: int, count: int) -> CoarseLevels:
        """``count`` levels above the graph with ``edges``, on their device (docs/sources.md, HOOD).

        From one level to the next the vertices at an even distance from the centre stay, so that distances halve. Of
        the others, each connects every neighbour nearer to the centre to every one farther away (rule 1), and where
        none is farther, its nearer ones to each other unless they are at most two edges apart by then (rule 2).
        Neighbours that both stay are connected again unless they are at most two edges apart by then (rule 3). "By
        then" is when the rule before is done, where HOOD's loop looks after each edge: no order plays a role.
        """
        ends = edges.cpu().numpy()
        graph = _ones(_one_way(ends[:, 0], ends[:, 1], num_vertices))
        graph = _ones(graph + graph.T)
        ring = _distances(graph, centres(graph))
        level, lists = np.zeros(num_vertices, np.int64), []
        for number in range(1, count + 1):
            graph = _coarser(graph, ring)
            level[ring % 2 == 0] = number
            # A vertex that was left has no edges any more; an odd distance keeps it out of all deeper levels.
            ring = np.where(ring % 2 == 0, ring // 2, 1)
            lists.append(np.stack(sparse.triu(graph, 1).nonzero(), -1))
        return cls(tuple(_on(edges, pairs) for pairs in lists), _on(edges, level))


def centres(graph: sparse.sparray) -> NDArray[np.int64]:
    """Of each connected component the vertex whose farthest vertex is nearest.

    Distances from vertices that are far from the candidates so far bound all eccentricities from below; the next
    candidate is where the bound is lowest. It is a centre for certain as soon as its eccentricity meets its bound;
    after ``SWEEPS`` candidates (on tubes, where nearly every vertex is as central) the best of them is taken.
    """
    count, part = csgraph.connected_components(graph, directed=False)
    candidates = best = _first_of_each(part)
    lowest = np.full(count, np.iinfo(np.int64).max)
    bound = total = np.zeros(len(part), np.int64)
    for _ in range(SWEEPS):
        distance = _distances(graph, candidates)
        farthest = _first_of_each(part, -distance)
        eccentricity = distance[farthest]
        best = np.where(eccentricity < lowest, candidates, best)
        lowest = np.minimum(eccentricity, lowest)
        if (bound[candidates] == eccentricity).all():
            break
        distance = _distances(graph, farthest)
        bound, total = np.maximum(bound, distance), total + distance
        candidates = _first_of_each(part, bound, total)
    return best


def _first_of_each(part: NDArray, *keys: NDArray) -> NDArray[np.int64]:
    """The vertex of each component that comes first in the order of the keys."""
    order = np.lexsort((*keys[::-1], part))
    return order[np.unique(part[order], return_index=True)[1]]


def _distances(graph: sparse.sparray, sources: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges to the nearest of the sources, of which each component has one."""
    return csgraph.dijkstra(graph, indices=sources, unweighted=True, min_only=True).astype(np.int64)


def _coarser(graph: sparse.sparray, ring: NDArray[np.int64]) -> sparse.sparray:
    """The next level of the hierarchy by the three rules; ``ring`` is the distance from the centre."""
    count = len(ring)
    first, second = graph.nonzero()
    odd, step = ring[first] % 2 == 1, ring[second] - ring[first]
    nearer, farther = (_one_way(first[kept], second[kept], count) for kept in (odd & (step < 0), odd & (step > 0)))
    through = nearer.T @ farther
    coarse = _ones(through + through.T)
    last = nearer.multiply((farther.sum(1) == 0)[:, None]).tocsr()
    coarse = coarse + _more_than_two_apart(last.T @ last, coarse)
    both_stay = ~odd & (step == 0)
    return coarse + _more_than_two_apart(_one_way(first[both_stay], second[both_stay], count), coarse)


def _more_than_two_apart(pairs: sparse.sparray, graph: sparse.sparray) -> sparse.sparray:
    pairs = _ones(pairs)
    far = pairs - pairs.multiply(_ones(graph @ graph + graph + sparse.eye_array(graph.shape[0], dtype=graph.dtype)))
    far.eliminate_zeros()
    return far


def _one_way(first: NDArray, second: NDArray, count: int) -> sparse.sparray:
    return sparse.coo_array((np.ones(len(first), np.int32), (first, second)), (count, count)).tocsr()


def _ones(matrix: sparse.sparray) -> sparse.sparray:
    """The same entries, each 1."""
    matrix = matrix.tocsr()
    matrix.data[:] = 1
    return matrix


def _on(like: Tensor, array: NDArray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.int64)).to(like.device)
