"""Patches of a cloth: connected pieces of about one size, made from the rest mesh; no UV map is needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from torch import Tensor

COVERING = 0.85
"""Farthest that a vertex may be from the seed of its patch, in sizes; the mean area of a patch is then size²."""
CANDIDATES = 4
"""Patches that a vertex asks at most."""


@dataclass(frozen=True, eq=False)
class Patches:
    """Patches of the vertices, and their places on the cloth."""

    of_vertex: Int[Tensor, " vertices"]
    mesh_of_patch: Int[Tensor, " patches"]
    """Ascending: the patches of a cloth are numbered one after the other."""
    num_vertices: Int[Tensor, " patches"]
    """Vertices of each patch."""
    neighbours: Int[Tensor, "2 pairs"]
    """All ordered pairs of different patches that an edge of the cloth joins."""
    candidates: Int[Tensor, "2 asked"]
    """(vertex, patch): of its own patch and those beside it the four whose centres at rest are nearest to the vertex;
    ordered by vertex."""

    @classmethod
    def of(
        cls, rest_positions: Float[np.ndarray, "vertices 3"], edges: Int[np.ndarray, "edges 2"], size: float
    ) -> Patches:
        """Patches of one mesh, of about ``size`` [m] along each side, measured along the edges at rest.

        Seeds are chosen one after the other, in all connected parts at once: the vertex of a part farthest from its
        mean, then always the vertex farthest along the edges from the seeds so far, until none is farther than
        ``COVERING · size``; a vertex belongs to the seed nearest along the edges. All choices, ties included, depend on
        the rest positions and not on the order of the vertices. On coarse meshes each vertex is a patch of its own.
        """
        order, starts = _by_geometry(rest_positions, edges)
        place = np.argsort(order)
        x = rest_positions[order].astype(np.float64)
        ends = np.sort(place[edges], axis=1)
        seed = _nearest_seeds(x, _graph(x, ends), starts, COVERING * size)
        _, patch, count = np.unique(seed, return_inverse=True, return_counts=True)
        patch = patch.reshape(-1)
        between = patch[ends]
        between = between[between[:, 0] != between[:, 1]]
        pairs = np.unique(np.concatenate([between, between[:, ::-1]]), axis=0)
        vertex, asked = _candidates(x, patch, count, pairs, size)
        by_vertex = np.argsort(order[vertex], kind="stable")
        candidates = np.stack([order[vertex], asked])[:, by_vertex]
        arrays = (patch[place], np.zeros_like(count), count, pairs.T, candidates)
        return cls(*(torch.from_numpy(np.ascontiguousarray(array, dtype=np.int64)) for array in arrays))

    @classmethod
    def of_batch(
        cls,
        rest_positions: Float[np.ndarray, "vertices 3"],
        edges: Int[np.ndarray, "edges 2"],
        mesh_of_vertex: Int[np.ndarray, " vertices"],
        size: float,
    ) -> Patches:
        """Patches of meshes that stand one after the other; those of a mesh seen before are remembered."""
        starts = np.concatenate([[0], np.cumsum(np.bincount(mesh_of_vertex))])
        edge_starts = np.searchsorted(mesh_of_vertex[edges[:, 0]], np.arange(len(starts)))
        parts = []
        for (first, last), edge_range in zip(pairwise(starts), pairwise(edge_starts), strict=True):
            rest, ends = rest_positions[first:last], edges[slice(*edge_range)] - first
            parts.append(_remembered(rest.astype(np.float64).tobytes(), ends.astype(np.int64).tobytes(), size))
        return cls._joined(parts)

    @classmethod
    def _joined(cls, parts: Sequence[Patches]) -> Patches:
        vertices = np.cumsum([0] + [len(part.of_vertex) for part in parts])
        patches = np.cumsum([0] + [part.num_patches for part in parts])
        moved = [
            replace(
                part,
                of_vertex=part.of_vertex + int(patch),
                mesh_of_patch=part.mesh_of_patch + number,
                neighbours=part.neighbours + int(patch),
                candidates=part.candidates + torch.tensor([[int(vertex)], [int(patch)]]),
            )
            for number, (part, vertex, patch) in enumerate(zip(parts, vertices, patches, strict=False))
        ]
        return cls(*(torch.cat([getattr(part, f.name) for part in moved], -1) for f in fields(cls)))

    @property
    def num_patches(self) -> int:
        return len(self.num_vertices)

    def mean(self, of_vertices: Float[Tensor, "vertices *dims"]) -> Float[Tensor, "patches *dims"]:
        """Mean over the vertices of each patch."""
        total = of_vertices.new_zeros(self.num_patches, *of_vertices.shape[1:])
        total = total.index_add(0, self.of_vertex, of_vertices)
        return total / self.num_vertices.to(total.dtype).view(-1, *[1] * (total.dim() - 1))

    def to(self, device: torch.device | str) -> Patches:
        """The same patches on another device."""
        return Patches(*(getattr(self, f.name).to(device) for f in fields(self)))


@lru_cache(maxsize=1024)
def _remembered(rest_positions: bytes, edges: bytes, size: float) -> Patches:
    x, ends = np.frombuffer(rest_positions).reshape(-1, 3), np.frombuffer(edges, np.int64).reshape(-1, 2)
    return Patches.of(x, ends, size)


def _graph(x: np.ndarray, ends: np.ndarray) -> csr_array:
    length = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    pairs = np.concatenate([ends, ends[:, ::-1]]).T
    return coo_array((np.tile(length, 2), (pairs[0], pairs[1])), (len(x), len(x))).tocsr()


def _by_geometry(x: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices in an order that does not depend on theirs, part by part, and where each part starts."""
    order = np.lexsort((x[:, 2], x[:, 1], x[:, 0]))
    joined = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (len(x), len(x)))
    _, part = connected_components(joined, directed=False)
    part = part[order]
    _, first, inverse = np.unique(part, return_index=True, return_inverse=True)
    by_part = np.argsort(first[inverse.reshape(-1)], kind="stable")
    part = part[by_part]
    return order[by_part], np.flatnonzero(np.diff(part, prepend=-1))


