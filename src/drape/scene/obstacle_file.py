"""A body from files: one mesh, a folder of meshes, arrays, or an animation that Blender can open."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError
from drape.reading.files import read_file
from drape.reading.mesh_record import MeshFile, ReadMesh
from drape.reading.triangles import looking_outwards, made
from drape.scene.obstacle import Obstacle
from drape.stored import reading

FASTEST = 1e6
"""More frames per second than any camera takes [1/s]."""


def read_body(
    path: Path | str,
    dt: float | None,
    frames: int,
    fps: float | None = None,
    scale: float | None = None,
    up_axis: str | None = None,
    clip: str | None = None,
    weld: float | None = None,
    wanted: str | None = None,
) -> ReadMesh:
    """A body in all frames of its file, at the file's own rate or, where Blender opens it, every ``dt`` [s].

    * a mesh file: a body that stands still; glTF is opened by Blender, as it may be animated, and may stand still too;
    * a folder of mesh files in natural order (``body_2`` before ``body_10``), one a frame;
    * npz or HDF5 with ``faces``, ``positions`` and perhaps ``fps``;
    * glTF, Alembic, USD, FBX: through Blender; ``clip`` if there are several.

    All meshes of the file, or those of the object or the group ``wanted``.
    ``fps`` [1/s] is for those that do not say theirs: folders, USD. ``scale``, ``up_axis``, ``weld``: see
    :func:`drape.reading.triangles.made`.

    Raises:
        DrapeError: a path, a file or a topology that is no body, NaN, no known rate, no such clip or object.
    """
    with reading(path, "export it again"):
        source = read_file(path, animated=True, dt=dt, frames=frames, clip=clip, wanted=wanted)
        return made(replace(source, fps=_rate(source, fps)), scale, up_axis, weld)


def obstacle_of(body: ReadMesh, dt: float, frames: int) -> Obstacle:
    """The body at the ``frames + 1`` times ``k * dt`` of a scene, positions [m] interpolated linearly in time.

    Raises:
        DrapeError: too short a motion.
    """
    return Obstacle(body.faces, resample(body.positions, body.source.fps, dt, frames, str(body.source.path)))


def read_obstacle(
    path: Path | str,
    dt: float,
    frames: int,
    fps: float | None = None,
    scale: float | None = None,
    up_axis: str | None = None,
    garment: Float[np.ndarray, "cloth 3"] | None = None,
) -> Obstacle:
    """Both of the above, with faces that look outwards: see :func:`drape.reading.triangles.looking_outwards`."""
    return obstacle_of(looking_outwards(read_body(path, dt, frames, fps, scale, up_axis), garment), dt, frames)


def _rate(source: MeshFile, fps: float | None) -> float | None:
    """Frames per second of a body; None if it stands still."""
    for value, where in ((source.fps, "fps"), (fps, "scene.body_fps")):
        if value is not None and not 0 < value < FASTEST:
            raise DrapeError(f"{source.path}: {where}: found {value}; expected frames per second, more than 0")
    if len(source.positions) == 1:
        return None
    if source.fps is not None and fps is not None and not np.isclose(source.fps, fps):
        raise DrapeError(
            f"{source.path}: found {source.fps:g} frames per second in the file and scene.body_fps={fps:g}; leave "
            "body_fps out"
        )
    rate = source.fps if source.fps is not None else fps
    if rate is None:
        raise DrapeError(
            f"{source.path}: found {len(source.positions)} frames without a rate; expected frames per second: set "
            "scene.body_fps" + (" (or pip install usd-core, which tells)" if ".usd" in source.path.suffix else "")
        )
    return rate


ROUNDING = 1e-6
"""Share of a frame by which a time may lie past the last recorded frame."""


def resample(
    positions: Float[np.ndarray, "recorded vertices 3"], fps: float | None, dt: float, frames: int, where: str
) -> Float[np.ndarray, "frames vertices 3"]:
    """Positions at the times ``k * dt``, k = 0..``frames``, between recorded frames linearly; ``fps`` of the recording.

    A single recorded frame stands still and stays one, as do positions without a rate: those of a still body.

    Raises:
        DrapeError: the recording ends before time ``frames * dt``. ``where`` opens the sentence.
    """
    if fps is None or len(positions) == 1:
        return positions
    last = len(positions) - 1
    times = np.arange(frames + 1) * dt * fps  # in recorded frames
    if times[-1] > last + ROUNDING:
        enough = int((last + ROUNDING) / (dt * fps))
        raise DrapeError(
            f"{where}: found {len(positions)} frames at {fps:g} per second, {last / fps:.3g} s; expected "
            f"{frames * dt:.3g} s, for {frames} frames of the scene; set scene.frames to {enough} or fewer, or give a "
            "longer motion"
        )
    before = np.clip(np.floor(times + ROUNDING).astype(np.int64), 0, last - 1)
    share = np.clip(times - before, 0.0, 1.0)[:, None, None]
    return (1.0 - share) * positions[before] + share * positions[before + 1]
