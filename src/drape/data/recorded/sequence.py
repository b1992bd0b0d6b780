"""One recorded sequence from a file or a folder: positions in metres with +z up, and what else the file says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.reading.files import ARRAYS, BLENDER, GLTF, MESHES, natural_order, read_file
from drape.reading.mesh_record import MeshFile
from drape.reading.triangles import made, to_metres

MOVING = (*ARRAYS, *BLENDER, *GLTF)
"""Files that can hold a motion."""


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
    found = [entry for entry in entries if entry.suffix.lower() in MOVING or _has_meshes(entry)]
    if not found and _has_meshes(root):
        raise DrapeError(
            f"data.root: {root}: found the frames of one sequence; expected a folder with a file or a folder for each "
            "sequence, at least two: give the folder above, with another sequence beside this one"
        )
    if not found:
        kinds = ", ".join(MOVING)
        raise DrapeError(
            f"data.root: {root}: found no sequence; expected files ({kinds}) or folders of meshes ({', '.join(MESHES)})"
        )
    return found


def _has_meshes(folder: Path) -> bool:
    return folder.is_dir() and any(file.suffix.lower() in MESHES for file in folder.iterdir())


def read_recording(path: Path, data: Mapping) -> Recording:
    """Read one sequence; ``data`` has ``fps`` (null where files say theirs), ``scale``, ``up_axis`` and ``object``.

    Arrays in npz and HDF5 may be accompanied by ``rest_positions [vertices, 3]`` and ``mass [vertices]``, kg.

    Raises:
        DrapeError: no rate or two, no such object, a topology that changes, NaN, or whatever its reader refuses.
    """
    rate = data["fps"]
    if rate is not None and not isinstance(rate, int | float):
        raise DrapeError(f"data.fps: found {rate!r}; expected frames per second")
    source = read_file(path, animated=True, wanted=data["object"])
    read = made(source, data["scale"], data["up_axis"])
    extras, count = _extras(path), source.positions.shape[1]
    for name, array in extras.items():
        expected = (count, 3) if name == "rest_positions" else (count,)
        if array.shape != expected or not np.isfinite(array).all():
            raise DrapeError(
                f"{path}: {name}: found numbers of shape {array.shape}; expected finite ones of {expected}"
            )
    rest, mass = extras.get("rest_positions"), extras.get("mass")
    form, used = read.form, read.form.vertex >= 0
    return Recording(
        path=path,
        faces=read.faces,
        positions=read.positions,
        fps=_rate(source, None if rate is None else float(rate), path),
        rest=None if rest is None else to_metres(rest, form.scale, form.up)[read.in_order],
        mass=None if mass is None else np.bincount(form.vertex[used], mass[used]),
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


def _rate(source: MeshFile, given: float | None, path: Path) -> float:
    for value, where in ((source.fps, "fps"), (given, "data.fps")):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise DrapeError(f"{path}: {where}: found {value}; expected frames per second, more than 0")
    rate = given if source.fps is None else source.fps
    if rate is None:
        raise DrapeError(f"{path}: found no rate; expected frames per second: set data.fps")
    if source.fps is not None and given is not None and not np.isclose(source.fps, given):
        raise DrapeError(
            f"{path}: found {source.fps:g} frames per second in the file and data.fps={given:g}; leave one out"
        )
    return float(rate)
