"""One recorded sequence from a file or a folder: positions in metres with +z up, and what else the file says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.scene.animation_file import KINDS as ANIMATIONS
from drape.scene.mesh_file import KINDS as MESHES
from drape.scene.mesh_file import to_metres
from drape.scene.motion_clip import MotionClip
from drape.scene.obstacle_file import ARRAYS, natural_order, read_clip

LONGEST = 1_000_000
"""Frames that are read of a file at most: all."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A sequence as its file gives it."""

    path: Path
    faces: Int[np.ndarray, "faces 3"]
    positions: Float[np.ndarray, "frames vertices 3"]
    """[m], +z up."""
    fps: float
    """[1/s]"""
    rest: Float[np.ndarray, "vertices 3"] | None = None
    """Rest shape [m], of a file that has ``rest_positions``."""
    mass: Float[np.ndarray, " vertices"] | None = None
    """Mass of each vertex [kg], of a file that has ``mass``."""


def find_sequences(root: Path) -> list[Path]:
    """The sequences of a folder, in natural order: files that hold a motion, and folders with a mesh for each frame.

    Raises:
        DrapeError: no such folder, or nothing in it that can be a sequence.
    """
    if not root.is_dir():
        raise DrapeError(f"data.root: {root}: no such folder; expected one with a file or a folder for each sequence")
    entries = sorted((entry for entry in root.iterdir() if not entry.name.startswith(".")), key=natural_order)
    found = [entry for entry in entries if entry.suffix.lower() in (*ARRAYS, *ANIMATIONS) or _has_meshes(entry)]
    if not found and _has_meshes(root):
        raise DrapeError(
            f"data.root: {root}: found the frames of one sequence; expected a folder with a file or a folder for each "
            "sequence, at least two: give the folder above, with another sequence beside this one"
        )
    if not found:
        kinds = ", ".join((*ARRAYS, *ANIMATIONS))
        raise DrapeError(
            f"data.root: {root}: found no sequence; expected files ({kinds}) or folders of meshes ({', '.join(MESHES)})"
        )
    return found


def _has_meshes(folder: Path) -> bool:
    return folder.is_dir() and any(file.suffix.lower() in MESHES for file in folder.iterdir())


def read_recording(path: Path, data: Mapping) -> Recording:
    """Read one sequence; ``data`` has ``fps`` (null where files say theirs), ``scale`` and ``up_axis``.

    Arrays in npz and HDF5 may be accompanied by ``rest_positions [vertices, 3]`` and ``mass [vertices]``, kg.

    Raises:
        DrapeError: no rate or two, a topology that changes, NaN, or whatever its reader refuses.
    """
    rate = data["fps"]
    if rate is not None and not isinstance(rate, int | float):
        raise DrapeError(f"data.fps: found {rate!r}; expected frames per second")
    rate = None if rate is None else float(rate)
    if rate is None and path.suffix.lower() in ANIMATIONS and not path.is_dir():
        raise DrapeError(
            f"{path}: found a file whose reader does not tell its rate; expected frames per second: set data.fps"
        )
    clip = read_clip(path, 1.0 / (rate or 1.0), LONGEST)
    extras = _extras(path)
    up_axis = "z" if clip.z_is_up else data["up_axis"]
    lengths = {name: extras.get(name) for name in ("rest_positions", "mass")}
    count = clip.positions.shape[1]
    for name, array in lengths.items():
        expected = (count, 3) if name == "rest_positions" else (count,)
        if array is not None and (array.shape != expected or not np.isfinite(array).all()):
            raise DrapeError(
                f"{path}: {name}: found numbers of shape {array.shape}; expected finite ones of {expected}"
            )
    rest, mass = lengths.values()
    return Recording(
        path=path,
        faces=clip.faces,
        positions=to_metres(_finite(clip, path), path, data["scale"], up_axis),
        fps=_rate(clip, rate, path),
        rest=None if rest is None else to_metres(rest, path, data["scale"], up_axis),
        mass=mass,
    )


def _extras(path: Path) -> dict[str, np.ndarray]:
    names = ("rest_positions", "mass")
    if path.is_dir() or path.suffix.lower() not in ARRAYS:
        return {}
    if path.suffix.lower() == ".npz":
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name].astype(np.float64) for name in names if name in file}
    with h5py.File(path, "r") as file:
        return {name: file[name][()].astype(np.float64) for name in names if name in file}


def _finite(clip: MotionClip, path: Path) -> np.ndarray:
    bad = np.argwhere(~np.isfinite(clip.positions).all(axis=-1))
    if len(bad):
        raise DrapeError(
            f"{path}: frame {bad[0][0]}, vertex {bad[0][1]}: found {clip.positions[tuple(bad[0])]}; expected finite "
            "positions; record the sequence again, or leave it out"
        )
    return clip.positions


def _rate(clip: MotionClip, given: float | None, path: Path) -> float:
    for value, where in ((clip.fps, "fps"), (given, "data.fps")):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise DrapeError(f"{path}: {where}: found {value}; expected frames per second, more than 0")
    if clip.fps is None and given is None:
        raise DrapeError(f"{path}: found no rate; expected frames per second: set data.fps")
    if clip.fps is not None and given is not None and not np.isclose(clip.fps, given):
        raise DrapeError(
            f"{path}: found {clip.fps:g} frames per second in the file and data.fps={given:g}; leave one out"
        )
    return float(given if clip.fps is None else clip.fps)
