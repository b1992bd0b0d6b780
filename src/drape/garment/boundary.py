"""Boundary loops (hems, collars, cuffs): their order, and an even spacing of their vertices."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components

from drape.garment.clip import compact
from drape.garment.edges import boundary_edges, keys

FEWEST = 6
"""Vertices of the smallest loop."""


def boundary_loops(faces: Int[np.ndarray, "faces 3"]) -> list[Int[np.ndarray, " loop"]]:
    """Vertices of each loop in order along the sides of the faces; loops sorted by their smallest vertex."""
    sides = boundary_edges(faces)
    if len(sides) == 0:
        return []
    size = int(faces.max()) + 1
    graph = coo_matrix((np.ones(len(sides)), (sides[:, 0], sides[:, 1])), (size, size)).tocsr()
    _, labels = connected_components(graph, directed=False)
    _, starts = np.unique(labels[np.unique(sides)], return_index=True)
    return [breadth_first_order(graph, start, return_predecessors=False) for start in np.unique(sides)[starts]]


def resample_boundary(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], edge: float
) -> tuple[Float[np.ndarray, "kept 3"], Int[np.ndarray, "left 3"]]:
    """Boundary loops with vertices ``edge`` [m] apart: the vertices of a finer mesh move to the nearest of them.

    The loop keeps its shape; sides shorter than half of ``edge`` vanish with their faces.
    """
    target = np.arange(len(vertices))
    moved = vertices.copy()
    for loop in boundary_loops(faces):
        points = vertices[loop]
        steps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
        along, total = np.cumsum(steps) - steps, steps.sum()
        count = max(FEWEST, round(total / edge))
        nearest = np.rint(along * count / total).astype(int) % count
        _, first, group = np.unique(nearest, return_index=True, return_inverse=True)
        target[loop] = loop[first][group.reshape(-1)]
        closed = np.concatenate([points, points[:1]])
        at = nearest[first] * total / count
        arcs = np.append(along, total)
        moved[loop[first]] = np.stack([np.interp(at, arcs, column) for column in closed.T], 1)
    return compact(moved, without_collapsed(target[faces]))


def without_collapsed(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, "left 3"]:
    """Without faces that have lost a corner, and without pairs of faces on the same three vertices."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, number, count = np.unique(keys(faces), return_inverse=True, return_counts=True)
    return faces[count[number] == 1]
