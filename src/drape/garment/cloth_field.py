"""The cloth before it is cut: a scalar field on a grid whose zero level runs around the body at the wanted distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, zoom
from skimage.measure import marching_cubes

from drape.garment.blending import smooth_minimum
from drape.garment.figure_like import Body

FINEST, COARSEST = 2, 8
"""The distance to the body is asked on every second point of the grid near the body, on every eighth far from it."""
BAND = 0.045
"""Distance from the body within which garments lie and the distance must be accurate [m]."""
BRIDGED = 0.025
"""Cloth bridges hollows of the body of about this radius [m]."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A regular grid: ``shape`` points from ``low``, ``spacing`` [m] apart."""

    low: Float[np.ndarray, "3"]
    spacing: float
    shape: tuple[int, int, int]

    @classmethod
    def covering(cls, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], spacing: float) -> Grid:
        """The grid from ``low`` to at least ``high`` in which every :data:`COARSEST`-th point ends at its border."""
        cells = np.ceil((high - low) / (spacing * COARSEST)).astype(int) * COARSEST
        nx, ny, nz = (int(count) + 1 for count in cells)
        return cls(low, spacing, (nx, ny, nz))

    def points(self, every: int = 1) -> Float[np.ndarray, "nx ny nz 3"]:
        """Positions of every ``every``-th point [m]."""
        axes = [self.low[k] + self.spacing * np.arange(0, self.shape[k], every) for k in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def body_distance(body: Body, grid: Grid) -> Float[np.ndarray, "nx ny nz"]:
    """Signed distance to the body [m] where hollows narrower than :data:`BRIDGED` count as body.

    A Gaussian of the field raises it where the body is convex and lowers it in hollows; the minimum of both fills
    the hollows only.
    """
    distance = _distance(body, grid, FINEST)
    blurred = gaussian_filter(distance, BRIDGED / (grid.spacing * FINEST), mode="nearest")
    return _refined(smooth_minimum(distance, blurred, 0.005), FINEST, 3)


def _distance(body: Body, grid: Grid, every: int) -> np.ndarray:
    """On every ``every``-th point: asked where it may be less than :data:`BAND`, elsewhere from the coarser points.

    A distance changes by at most the way: the corners of a coarser cell bound it inside.
    """
    points = grid.points(every)
    if every == COARSEST:
        return body.signed_distance(points.reshape(-1, 3)).reshape(points.shape[:3])
    distance = _refined(_distance(body, grid, 2 * every), 2, 1)
    near = np.abs(distance) < BAND + np.sqrt(3.0) * every * grid.spacing
    distance[near] = body.signed_distance(points[near])
    return distance


def _refined(values: np.ndarray, times: int, order: int) -> np.ndarray:
    """Values on a grid that is ``times`` finer: splines of this ``order``, the same at the old points."""
    return zoom(values, [((n - 1) * times + 1) / n for n in values.shape], order=order)


def zero_level(field: Float[np.ndarray, "nx ny nz"], grid: Grid) -> tuple[Float[np.ndarray, "vertices 3"], np.ndarray]:
    """Triangles of the zero level of a field, wound so that normals point to where it grows."""
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(grid.spacing,) * 3, gradient_direction="descent")
    return vertices.astype(np.float64) + grid.low, faces.astype(np.int64)
