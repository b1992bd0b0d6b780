"""Export and render a stored animation; Blender does its part in a process of its own. Does not import bpy."""

from __future__ import annotations

import contextlib
import hashlib
import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from tqdm import tqdm

from drape.blender.presets import blender_version
from drape.blender.process import BlenderProcess
from drape.data.animation_hdf5 import AnimationFile
from drape.data.export_meshes import export_npz, export_obj
from drape.data.look import Look
from drape.data.whole_file import whole_file
from drape.errors import DrapeError

BLENDER_FORMATS = {"abc": ".abc", "usd": ".usdc", "glb": ".glb"}
"""Endings of what only Blender can write."""
FORMATS = ("obj", "npz", *BLENDER_FORMATS)


@dataclass(frozen=True)
class Output:
    """Output of an animation, checked before anything is simulated; see :func:`export` and :func:`render`.

    Raises:
        DrapeError: see :func:`check_formats` and, for ``cycles``, :func:`check_pictures`.
    """

    formats: list[str]
    render: Literal["preview", "cycles", "none"]
    samples: int
    size: list[int]
    every: int

    def __post_init__(self) -> None:
        check_formats(self.formats)
        if self.render == "cycles":
            check_pictures(self.samples, self.size, self.every)


def export(path: Path | str, formats: Sequence[str], folder: Path | str) -> list[Path]:
    """Write the animation at ``path`` (HDF5) into ``folder`` in each of ``formats``; returns what was written.

    ``npz``, ``abc``, ``usd`` (``.usdc``) and ``glb`` are files named as the animation is; ``obj`` is the folder
    ``obj/`` with a file for each frame. A file is whole or absent, and replaces an earlier one.

    Raises:
        DrapeError: an unknown format, no animation at ``path``, no Blender for a format that needs it, a full disk.
    """
    path, folder = Path(path), Path(folder)
    check_formats(formats)
    written = []
    try:
        with AnimationFile(path) as file:
            if "obj" in formats:
                written.append(export_obj(file, folder / "obj"))
            if "npz" in formats:
                written.append(export_npz(file, folder / f"{path.stem}.npz"))
        rest = [name for name in formats if name in BLENDER_FORMATS]
        if rest:
            with _blender(path) as blender:
                for name in rest:
                    target = folder / f"{path.stem}{BLENDER_FORMATS[name]}"
                    with whole_file(target) as temporary:
                        blender.send({"export": str(temporary.absolute())})
                        blender.receive(f"{target}")
                    written.append(target)
    except OSError as error:
        raise _no_room(folder, error) from error
    return written


def check_formats(formats: Sequence[str]) -> None:
    """Refuse a format that there is not, before anything is simulated.

    Raises:
        DrapeError: it, and those that there are; or Blender is missing.
    """
    unknown = [name for name in formats if name not in FORMATS]
    if unknown:
        raise DrapeError(f"output.formats: found {', '.join(map(str, unknown))}; expected some of {', '.join(FORMATS)}")
    if any(name in BLENDER_FORMATS for name in formats):
        _need_blender("output.formats", "obj and npz are written without it")


def check_pictures(samples: int, size: Sequence[int], every: int = 1) -> None:
    """Refuse settings with which nothing can be rendered, before anything is simulated.

    Raises:
        DrapeError: the setting, found and expected; or Blender is missing.
    """
    for name, value in (("samples", samples), ("every", every)):
        if not isinstance(value, int) or value < 1:
            raise DrapeError(f"output.{name}: found {value!r}; expected a whole number from 1 on")
    if len(size) != 2 or any(not isinstance(side, int) or side < 16 or side % 2 for side in size):
        raise DrapeError(f"output.size: found {list(size)}; expected width and height in pixels, even, from 16 on")
    _need_blender("output.render=cycles", "output.render=preview draws without it")


def _need_blender(setting: str, otherwise: str) -> None:
    try:
        blender_version()
    except DrapeError as error:
        raise DrapeError(f"{setting}: {error}; {otherwise}") from error


