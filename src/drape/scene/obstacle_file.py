"""A body from files: one mesh, a folder of meshes, HDF5, npz, or an animation that Blender can open."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np

from drape.errors import DrapeError
from drape.scene.animation_file import KINDS as ANIMATIONS
from drape.scene.animation_file import read_animation
from drape.scene.mesh_file import KINDS as MESHES
from drape.scene.mesh_file import read_triangles, to_metres
from drape.scene.motion_clip import MotionClip
from drape.scene.obstacle import Obstacle
from drape.scene.proportions import check_winding
from drape.scene.resample import resample

ARRAYS = (".npz", ".h5", ".hdf5")
"""``faces [faces, 3]``, ``positions [frames, vertices, 3]`` and, for a body that moves, ``fps``."""


def read_obstacle(
    path: Path | str, dt: float, frames: int, fps: float | None = None, scale: float = 1.0, up_axis: str = "z"
) -> Obstacle:
    """A body at the ``frames + 1`` times ``k * dt`` of a scene, positions [m] interpolated linearly in time.

    * a mesh file: a body that stands still; GLB is opened by Blender, as it may be animated, and may stand still too;
    * a folder of mesh files in natural order (``body_2`` before ``body_10``), one a frame;
    * npz or HDF5 with ``faces``, ``positions`` and perhaps ``fps``;
    * GLB, glTF, Alembic, USD: through Blender, all meshes of the file.

    ``fps`` [1/s] is for those that do not say theirs: folders, USD. ``scale``: metres per unit; ``up_axis``: as in
    ``read_cloth``.

    Raises:
        DrapeError: a path, a file or a topology that is no body, NaN, a body inside out, no known rate, too short a
            motion.
    """
    path = Path(path)
    clip = read_clip(path, dt, frames)
    if clip.faces.size == 0 or clip.positions.size == 0:
        raise DrapeError(f"{path}: found no triangle; expected the mesh of a body")
    bad = np.argwhere(~np.isfinite(clip.positions).all(axis=-1))
    if len(bad):
        raise DrapeError(
            f"{path}: frame {bad[0][0]}, vertex {bad[0][1]}: found {clip.positions[tuple(bad[0])]}; expected finite "
            "positions; export the body again"
        )
    if clip.faces.min() < 0 or clip.faces.max() >= clip.positions.shape[1]:
        raise DrapeError(
            f"{path}: faces index {clip.faces.min()}..{clip.faces.max()}; expected 0..{clip.positions.shape[1] - 1}, "
            "as positions has so many vertices"
        )
    positions = resample(clip.positions, _rate(clip, fps, path), dt, frames, str(path))
    turned = "z" if clip.z_is_up else up_axis
    metres = to_metres(positions, path, scale, turned)
    check_winding(clip.faces, metres[0], str(path))
    return Obstacle(clip.faces, metres)


def read_clip(path: Path, dt: float, frames: int) -> MotionClip:
    """A moving mesh from whatever kind of file; see :func:`read_obstacle`. Not checked but for one topology.

    Raises:
        DrapeError: no such path, another kind of file, nothing that can be read, a topology that changes.
    """
    kind = path.suffix.lower()
    if path.is_dir():
        return _read_folder(path)
    if not path.exists():
        raise DrapeError(f"{path}: no such file or folder; give the path of a body")
    if kind in ARRAYS:
        return _read_arrays(path)
    if kind in ANIMATIONS:
        return read_animation(path, dt, frames)
    if kind in MESHES:
        positions, faces = read_triangles(path)
        return MotionClip(faces, positions[None])
    known = ", ".join(dict.fromkeys((*MESHES, *ARRAYS, *ANIMATIONS)))
    raise DrapeError(f"{path}: found a file of kind {kind or 'nothing'!r}; expected a folder of meshes or {known}")


def natural_order(path: Path) -> list[tuple[int, int, str]]:
    """Sort key of file names: numbers by value, all else by letters."""
    parts = re.split(r"(\d+)", path.name)
    return [(1, int(part), part) if part.isdigit() else (0, 0, part) for part in parts if part]


def _read_folder(folder: Path) -> MotionClip:
    files = sorted((file for file in folder.iterdir() if file.suffix.lower() in MESHES), key=natural_order)
    if not files:
        raise DrapeError(f"{folder}: found no mesh in this folder; expected one file a frame ({', '.join(MESHES)})")
    first, faces = read_triangles(files[0])
    frames = [first]
    for file in files[1:]:
        positions, other = read_triangles(file)
        if positions.shape != first.shape or not np.array_equal(other, faces):
            raise DrapeError(
                f"{file}: found {len(positions)} vertices and {len(other)} faces that are not those of {files[0].name} "
                f"({len(first)} and {len(faces)}); expected the same topology in every frame; export the body without "
                "changing its mesh"
            )
        frames.append(positions)
    return MotionClip(faces, np.stack(frames), z_is_up=files[0].suffix.lower() == ".glb")


def _read_arrays(path: Path) -> MotionClip:
    try:
        if path.suffix.lower() == ".npz":
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in ("faces", "positions", "fps") if name in file}
        else:
            with h5py.File(path, "r") as file:
                arrays = {name: file[name][()] for name in ("faces", "positions", "fps") if name in file}
                if "fps" in file.attrs:
                    arrays["fps"] = file.attrs["fps"]
    except Exception as error:  # cut off, something else, an array of objects
        raise DrapeError(f"{path}: cannot be read ({type(error).__name__}: {error}); write the file again") from error
    for name, last in (("faces", 2), ("positions", 3)):
        found = np.asarray(arrays[name]) if name in arrays else None
        if found is None or found.ndim != last or found.shape[-1] != 3 or found.dtype.kind not in "iuf":
            what = "nothing" if found is None else f"{found.dtype} of shape {found.shape}"
            shape = "(faces, 3)" if name == "faces" else "(frames, vertices, 3)"
            raise DrapeError(f"{path}: {name}: found {what}; expected numbers of shape {shape}")
    if arrays["faces"].dtype.kind == "f":
        raise DrapeError(f"{path}: faces: found {arrays['faces'].dtype}; expected whole numbers (vertex indices)")
    fps = np.asarray(arrays.get("fps", np.nan), np.float64).reshape(-1)
    if len(fps) != 1:
        raise DrapeError(f"{path}: fps: found {len(fps)} numbers; expected one, frames per second")
    known = None if "fps" not in arrays else float(fps[0])
    return MotionClip(arrays["faces"].astype(np.int64), arrays["positions"].astype(np.float64), known)


def _rate(clip: MotionClip, fps: float | None, path: Path) -> float | None:
    """Frames per second of a clip; None if it stands still."""
    for value, where in ((clip.fps, "fps"), (fps, "scene.body_fps")):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise DrapeError(f"{path}: {where}: found {value}; expected frames per second, more than 0")
    if len(clip.positions) == 1:
        return None
    if clip.fps is not None and fps is not None and not np.isclose(clip.fps, fps):
        raise DrapeError(
            f"{path}: found {clip.fps:g} frames per second in the file and scene.body_fps={fps:g}; leave body_fps out"
        )
    rate = clip.fps if clip.fps is not None else fps
    if rate is None:
        raise DrapeError(
            f"{path}: found {len(clip.positions)} frames without a rate; expected frames per second: set scene.body_fps"
        )
    return rate
