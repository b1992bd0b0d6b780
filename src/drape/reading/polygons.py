"""Polygons cut into triangles: once, and for all frames alike."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from drape.reading.mesh_record import Polygons


def triangulated(
    polygons: Polygons, positions: Float[np.ndarray, "file_vertices 3"]
) -> tuple[Int[np.ndarray, "faces 3"], Int[np.ndarray, " faces"]]:
    """The three corners of each triangle, as places in ``polygons.corners``, and the polygon that it is a part of.

    A quad is cut along its first diagonal, or along the other one if it is concave there; more corners by clipping
    ears in the plane of the polygon. No corner is left out, on a straight side neither, as neighbours share it (the
    usual earcut leaves those out). Polygons of fewer than three corners have no triangle.
    """
    sizes, starts = polygons.sizes, polygons.starts
    points = positions[polygons.corners]
    cut, whose = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    triangles, quads = np.flatnonzero(sizes == 3), np.flatnonzero(sizes == 4)
    cut.append(starts[triangles, None] + np.arange(3))
    whose.append(triangles)
    if len(quads):
        corners = starts[quads, None] + np.arange(4)
        cut.append((starts[quads, None, None] + _halves(points[corners])).reshape(-1, 3))
        whose.append(np.repeat(quads, 2))
    for polygon in np.flatnonzero(sizes > 4):
        start, size = starts[polygon], sizes[polygon]
        ears = clip_ears(_in_plane(points[start : start + size]))
        cut.append(start + ears)
        whose.append(np.full(len(ears), polygon))
    order = np.argsort(np.concatenate(whose), kind="stable")
    return np.concatenate(cut)[order], np.concatenate(whose)[order]


def _halves(corners: Float[np.ndarray, "quads 4 3"]) -> Int[np.ndarray, "quads 2 3"]:
    """Two triangles of each quad."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    ways = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
    x = corners[:, ways]  # quads, ways, triangles, corners, 3
    area = np.einsum("qwti,qi->qwt", np.cross(x[..., 1, :] - x[..., 0, :], x[..., 2, :] - x[..., 0, :]), normal)
    smallest = area.min(axis=2)
    return ways[np.where((smallest[:, 0] <= 0) & (smallest[:, 1] > smallest[:, 0]), 1, 0)]


def _in_plane(points: Float[np.ndarray, "corners 3"]) -> Float[np.ndarray, "corners 2"]:
    """Coordinates in the plane of a polygon, anticlockwise: its normal is that of all its area (Newell)."""
    centred = points - points.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    length = np.linalg.norm(normal)
    if length == 0.0:
        return centred[:, :2]
    across = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(across, normal / length)
    first /= np.linalg.norm(first)
    return np.stack([centred @ first, centred @ np.cross(normal / length, first)], axis=1)


def clip_ears(points: Float[np.ndarray, "corners 2"]) -> Int[np.ndarray, "triangles 3"]:
    """Triangles of a simple polygon, anticlockwise; of all ears the one is cut that is nearest to even sided."""
    left, found = list(range(len(points))), []
    tiny = 1e-9 * float(np.ptp(points, axis=0).max()) ** 2
    while len(left) > 3:
        index = np.array(left)
        ears = np.stack([np.roll(index, 1), index, np.roll(index, -1)], axis=1)
        a, b, c = points[ears[:, 0]], points[ears[:, 1]], points[ears[:, 2]]
        area = _area(a, b, c)
        shape = area / ((b - a) ** 2 + (c - b) ** 2 + (a - c) ** 2).sum(axis=1).clip(min=1e-300)
        bulging = shape > 1e-9
        inward = index[~bulging]  # only these can be inside an ear
        q = points[inward][None]
        sides = [_area(u[:, None], v[:, None], q) for u, v in ((a, b), (b, c), (c, a))]
        corner = (points[inward][None, :, None] == points[ears][:, None]).all(axis=-1).any(axis=-1)
        within = (np.min(sides, axis=0) >= -tiny) & ~corner
        is_ear = bulging & ~within.any(axis=1)
        best = int(np.argmax(np.where(is_ear, shape, np.where(bulging, shape - 1.0, -2.0 + shape))))
        found.append(ears[best])
        del left[best]
    return np.array([*found, left], np.int64)


def _area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the area of triangles in the plane, positive anticlockwise."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