def render(
    path: Path | str, folder: Path | str, samples: int = 16, size: Sequence[int] = (960, 720), every: int = 1
) -> Path:
    """Render the animation at ``path`` (HDF5) to ``folder/frames/frame_0000.png`` … and ``folder/film.mp4``.

    Cycles on the CPU with ``samples`` light paths per pixel, ``size`` in pixels, frames 0, ``every``, 2 ``every`` …;
    the film runs in real time. Frames that are there, of this motion with these settings, are not rendered again.
    Returns the film.

    Raises:
        DrapeError: a setting that cannot be, no animation at ``path``, no Blender, a full disk; frames stay.
    """
    path, folder, size = Path(path), Path(folder), [int(side) for side in size]
    check_pictures(samples, size, every)
    with AnimationFile(path) as file:
        keys = _keys(Look(file), samples, size, every)
        dt = every * file.header.dt
    frames, film = folder / "frames", folder / "film.mp4"
    names = {frame: f"frame_{frame:04d}.png" for frame in keys}
    try:
        done = _done(frames)
        missing = [frame for frame, key in keys.items() if done.get(names[frame]) != key]
        if not missing and film.exists() and done.get(film.name) == _film_key(keys):
            return film
        with _blender(path) as blender:
            for frame in tqdm(missing, desc="rendering", unit=" frames"):
                picture = (frames / names[frame]).absolute()
                picture.parent.mkdir(parents=True, exist_ok=True)
                blender.send({"frame": frame, "picture": str(picture), "samples": samples, "size": size})
                blender.receive(f"frame {frame}")
                _note(frames, done, names[frame], keys[frame])
            pictures = [str((frames / names[frame]).absolute()) for frame in keys]
            blender.send({"film": str(film.absolute()), "pictures": pictures, "dt": dt})
            blender.receive(f"{film}")
            _note(frames, done, film.name, _film_key(keys))
    except OSError as error:
        raise _no_room(folder, error) from error
    return film


def _keys(look: Look, samples: int, size: Sequence[int], every: int) -> dict[int, str]:
    """Per frame to be rendered a check sum of all that determines its picture."""
    camera, header = look.camera(size[0] / size[1]), look.file.header
    common = hashlib.sha256(json.dumps([samples, list(size), look.colour]).encode())
    for array in (camera.position, look.box, header.faces):
        common.update(np.ascontiguousarray(array).data)
    keys = {}
    for frame in range(0, look.file.num_frames, every):
        key = common.copy()
        key.update(np.ascontiguousarray(look.cloth(frame)).data)
        if look.has_body:
            key.update(np.ascontiguousarray(look.body(frame)).data)
        keys[frame] = key.hexdigest()
    return keys


def _film_key(keys: dict[int, str]) -> str:
    return hashlib.sha256(json.dumps(keys).encode()).hexdigest()


def _done(frames: Path) -> dict[str, str]:
    """Names of pictures that are there and the check sums of what they show."""
    try:
        noted = json.loads((frames / "frames.json").read_text(encoding="utf-8"))
    except (FileNotFoundError, json.JSONDecodeError):
        return {}
    return {name: key for name, key in noted.items() if (frames / name).exists() or name.endswith(".mp4")}


def _note(frames: Path, done: dict[str, str], name: str, key: str) -> None:
    done[name] = key
    with whole_file(frames / "frames.json") as temporary:
        temporary.write_text(json.dumps(done, indent=1), encoding="utf-8")


@contextlib.contextmanager
def _blender(path: Path) -> Iterator[BlenderProcess]:
    with tempfile.TemporaryDirectory() as folder:
        arguments = [str(path.absolute()), folder]
        with BlenderProcess("drape.blender.output_worker", arguments, Path(folder) / "blender.log") as blender:
            yield blender


def _no_room(folder: Path, error: OSError) -> DrapeError:
    return DrapeError(
        f"{folder}: {error}; what is finished is kept: make room or set the permissions, then run the same command "
        "again"
    )
