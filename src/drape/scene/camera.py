"""A camera that sees all of a motion."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

AZIMUTH, ELEVATION = np.radians(30.0), np.radians(16.0)
"""Direction of view: turned about the vertical from the y axis, and from above."""
HALF_ANGLE = np.tan(np.radians(14.0))
"""Of the shorter side of the picture (tangent)."""
MARGIN = 0.86
"""Part of the picture that is filled."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole that looks along -z of its own axes; the world is z up."""

    position: Float[np.ndarray, "3"]
    """[m]"""
    axes: Float[np.ndarray, "3 3"]
    """Columns: to the right, up, towards the viewer."""
    half_angles: Float[np.ndarray, "2"]
    """Tangents of half the angle of view, across and up."""

    @classmethod
    def framing(cls, clouds: Iterable[Float[np.ndarray, "points 3"]], aspect: float) -> Camera:
        """The nearest camera in the usual direction that has all points of all ``clouds`` in its picture.

        ``aspect`` is width / height. With right (or up) r, forward f, half angle t, a point p is inside where
        |(p - c)·r| <= t (p - c)·f, that is c·r - t c·f >= a and -c·r - t c·f >= b with the extremes
        a = max p·(r - t f), b = max p·(-r - t f): so c·r = (a - b) / 2 and c·f <= -(a + b) / 2t.
        """
        axes = _axes()
        sides, forward = axes[:, :2], -axes[:, 2]
        half_angles = HALF_ANGLE * np.array([max(aspect, 1.0), max(1.0 / aspect, 1.0)])
        t = MARGIN * half_angles
        planes = np.concatenate([sides - np.outer(forward, t), -sides - np.outer(forward, t)], axis=1)
        a, b = np.max([(cloud @ planes).max(axis=0) for cloud in clouds], axis=0).reshape(2, 2)
        return cls(sides @ (a - b) / 2.0 + forward * (-(a + b) / (2.0 * t)).min(), axes, half_angles)

    def project(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        """Place in the picture (-1 to 1 across and up) and distance [m] along the line of sight."""
        local = (points - self.position) @ self.axes
        depth = -local[:, 2]
        return np.column_stack([local[:, :2] / (depth[:, None] * self.half_angles), depth])


def _axes() -> Float[np.ndarray, "3 3"]:
    cos, sin = np.cos(AZIMUTH), np.sin(AZIMUTH)
    right = np.array([cos, sin, 0.0])
    viewer = np.array([sin * np.cos(ELEVATION), -cos * np.cos(ELEVATION), np.sin(ELEVATION)])
    return np.stack([right, np.cross(viewer, right), viewer], axis=1)
