"""Implicit surfaces: lofts, round cones, ellipsoids, and their smooth union.

Values are negative inside and close to distances [m] near the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

SAMPLES = 512
"""Of a profile; linear in between, which is far below a millimetre."""


@dataclass(frozen=True, eq=False)
class Loft:
    """A stack of ellipses along an axis: half widths across and deep, and where the middles are, at stations [m]."""

    origin: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    across: Float[np.ndarray, "3"]
    stations: Float[np.ndarray, " stations"]
    width: Float[np.ndarray, " stations"]
    depth: Float[np.ndarray, " stations"]
    shift_across: Float[np.ndarray, " stations"]
    shift_deep: Float[np.ndarray, " stations"]
    """Along axis x across."""

    def __call__(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        offset = points - self.origin
        along = offset @ self.axis
        width, depth, shift_across, shift_deep, lean = self._sections(along)
        x = offset @ self.across - shift_across
        y = offset @ np.cross(self.axis, self.across) - shift_deep
        side = ellipse_distance(x, y, width, depth) * lean
        beyond = np.maximum(self.stations[0] - along, along - self.stations[-1])
        outside = np.hypot(np.maximum(side, 0.0), beyond)
        return np.where(beyond > 0, outside, np.maximum(side, beyond))

    def _sections(self, along: np.ndarray) -> list[np.ndarray]:
        grid = np.linspace(self.stations[0], self.stations[-1], SAMPLES)
        curves = (self.width, self.depth, self.shift_across, self.shift_deep)
        sampled = [PchipInterpolator(self.stations, curve)(grid) for curve in curves]
        slope = np.gradient(0.5 * (sampled[0] + sampled[1]), grid)
        sampled.append(1.0 / np.hypot(1.0, slope))  # a leaning side is nearer than it seems across the axis
        return [np.interp(along, grid, curve) for curve in sampled]


def ellipse_distance(
    x: Float[np.ndarray, " points"],
    y: Float[np.ndarray, " points"],
    width: Float[np.ndarray, " points"] | float,
    depth: Float[np.ndarray, " points"] | float,
) -> Float[np.ndarray, " points"]:
    """k0 (k0 − 1) / k1 with k0 = |(x/a, y/b)|, k1 = |(x/a², y/b²)|: to first order the distance to the ellipse."""
    k0 = np.hypot(x / width, y / depth)
    k1 = np.hypot(x / np.square(width), y / np.square(depth))
    return np.where(k0 > 1e-3, k0 * (k0 - 1.0) / np.maximum(k1, 1e-9), -np.minimum(width, depth))


def ellipsoid(
    points: Float[np.ndarray, "points 3"], centre: Float[np.ndarray, "3"], half: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " points"]:
    """As :func:`ellipse_distance`, in three dimensions, for the half axes ``half`` [m]."""
    scaled = (points - centre) / half
    k0 = np.linalg.norm(scaled, axis=1)
    k1 = np.linalg.norm(scaled / half, axis=1)
    return np.where(k0 > 1e-3, k0 * (k0 - 1.0) / np.maximum(k1, 1e-9), -half.min())


def round_cone(
    points: Float[np.ndarray, "points 3"],
    start: Float[np.ndarray, "3"],
    end: Float[np.ndarray, "3"],
    start_radius: float,
    end_radius: float,
) -> Float[np.ndarray, " points"]:
    """Exact distance to the hull of two balls."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    offset = points - start
    along = offset @ axis / length
    away = np.sqrt(np.maximum((offset**2).sum(axis=1) - along**2, 0.0))
    slope = (start_radius - end_radius) / length
    lean = np.sqrt(max(1.0 - slope**2, 0.0))
    side = lean * along - slope * away  # along the slanted side, from where it leaves the first ball
    to_start = np.hypot(along, away) - start_radius
    to_end = np.hypot(along - length, away) - end_radius
    to_side = lean * away + slope * along - start_radius
    return np.where(side < 0, to_start, np.where(side > lean * length, to_end, to_side))


def smooth_union(
    first: Float[np.ndarray, " points"], second: Float[np.ndarray, " points"], blend: float
) -> Float[np.ndarray, " points"]:
    """Minimum of the two, rounded over ``blend`` [m] where they meet (quadratic polynomial)."""
    overlap = np.maximum(blend - np.abs(first - second), 0.0)
    return np.minimum(first, second) - overlap**2 / (4.0 * blend)