def _nearest_seeds(x: np.ndarray, graph: csr_array, starts: np.ndarray, radius: float) -> np.ndarray:
    """Of each vertex the seed nearest to it along the edges."""
    sizes = np.diff(starts, append=len(x))
    mean = np.add.reduceat(x, starts) / sizes[:, None]
    far = np.linalg.norm(x - np.repeat(mean, sizes, axis=0), axis=1)
    distance, seed = np.full(len(x), np.inf), np.zeros(len(x), dtype=np.int64)
    while True:
        farthest = np.maximum.reduceat(far, starts)
        winners = np.flatnonzero(far == np.repeat(farthest, sizes))
        new = winners[np.searchsorted(winners, starts)]
        new = new[distance[new] > radius]
        if not len(new):
            return seed
        reach = distance[new].max()
        found, _, source = dijkstra(graph, indices=new, min_only=True, limit=reach, return_predecessors=True)
        closer = found < distance
        distance[closer], seed[closer] = found[closer], source[closer]
        far = distance


def _candidates(
    x: np.ndarray, patch: np.ndarray, count: np.ndarray, pairs: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """(vertex, patch) of the patches that the vertices ask, the nearest first."""
    centre = np.zeros((len(count), 3))
    np.add.at(centre, patch, x)
    centre /= count[:, None]
    degree = np.bincount(pairs[:, 0], minlength=len(count))
    first = np.cumsum(degree) - degree
    vertex = np.repeat(np.arange(len(x)), degree[patch])
    turn = np.arange(len(vertex)) - np.repeat(np.cumsum(degree[patch]) - degree[patch], degree[patch])
    beside = pairs[first[patch[vertex]] + turn, 1]
    vertex, asked = np.concatenate([np.arange(len(x)), vertex]), np.concatenate([patch, beside])
    distance = np.linalg.norm(x[vertex] - centre[asked], axis=1)
    distance = np.round(distance / (1e-9 * size))  # what differs by rounding only is a tie
    order = np.lexsort((asked, distance, vertex))
    vertex, asked = vertex[order], asked[order]
    rank = np.arange(len(vertex)) - np.searchsorted(vertex, vertex)
    return vertex[rank < CANDIDATES], asked[rank < CANDIDATES]
