"""Last improvements of a nearly even mesh: flips that raise the worse of two triangles, tangential relaxation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix, csr_matrix, diags

from drape.garment.edges import edges_of, keys, sides_of
from drape.garment.quality import triangle_quality
from drape.geometry.normals import face_normals, unit, vertex_normals

ROUNDS = 8
RELAXATION = 0.5
"""Share of the way to the mean of the neighbours."""
LEAST_GAIN = 0.03
"""Gain in triangle quality that is worth a flip."""
FLATTEST = 0.5
"""Smallest cosine between the normals of two triangles that may be flipped."""


def polish(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]:
    """The same vertices with better triangles; boundary vertices stay where they are."""
    for _ in range(ROUNDS):
        faces = flip_edges(vertices, faces)
        vertices = relax(vertices, faces)
    return vertices, flip_edges(vertices, faces)


def relax(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Each inner vertex moved towards the mean of its neighbours within its tangent plane."""
    edges, count = edges_of(faces)
    inner = np.ones(len(vertices), dtype=bool)
    inner[edges[count == 1]] = False
    shift = _mean_of_neighbours(edges, len(vertices)) @ vertices - vertices
    normals = vertex_normals(vertices, faces)
    shift -= (shift * normals).sum(1, keepdims=True) * normals
    return vertices + RELAXATION * np.where(inner[:, None], shift, 0.0)


def _mean_of_neighbours(edges: np.ndarray, count: int) -> csr_matrix:
    i, j = np.concatenate([edges, edges[:, ::-1]]).T
    graph = coo_matrix((np.ones(len(i)), (i, j)), (count, count)).tocsr()
    return diags(1.0 / np.maximum(np.asarray(graph.sum(1)).ravel(), 1.0)) @ graph


def flip_edges(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Int[np.ndarray, "faces 3"]:
    """One round of flips: of the edges that gain, those that gain most in both of their faces."""
    first, second, quads = _quads(faces)
    a, b, c, d = quads.T
    before = np.minimum(triangle_quality(vertices, faces)[first], triangle_quality(vertices, faces)[second])
    new = np.stack([a, d, c], 1), np.stack([d, b, c], 1)
    after = np.minimum(triangle_quality(vertices, new[0]), triangle_quality(vertices, new[1]))
    gain = np.where(_may_flip(vertices, faces, quads, first, second, new), after - before, 0.0)
    best = np.zeros(len(faces))
    np.maximum.at(best, first, gain)
    np.maximum.at(best, second, gain)
    chosen = np.flatnonzero((gain > LEAST_GAIN) & (gain == best[first]) & (gain == best[second]))
    chosen = chosen[_distinct(first[chosen], second[chosen])]
    chosen = chosen[np.unique(keys(quads[chosen, 2:]), return_index=True)[1]] if len(chosen) else chosen
    faces = faces.copy()
    faces[first[chosen]], faces[second[chosen]] = new[0][chosen], new[1][chosen]
    return faces


def _quads(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each inner edge (a, b): its two faces and the vertices a, b, c, d with faces (a, b, c) and (b, a, d)."""
    sides = sides_of(faces)
    order = np.argsort(keys(sides), kind="stable")
    number = keys(sides)[order]
    pair = np.flatnonzero(number[1:] == number[:-1])
    one, two = order[pair], order[pair + 1]
    opposite = np.roll(faces, -2, axis=1).reshape(-1)
    quads = np.column_stack([sides[one], opposite[one], opposite[two]])
    return one // 3, two // 3, quads


def _may_flip(vertices, faces, quads, first, second, new) -> np.ndarray:
    """The new edge does not exist yet, and old and new faces all point in about the same direction."""
    free = ~np.isin(_numbers(quads[:, 2:], len(vertices)), _numbers(edges_of(faces)[0], len(vertices)))
    normals = [unit(face_normals(vertices, one)) for one in (faces[first], faces[second], *new)]
    aligned = [(normals[0] * other).sum(1) > FLATTEST for other in normals[1:]]
    return free & np.all(aligned, axis=0)


def _numbers(pairs: np.ndarray, count: int) -> np.ndarray:
    return pairs.min(1) * count + pairs.max(1)


def _distinct(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Positions in the list of flips that share no face with an earlier one (equal gains)."""
    both = np.concatenate([first, second])
    earliest = np.full(both.max(initial=-1) + 1, len(first))
    np.minimum.at(earliest, both, np.tile(np.arange(len(first)), 2))
    here = np.arange(len(first))
    return np.flatnonzero((earliest[first] == here) & (earliest[second] == here))
