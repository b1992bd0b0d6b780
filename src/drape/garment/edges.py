"""The edges of faces, found by sorting one number for each: much faster than sorting pairs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int


def keys(corners: Int[np.ndarray, "items corners"]) -> Int[np.ndarray, " items"]:
    """One number for each set of vertices, whatever their order (two or three of fewer than 2 million)."""
    ordered = np.sort(corners, axis=1)
    size = int(corners.max(initial=0)) + 1
    number = ordered[:, 0].astype(np.int64)
    for column in ordered[:, 1:].T:
        number = number * size + column
    return number


def sides_of(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, "sides 2"]:
    """The three sides of each face, in the direction in which it runs along them."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def edges_of(faces: Int[np.ndarray, "faces 3"]) -> tuple[Int[np.ndarray, "edges 2"], Int[np.ndarray, " edges"]]:
    """Unique edges, smaller index first and sorted, and how many faces each has."""
    sides = sides_of(faces)
    _, first, count = np.unique(keys(sides), return_index=True, return_counts=True)
    return np.sort(sides[first], axis=1), count


def boundary_edges(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, "sides 2"]:
    """Sides that belong to one face only, in the direction in which it runs along them."""
    sides = sides_of(faces)
    _, first, count = np.unique(keys(sides), return_index=True, return_counts=True)
    return sides[first[count == 1]]
