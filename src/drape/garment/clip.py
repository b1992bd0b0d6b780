"""Cutting a triangle mesh along a level of a scalar field, and what holds together afterwards."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from drape.garment.edges import edges_of, keys

TINY = 1e-6
"""Field values closer to 0 are moved off it, so that no cut goes through a vertex [m]."""


def clip(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], field: Float[np.ndarray, " vertices"]
) -> tuple[Float[np.ndarray, "kept 3"], Int[np.ndarray, "left 3"]]:
    """The part of the mesh where ``field`` (linear on each edge) is positive; winding is kept."""
    field = np.where(np.abs(field) < TINY, np.where(field < 0, -TINY, TINY), field)
    inside = field > 0.0
    count = inside[faces].sum(1)
    one = _turned(faces[count == 1], inside[faces[count == 1]])
    two = _turned(faces[count == 2], ~inside[faces[count == 2]])
    cut = np.concatenate([one[:, [0, 1]], one[:, [0, 2]], two[:, [0, 1]], two[:, [0, 2]]])
    _, first, new = np.unique(keys(cut), return_index=True, return_inverse=True)
    ends, new = np.sort(cut[first], axis=1), new + len(vertices)
    share = field[ends[:, 0]] / (field[ends[:, 0]] - field[ends[:, 1]])
    points = vertices[ends[:, 0]] + share[:, None] * (vertices[ends[:, 1]] - vertices[ends[:, 0]])
    p, q, r, s = np.split(new, np.cumsum([len(one), len(one), len(two)]))
    pieces = [
        faces[count == 3],
        np.stack([one[:, 0], p, q], 1),
        np.stack([r, two[:, 1], two[:, 2]], 1),
        np.stack([r, two[:, 2], s], 1),
    ]
    return compact(np.concatenate([vertices, points]), np.concatenate(pieces))


def _turned(faces: np.ndarray, odd: np.ndarray) -> np.ndarray:
    """Faces turned so that their one ``odd`` corner comes first."""
    first = odd.argmax(1)[:, None]
    return np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)


def compact(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[Float[np.ndarray, "kept 3"], Int[np.ndarray, "faces 3"]]:
    """Without the vertices that no face uses."""
    used, numbers = np.unique(faces, return_inverse=True)
    return vertices[used], numbers.reshape(-1, 3)


def component_labels(faces: Int[np.ndarray, "faces 3"], num_vertices: int) -> tuple[int, Int[np.ndarray, " vertices"]]:
    """Number of connected parts and the part of each vertex."""
    edges, _ = edges_of(faces)
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (num_vertices, num_vertices))
    count, labels = connected_components(graph, directed=False)
    return int(count), labels.astype(np.int64)


def largest_component(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[Float[np.ndarray, "kept 3"], Int[np.ndarray, "left 3"]]:
    """The connected part with the most faces."""
    _, labels = component_labels(faces, len(vertices))
    of_faces = labels[faces[:, 0]]
    return compact(vertices, faces[of_faces == np.bincount(of_faces).argmax()])
