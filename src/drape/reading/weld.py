"""Vertices that a file has several times, made one: at seams of texture, material, panel and shading."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

SHARE = 0.01
"""Of the median edge: vertices of borders that are nearer than this are the two sides of a seam."""


def exact_copies(positions: Float[np.ndarray, "frames points 3"]) -> Int[np.ndarray, " points"]:
    """The first point that is at the same place in every frame."""
    _, first, which = np.unique(positions[0], axis=0, return_index=True, return_inverse=True)
    same = first[which.reshape(-1)]
    together = (positions == positions[:, same]).all(axis=(0, 2))
    return np.where(together, same, np.arange(len(same)))


def near_copies(
    positions: Float[np.ndarray, "frames points 3"], faces: Int[np.ndarray, "faces 3"], reach: float
) -> Int[np.ndarray, " points"]:
    """The first of all points within ``reach`` of each other in every frame, one of each pair on a border.

    Points of one face stay apart, so that no face loses its area.
    """
    count = positions.shape[1]
    used, border = np.unique(faces), border_vertices(faces, count)
    pairs = used[cKDTree(positions[0, used]).query_pairs(reach, output_type="ndarray").reshape(-1, 2)]
    pairs = pairs[border[pairs].any(axis=1)]
    apart = np.linalg.norm(positions[:, pairs[:, 0]] - positions[:, pairs[:, 1]], axis=2).max(axis=0, initial=0.0)
    pairs = pairs[(apart <= reach) & ~_joined(pairs, faces, count)]
    _, group = connected_components(coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count)), directed=False)
    _, first = np.unique(group, return_index=True)
    return first[group]


def median_edge(points: Float[np.ndarray, "points 3"], faces: Int[np.ndarray, "faces 3"]) -> float:
    """Of all sides of all faces; 0 without faces."""
    lengths = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)
    return float(np.median(lengths)) if lengths.size else 0.0


def border_vertices(faces: Int[np.ndarray, "faces 3"], count: int) -> Bool[np.ndarray, " points"]:
    """Those of edges that have a single face."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, times = np.unique(edges, axis=0, return_counts=True)
    found = np.zeros(count, bool)
    found[edges[times == 1]] = True
    return found


def _joined(
    pairs: Int[np.ndarray, "pairs 2"], faces: Int[np.ndarray, "faces 3"], count: int
) -> Bool[np.ndarray, " pairs"]:
    """Whether a face has both."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    key = np.array([count, 1])
    return np.isin(np.sort(pairs, axis=1) @ key, edges @ key)
