"""The round piece of cloth: concentric rings of nearly equal triangles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh


def disc(radius: float, rings: int, inner: float) -> ClothMesh:
    """A flat disc [m] in the xy plane, centred on the origin, one ring of vertices exactly at radius ``inner``.

    Ring k of ``rings`` has 6k vertices, ring 0 the centre, so that all edges are about ``radius / rings`` long. Radii
    grow evenly from 0 to ``inner`` and from there to ``radius``. Faces wind anticlockwise seen from +z.

    Raises:
        DrapeError: radii that are not 0 < inner < radius, fewer than 2 rings.
    """
    if not 0 < inner < radius or rings < 2:
        raise DrapeError(
            f"disc: radius {radius}, rings {rings}, inner radius {inner}; expected 0 < inner radius < radius and "
            "2 rings or more"
        )
    at_inner = min(max(round(rings * inner / radius), 1), rings - 1)
    radii = np.interp(np.arange(rings + 1), [0, at_inner, rings], [0.0, inner, radius])
    ring = np.repeat(np.arange(rings + 1), np.maximum(6 * np.arange(rings + 1), 1))
    first = _first(ring)
    angle = 2 * np.pi * (np.arange(len(ring)) - first) / np.maximum(6 * ring, 1)
    positions = np.stack([radii[ring] * np.cos(angle), radii[ring] * np.sin(angle), np.zeros(len(ring))], axis=-1)
    faces = np.concatenate([_between(k) for k in range(1, rings + 1)])
    return ClothMesh.from_faces(positions, faces, name="disc")


def _first(ring: np.ndarray) -> np.ndarray:
    """Index of the first vertex of a ring: 1 + 6 + 12 + ... + 6 (k - 1), and 0 for the centre."""
    return np.where(ring > 0, 1 + 3 * ring * (ring - 1), 0)


def _between(k: int) -> Int[np.ndarray, "faces 3"]:
    """The triangles between rings k - 1 and k: in each of six sectors k point outwards and k - 1 inwards."""
    outer_count, inner_count = 6 * k, max(6 * (k - 1), 1)
    outer, inner = (int(first) for first in _first(np.array([k, k - 1])))
    sector, j = (grid.reshape(-1) for grid in np.meshgrid(np.arange(6), np.arange(k), indexing="ij"))
    o, i = sector * k + j, sector * (k - 1) + j
    out = [outer + o, outer + (o + 1) % outer_count, inner + i % inner_count]
    back = [inner + i % inner_count, outer + (o + 1) % outer_count, inner + (i + 1) % inner_count]
    return np.concatenate([np.stack(out, axis=1), np.stack(back, axis=1)[j < k - 1]])
