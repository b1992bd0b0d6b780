"""From an implicit surface to an even triangle mesh, and back to exact distances."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import binary_dilation
from skimage.measure import marching_cubes

COARSE = 4
"""Cells of the coarse grid that finds where the fine one is needed, in cells of the fine one."""


def sample_mirrored(
    field: Callable[[np.ndarray], np.ndarray], low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], cell: float
) -> tuple[Float[np.ndarray, "x y z"], Float[np.ndarray, "3"]]:
    """A field that is even in x on a grid of side ``cell`` [m], and the corner of the grid.

    It is evaluated for x >= 0 and close to its zero only; elsewhere the values are those of a coarse grid.
    """
    counts = np.ceil(np.array([high[0], *(high - low)[1:]]) / (COARSE * cell)).astype(int)
    start = np.array([0.0, low[1], low[2]])
    coarse_points = start + COARSE * cell * np.moveaxis(np.indices(counts + 1), 0, -1).reshape(-1, 3)
    coarse = field(coarse_points).reshape(counts + 1)
    near = binary_dilation(np.abs(coarse) < COARSE * cell)
    shape = counts * COARSE + 1
    index = np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3)
    fine = np.asarray(coarse[tuple((index / COARSE + 0.5).astype(int).T)])
    chosen = near[tuple((index / COARSE + 0.5).astype(int).T)]
    fine[chosen] = field(start + cell * index[chosen])
    half = fine.reshape(shape)
    values = np.concatenate([half[:0:-1], half])
    return values, np.array([-cell * (shape[0] - 1), low[1], low[2]])


def level_surface(
    values: Float[np.ndarray, "x y z"], corner: Float[np.ndarray, "3"], cell: float
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]:
    """The zero level as a dense closed mesh, faces winding outwards (Lewiner 2003)."""
    positions, faces, _, _ = marching_cubes(values.astype(np.float32), 0.0, spacing=(cell,) * 3)
    return positions.astype(np.float64) + corner, faces.astype(np.int64)
