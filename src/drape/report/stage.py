"""Recorded and animated garments in the same light: a camera that follows the recorded one, the body in grey."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int, UInt8

from drape.report.preview import BODY_COLOUR
from drape.report.raster import Surface, cut_out
from drape.scene.camera import Camera

ASPECT = 0.75
"""Width over height of a picture."""
ROOM = 1.3
"""Size of the picture over that of the garment."""
SMOOTHED = 0.4
"""Standard deviation of the time over which the camera averages what it follows [s]."""
MOST_ERROR = 0.10
"""Distance to the recorded garment at which colours end [m]."""
RIGHT, WRONG = np.array([0.62, 0.78, 0.80]), np.array([0.80, 0.16, 0.18])
"""Colours of no error and of :data:`MOST_ERROR` or more."""


class Stage:
    """View that all pictures of one sequence share.

    Args:
        reference: positions of the recorded garment, which the camera follows [m].
        dt: time between frames [s].
        faces: of the garment.
        body_faces: of the body.
        colour: of the garment, sRGB.
        height: of a picture [pixels].
    """

    def __init__(
        self,
        reference: Float[np.ndarray, "frames vertices 3"],
        dt: float,
        faces: Int[np.ndarray, "faces 3"],
        body_faces: Int[np.ndarray, "body_faces 3"],
        colour: tuple[float, float, float],
        height: int = 300,
    ) -> None:
        self.reference, self.faces, self.body_faces, self.colour = reference, faces, body_faces, colour
        self.width, self.height = round(height * ASPECT), height
        middle = 0.5 * (reference.min(axis=1) + reference.max(axis=1))
        self.centre = smoothed(middle, SMOOTHED / dt)
        seen = (middle + ROOM * (reference.transpose(1, 0, 2) - middle)).transpose(1, 0, 2) - self.centre[:, None]
        self.camera = Camera.framing(seen, ASPECT)

    def picture(
        self, frame: int, x: Float[np.ndarray, "vertices 3"], body: Float[np.ndarray, "body_vertices 3"]
    ) -> UInt8[np.ndarray, "height width 4"]:
        """Garment and body at one frame, nothing behind them."""
        return self._drawn(frame, Surface(x - self.centre[frame], self.faces, self.colour), body)

    def error_picture(
        self, frame: int, x: Float[np.ndarray, "vertices 3"], body: Float[np.ndarray, "body_vertices 3"]
    ) -> UInt8[np.ndarray, "height width 4"]:
        """The same, coloured by the distance of each vertex to the recorded one."""
        share = np.linalg.norm(x - self.reference[frame], axis=1) / MOST_ERROR
        colours = RIGHT + np.minimum(share, 1.0)[:, None] * (WRONG - RIGHT)
        return self._drawn(frame, Surface(x - self.centre[frame], self.faces, colours), body)

    def _drawn(self, frame: int, garment: Surface, body: np.ndarray) -> UInt8[np.ndarray, "height width 4"]:
        surfaces = [Surface(body - self.centre[frame], self.body_faces, BODY_COLOUR), garment]
        return (255 * cut_out(surfaces, self.camera, self.width, self.height)).round().astype(np.uint8)


def smoothed(path: Float[np.ndarray, "frames 3"], deviation: float) -> Float[np.ndarray, "frames 3"]:
    """A path averaged over time with a Gaussian of that many frames."""
    times = np.arange(len(path))
    weights = np.exp(-0.5 * ((times[:, None] - times) / max(deviation, 1e-6)) ** 2)
    return (weights / weights.sum(axis=1, keepdims=True)) @ path


def shown_frames(frames: int, dt: float, rate: float = 15.0) -> Iterator[int]:
    """Frames of a clip of at most ``rate`` pictures a second, from the first on."""
    return iter(range(0, frames, max(1, round(1.0 / (rate * dt)))))
