"""A short film of each kind of garment, rendered by Blender, and all of them side by side as one moving picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from drape.blender.output import render
from drape.data.animation_hdf5 import AnimationHeader
from drape.data.animation_writer import AnimationWriter
from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import START, recorded_scene
from drape.data.whole_file import whole_file
from drape.report.contact_sheet import one_of_each_kind
from drape.scene.state import State

QUALITY = 70
"""Of the moving picture, of 100."""


def render_garment_clips(file: GarmentFile, samples: int, size: Sequence[int], every: int) -> list[Path]:
    """One sequence of each kind as ``<kind>/film.mp4``, and ``garments.webp`` with all of them; what is there is kept.

    They lie beside the data, in ``<name>_clips``. Cycles on the CPU with ``samples`` light paths per pixel, ``size`` in
    pixels, each ``every``-th frame.

    Raises:
        DrapeError: a setting that cannot be, no Blender, a full disk; frames that are done stay.
    """
    films, folder = [], file.path.with_name(f"{file.path.stem}_clips")
    for name in one_of_each_kind(file):
        place = folder / file.sequence(name).kind
        films.append(render(_animation(file, name, place), place, samples, size, every))
    return [_together([film.parent / "frames" for film in films], every * file.dt, folder / "garments.webp"), *films]


def _animation(file: GarmentFile, name: str, folder: Path) -> Path:
    """The recorded frames as a stored animation."""
    scene, path = recorded_scene(file.sequence(name)), folder / "recorded.h5"
    x = file.sequence(name).positions[START:]
    v = np.diff(x, axis=0, prepend=(x[:1] - scene.dt * scene.initial.v[None])) / scene.dt
    with AnimationWriter(path, AnimationHeader.of_scene(scene, {}, f"recorded: {name}")) as writer:
        for frame in range(writer.num_frames, writer.header.frames):
            writer.append(State(x[frame], v[frame]), {})
    return path


def _together(lanes: Sequence[Path], seconds: float, path: Path) -> Path:
    """Pictures of the same number of all lanes beside each other, as an animated WebP that plays for ever."""
    rows = zip(*(sorted(lane.glob("frame_*.png")) for lane in lanes), strict=True)
    pictures = [Image.fromarray(np.concatenate([np.asarray(Image.open(each)) for each in row], axis=1)) for row in rows]
    with whole_file(path) as temporary:
        still, *rest = pictures
        timing = {"duration": round(1e3 * seconds), "loop": 0}
        still.save(temporary, "WEBP", save_all=True, append_images=rest, quality=QUALITY, method=6, **timing)
    return path
