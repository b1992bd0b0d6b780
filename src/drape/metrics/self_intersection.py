"""Faces of a cloth that pass through other faces of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

CHUNK = 2**20
"""Pairs of faces that are looked at together."""
SIDES = ((0, 1), (1, 2), (2, 0))


def self_intersecting(
    x: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Bool[np.ndarray, " faces"]:
    """Faces that a side of another face passes through, or whose side passes through it; neighbours do not count.

    Neighbours share a vertex. Two triangles that do not lie in one plane intersect where a side of one meets the other;
    faces that only touch, or lie in one plane, do not count.
    """
    corners = x[faces].astype(np.float64)
    found = np.zeros(len(faces), bool)
    for pairs in _near_pairs(corners):
        pairs = pairs[~found[pairs].all(axis=1)]  # nothing to learn: saves most of the work in a cloth that exploded
        pairs = pairs[_boxes_overlap(corners, pairs)]
        pairs = pairs[(faces[pairs[:, 0], :, None] != faces[pairs[:, 1], None, :]).all(axis=(1, 2))]
        pairs = pairs[_planes_cross(corners[pairs[:, 0]], corners[pairs[:, 1]])]
        first, second = corners[pairs[:, 0]], corners[pairs[:, 1]]
        hit = np.zeros(len(pairs), bool)
        for start, stop in SIDES:
            hit |= _passes_through(first[:, start], first[:, stop], second)
            hit |= _passes_through(second[:, start], second[:, stop], first)
        found[pairs[hit]] = True
    return found


def _near_pairs(corners: Float[np.ndarray, "faces 3 3"]) -> Iterator[Int[np.ndarray, "pairs 2"]]:
    """All pairs of faces whose circumscribed balls about their centres overlap, in pieces.

    Faces are searched in classes of similar radius, so that a few large ones do not make all searches wide.
    """
    centre = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centre[:, None], axis=-1).max(axis=-1)
    size = np.frexp(radius)[1]
    classes = [np.flatnonzero(size == each) for each in np.unique(size)]
    trees = [cKDTree(centre[members]) for members in classes]
    for k, few in enumerate(classes):
        for many, tree in list(zip(classes, trees, strict=True))[k:]:
            reach = radius[few] + radius[many].max()
            counts = np.cumsum(tree.query_ball_point(centre[few], reach, return_length=True))
            stops = np.unique(np.searchsorted(counts, np.arange(CHUNK, counts[-1] + CHUNK, CHUNK)) + 1)
            for rows in np.split(np.arange(len(few)), stops[stops < len(few)]):
                found = tree.query_ball_point(centre[few[rows]], reach[rows])
                lengths = np.fromiter(map(len, found), np.int64, len(found))
                pair = np.stack([np.repeat(few[rows], lengths), many[np.concatenate(found).astype(np.int64)]], axis=1)
                yield pair[pair[:, 0] < pair[:, 1]] if few is many else pair


def _boxes_overlap(
    corners: Float[np.ndarray, "faces 3 3"], pairs: Int[np.ndarray, "pairs 2"]
) -> Bool[np.ndarray, " pairs"]:
    low, high = corners.min(axis=1), corners.max(axis=1)
    first, second = pairs.T
    return ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=-1)


def _planes_cross(
    first: Float[np.ndarray, "pairs 3 3"], second: Float[np.ndarray, "pairs 3 3"]
) -> Bool[np.ndarray, " pairs"]:
    """Each face has corners on both sides of the plane of the other."""
    crossed = np.ones(len(first), bool)
    for face, other in ((first, second), (second, first)):
        normal = np.cross(face[:, 1] - face[:, 0], face[:, 2] - face[:, 0])
        height = np.einsum("pi,pki->pk", normal, other - face[:, :1])
        crossed &= (height.min(axis=1) < 0) & (height.max(axis=1) > 0)
    return crossed


def _passes_through(
    start: Float[np.ndarray, "pairs 3"], stop: Float[np.ndarray, "pairs 3"], face: Float[np.ndarray, "pairs 3 3"]
) -> Bool[np.ndarray, " pairs"]:
    """The segment meets the inside of the face: its ends are on both sides, its line runs past all corners one way."""
    normal = np.cross(face[:, 1] - face[:, 0], face[:, 2] - face[:, 0])
    below, above = (np.einsum("pi,pi->p", normal, end - face[:, 0]) for end in (start, stop))
    line = (stop - start)[:, None]
    arms = face - start[:, None]
    turns = np.einsum("pki,pki->pk", np.cross(arms, np.roll(arms, -1, axis=1)), np.broadcast_to(line, arms.shape))
    return (below * above < 0) & ((turns > 0).all(axis=1) | (turns < 0).all(axis=1))
