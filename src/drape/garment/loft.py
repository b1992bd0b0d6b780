"""A loose tube around a part of the body: elliptic sections along an axis, as wide as the body or hanging straight."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from drape.garment.blending import smooth_maximum

SECTION = 0.01
"""Distance between sections [m]."""
SLAB = 3
"""Sections on either side whose extent counts: the vertices of a coarse body lie farther apart than sections."""
ROUNDED = 0.08
"""Size of the rounded ends of a loft, so that what it is joined to shows no step [m]."""
SMOOTHING, SOFTENING = 2.0, 4.0
"""Standard deviations of the smoothing along the axis, as measured and as worn [sections]."""


@dataclass(frozen=True, eq=False)
class Loft:
    """Ellipses across an axis; ``along[k]`` is the distance of section k from ``origin`` [m]."""

    origin: Float[np.ndarray, "3"]
    frame: Float[np.ndarray, "3 3"]
    """Rows: the axis and the two directions across it, unit vectors."""
    along: Float[np.ndarray, " sections"]
    centre: Float[np.ndarray, "sections 2"]
    """Centres of the ellipses, across the axis [m]."""
    half: Float[np.ndarray, "sections 2"]
    """Half widths of the ellipses [m]."""

    def hanging(self, fit: float, start: float, stop: float = np.inf) -> Loft:
        """From ``start`` to ``stop`` [m] as wide as the widest section before where ``fit`` is 0; 1 changes nothing."""
        part = (self.along >= start) & (self.along <= stop)
        wide = self.half.copy()
        wide[part] = np.maximum.accumulate(wide[part], axis=0)
        return replace(self, half=(1.0 - fit) * wide + fit * self.half)

    def beyond(self, start: float) -> Loft:
        """The part that begins ``start`` [m] after the origin."""
        part = self.along >= start
        return replace(self, along=self.along[part], centre=self.centre[part], half=self.half[part])

    def wider(self, by: Float[np.ndarray, " sections"] | float) -> Loft:
        """All half widths larger by ``by`` [m]."""
        return replace(self, half=self.half + np.broadcast_to(np.asarray(by), self.along.shape)[:, None])

    def flared(self, start: float, slope: float) -> Loft:
        """Beyond ``start`` [m] wider by ``slope`` times the distance from there."""
        return self.wider(slope * np.maximum(self.along - start, 0.0))

    def smoothed(self) -> Loft:
        """Without kinks along the axis."""
        return replace(self, half=gaussian_filter1d(self.half, SOFTENING, axis=0, mode="nearest"))

    def reach(self, points: Float[np.ndarray, "*grid 3"]) -> Float[np.ndarray, "*grid"]:
        """Reach of the section at each point from the axis in the first direction across it [m]."""
        along = (points - self.origin) @ self.frame[0]
        return np.interp(along, self.along, self.half[:, 0] + np.abs(self.centre[:, 0]))

    def distance(self, points: Float[np.ndarray, "*grid 3"]) -> Float[np.ndarray, "*grid"]:
        """Approximate signed distance to the tube [m], negative inside; first order exact on its surface."""
        local = (points - self.origin) @ self.frame.T
        along = local[..., 0]
        columns = [np.interp(along, self.along, column) for column in (*self.centre.T, *self.half.T)]
        u, v = local[..., 1] - columns[0], local[..., 2] - columns[1]
        a, b = columns[2], columns[3]
        k = np.hypot(u / a, v / b)
        side = k * (k - 1.0) / np.maximum(np.hypot(u / a**2, v / b**2), 1e-6)
        side = np.where(k < 1e-3, -np.minimum(a, b), side)
        end = np.maximum(self.along[0] - along, along - self.along[-1])
        return smooth_maximum(side, end, ROUNDED)


def measure(
    vertices: Float[np.ndarray, "vertices 3"],
    origin: Float[np.ndarray, "3"],
    axis: Float[np.ndarray, "3"],
    length: float,
) -> Loft:
    """The loft of a part of the body: the extents of its vertices in slabs across ``axis``, smoothed along it.

    It reaches from ``origin`` for ``length`` [m]; the first direction across the axis is as close to x as can be.
    """
    axis = axis / np.linalg.norm(axis)
    across = np.array([1.0, 0.0, 0.0]) - axis[0] * axis
    if np.linalg.norm(across) < 0.3:
        across = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
    across /= np.linalg.norm(across)
    frame = np.stack([axis, across, np.cross(axis, across)])
    count = int(np.ceil(length / SECTION)) + 1
    local = (vertices - origin) @ frame.T
    low, high = _extents(local, count)
    known = np.flatnonzero(np.isfinite(low[:, 0]))
    sections = np.arange(count)
    fill = [np.interp(sections, known, column[known]) for column in (*low.T, *high.T)]
    low, high = np.stack(fill[:2], 1), np.stack(fill[2:], 1)
    centre = gaussian_filter1d(0.5 * (low + high), SMOOTHING, axis=0, mode="nearest")
    half = gaussian_filter1d(0.5 * (high - low), SMOOTHING, axis=0, mode="nearest")
    return Loft(origin, frame, sections * SECTION, centre, half)


def _extents(local: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates across the axis in the slab of each section; infinite where it is empty."""
    number = np.rint(local[:, 0] / SECTION).astype(int)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    for shift in range(-SLAB, SLAB + 1):
        at = number + shift
        valid = (at >= 0) & (at < count)
        np.minimum.at(low, at[valid], local[valid, 1:])
        np.maximum.at(high, at[valid], local[valid, 1:])
    return low, high
