"""A stored animation at a glance, in seconds and without Blender: a strip of frames as PNG, the motion as GIF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image
from tqdm import tqdm

from drape.data.animation_hdf5 import AnimationFile
from drape.data.look import Look
from drape.data.whole_file import whole_file
from drape.report.picture_sheet import Line, draw_pictures
from drape.report.raster import Surface, draw
from drape.scene.camera import Camera

FRAMES = 6
TALLEST, WIDEST = 260, 420
"""Pixels of one frame of the strip."""
BODY_COLOUR = (0.62, 0.62, 0.64)
HIGHEST_RATE = 25.0
"""Frames per second of a GIF; players slow down faster ones."""


def preview(path: Path | str, png: Path | str) -> Path:
    """Draw six frames of the animation at ``path`` (HDF5), evenly spaced from the first to the last; returns ``png``.

    Raises:
        DrapeError: no animation at ``path``.
    """
    with AnimationFile(path) as file:
        look, dt, last = Look(file), file.header.dt, file.num_frames - 1
        frames = np.unique(np.linspace(0, last, FRAMES).round().astype(int)).tolist()
        width, height = _size(look)
        camera = look.camera(width / height)
        pictures = [_picture(look, frame, camera, width, height) for frame in frames]
    return draw_pictures([Line(pictures, [frame * dt for frame in frames])], Path(png))


def preview_film(path: Path | str, gif: Path | str, height: int = 300) -> Path:
    """Draw the animation at ``path`` (HDF5) as a GIF that runs in real time, at most 25 frames a second; returns it.

    Raises:
        DrapeError: no animation at ``path``.
    """
    gif = Path(gif)
    with AnimationFile(path) as file:
        look, dt = Look(file), file.header.dt
        every = max(1, round(1.0 / (HIGHEST_RATE * dt)))
        width = height * 4 // 3
        camera = look.camera(width / height)
        frames = tqdm(range(0, file.num_frames, every), desc="drawing", unit=" frames", leave=False)
        pictures = [Image.fromarray(_picture(look, frame, camera, width, height)) for frame in frames]
    with whole_file(gif) as temporary:
        times = 10.0 * np.round(100.0 * dt * every * np.arange(len(pictures) + 1))  # GIF counts in 10 ms
        pictures[0].save(temporary, save_all=True, append_images=pictures[1:], duration=np.diff(times).tolist(), loop=0)
    return gif


def _size(look: Look) -> Sequence[int]:
    """Width and height of a frame, in the proportions of what is to be seen."""
    extent = look.box[1] - look.box[0]
    aspect = max(float(np.hypot(extent[0], extent[1])), 1e-9) / max(float(extent[2]), 1e-9)
    aspect = min(max(aspect, 0.6), WIDEST / TALLEST)
    return round(TALLEST * aspect), TALLEST


def _picture(look: Look, frame: int, camera: Camera, width: int, height: int) -> UInt8[np.ndarray, "height width 3"]:
    header = look.file.header
    surfaces = [Surface(look.cloth(frame), header.faces, look.colour)]
    if header.obstacle is not None:
        surfaces.append(Surface(look.body(frame), header.obstacle.faces, BODY_COLOUR))
    return (255 * draw(surfaces, camera, width, height)).round().astype(np.uint8)
