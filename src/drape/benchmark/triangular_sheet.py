"""A rectangle of equilateral triangles: the most even mesh, as garments nearly have it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from drape.geometry.mesh import ClothMesh


def triangular_sheet(length: float, width: float, cells: int) -> tuple[ClothMesh, Int[np.ndarray, " vertices"]]:
    """A sheet in the xy plane, ``0 <= x <= length``, centred on y = 0 [m], and the column of each vertex.

    Columns of vertices stand across it, ``length / cells`` apart; every second one is shifted by half an edge and has
    a vertex on either side, so that all sides are straight.
    """
    step = length / cells
    count = max(round(width / (2.0 / np.sqrt(3.0) * step)), 1)
    even = np.linspace(-0.5, 0.5, count + 1)
    odd = np.concatenate([[-0.5], 0.5 * (even[1:] + even[:-1]), [0.5]])
    heights = [even if k % 2 == 0 else odd for k in range(cells + 1)]
    column = np.repeat(np.arange(cells + 1), [len(each) for each in heights])
    positions = np.stack([step * column, width * np.concatenate(heights), np.zeros(len(column))], axis=-1)
    first = [0, *np.cumsum([len(each) for each in heights]).tolist()]
    faces = [_between(first[k], first[k + 1], count, mirrored=k % 2 == 1) for k in range(cells)]
    return ClothMesh.from_faces(positions.astype(np.float32), np.concatenate(faces), name="sheet of triangles"), column


def _between(left: int, right: int, count: int, *, mirrored: bool) -> Int[np.ndarray, "faces 3"]:
    """Faces between two columns, the second one shifted (or the first, ``mirrored``), anticlockwise seen from +z."""
    even, odd = (right, left) if mirrored else (left, right)
    j = np.arange(count + 1)
    tips = np.stack([even + j, odd + j, odd + j + 1], axis=1)
    bases = np.stack([even + j[:-1], odd + j[:-1] + 1, even + j[1:]], axis=1)
    faces = np.concatenate([tips, bases])
    return faces[:, ::-1] if mirrored else faces
