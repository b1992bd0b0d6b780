"""Write an animated scene frame by frame, so that a frame that is done is never lost.

An HDF5 file that is open for writing when its process is killed may be unreadable afterwards. So every frame waits in a
file of its own below ``<path>.parts/``, put there by renaming, and HDF5 is written in one go and renamed to ``<path>``
when the writer is closed. A part that a power cut has torn fails its check sum and counts as not there.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import math
import os
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TextIO

import h5py
import numpy as np
import yaml

import drape
from drape.data.animation_hdf5 import FORMAT, VERSION, AnimationFile, AnimationHeader, describe
from drape.data.difference import refuse_difference
from drape.data.form_hdf5 import write_forms
from drape.data.whole_file import flush, reserve, whole_file
from drape.errors import DrapeError
from drape.scene.state import State

UNREADABLE = (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile)
"""Errors that reading a torn part may raise."""


class AnimationWriter:
    """Frames of one animation, to be appended in order::

        with AnimationWriter(path, header) as writer:
            for frame in range(writer.num_frames, header.frames):
                writer.append(State(...), {"residual": ...})

    ``num_frames`` are there already: 0 at first, more where an earlier writer was interrupted, all where the animation
    at ``path`` is complete. However the block ends, ``path`` then holds the frames that are done.

    Raises:
        DrapeError: at ``path`` is something else, or an animation of another configuration or other meshes; another
            process is writing it; a full disk.
    """

    def __init__(self, path: Path | str, header: AnimationHeader) -> None:
        self.path, self.header = Path(path), header
        self.parts = self.path.with_name(self.path.name + ".parts")
        self._lock: TextIO | None = None
        wanted = _identity(header)
        if self.path.exists():
            with AnimationFile(self.path) as file:
                self._refuse_other(_identity(file.header), wanted, self.path)
                self._complete = file.is_complete
        else:
            self._complete = False
        if self._complete:
            self.num_frames = header.frames
            shutil.rmtree(self.parts, ignore_errors=True)
            return
        try:
            self._claim(wanted)
        except OSError as error:
            raise self._stopped(error) from error
        self.num_frames = self._count()

    def _refuse_other(self, found: Mapping, wanted: Mapping, where: Path) -> None:
        remedy = f"delete {self.path.name} and {self.parts.name} there, or choose another folder for this one"
        refuse_difference(found, wanted, where, remedy)

    def _claim(self, wanted: dict) -> None:
        """Make the folder of parts, or see that the one found belongs to the same animation; keep others out."""
        self.parts.mkdir(parents=True, exist_ok=True)
        self._lock = lock = open(self.parts / "lock", "w")  # noqa: SIM115 (held until close)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            raise DrapeError(f"{self.parts}: another process is writing here; wait for it, or end it") from None
        manifest = self.parts / "manifest.json"
        if manifest.exists():
            try:
                self._refuse_other(json.loads(manifest.read_text(encoding="utf-8")), wanted, self.parts)
            except DrapeError:
                lock.close()
                raise
        else:
            with whole_file(manifest) as temporary:
                temporary.write_text(json.dumps(wanted, indent=1), encoding="utf-8")

    def _count(self) -> int:
        """Frames from 0 on whose parts are whole."""
        for frame in range(self.header.frames):
            try:
                self._part(frame)
            except UNREADABLE:
                return frame
        return self.header.frames

    def _part_path(self, frame: int) -> Path:
        return self.parts / f"{frame:06d}.npz"

    def _part(self, frame: int) -> dict[str, np.ndarray]:
        with np.load(self._part_path(frame), allow_pickle=False) as part:
            return {name: part[name] for name in ("x", "v", "numbers")}

    def state(self, frame: int) -> State:
        """A frame that is done."""
        if not 0 <= frame < self.num_frames:
            raise DrapeError(f"{self.path}: asked for frame {frame}; {self.num_frames} frames are there")
        if self._complete:
            with AnimationFile(self.path) as file:
                return file.state(frame)
        part = self._part(frame)
        return State(part["x"], part["v"])

    def append(self, state: State, numbers: Mapping[str, float] | None = None) -> None:
        """Store the next frame; ``numbers`` has a value for some or all of ``header.columns``, others are NaN.

        Raises:
            DrapeError: all frames are there, other vertices, a number that is no column, a full disk.
        """
        numbers = numbers or {}
        count = len(self.header.rest_positions)
        if self.num_frames >= self.header.frames:
            raise DrapeError(f"{self.path}: frame {self.num_frames}: all {self.header.frames} frames are there")
        if len(state.x) != count:
            raise DrapeError(
                f"{self.path}: frame {self.num_frames}: found {len(state.x)} vertices; expected {count}, as at rest"
            )
        unknown = sorted(set(numbers) - set(self.header.columns))
        if unknown:
            known = ", ".join(self.header.columns) or "none"
            raise DrapeError(f"{self.path}: frame {self.num_frames}: found numbers {unknown}; expected some of {known}")
        row = np.array([numbers.get(name, math.nan) for name in self.header.columns], np.float64)
        try:
            with whole_file(self._part_path(self.num_frames)) as temporary:
                np.savez(temporary, x=state.x, v=state.v, numbers=row)
        except OSError as error:
            raise self._stopped(error) from error
        self.num_frames += 1

    def _stopped(self, error: OSError) -> DrapeError:
        return DrapeError(
            f"{self.path}: {error}; the frames that are done are kept in {self.parts}: make room or set the "
            "permissions, then run the same command again"
        )

    def __enter__(self) -> AnimationWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Write the frames that are done to ``path``; let go of the parts when all are there, else keep them."""
        if self._lock is None or self._lock.closed:
            return
        try:
            if self.num_frames:
                self._pack()
            if self.num_frames == self.header.frames:
                self._complete = True
                shutil.rmtree(self.parts, ignore_errors=True)
        except OSError as error:
            raise self._stopped(error) from error
        finally:
            self._lock.close()

    def _pack(self) -> None:
        header, frames = self.header, self.num_frames
        size = frames * header.rest_positions.size * 2 * 8
        packed = self.parts / "packed.h5"  # here a kill leaves nothing behind that would not go with the parts
        with whole_file(packed) as temporary:
            reserve(temporary, size)
            with h5py.File(temporary, "w") as file:
                _write_header(file, header)
                rows = np.empty((frames, len(header.columns)))
                for name in ("x", "v"):
                    describe(file.create_dataset(name, (frames, *header.rest_positions.shape), "float64"))
                for frame in range(frames):
                    part = self._part(frame)
                    file["x"][frame], file["v"][frame], rows[frame] = part["x"], part["v"], part["numbers"]
                for column, (name, unit) in enumerate(header.columns.items()):
                    file[f"numbers/{name}"] = rows[:, column]
                    file[f"numbers/{name}"].attrs.update(units=unit)
            flush(temporary)
        os.replace(packed, self.path)


def _write_header(file: h5py.File, header: AnimationHeader) -> None:
    file.attrs.update(
        format=FORMAT,
        schema_version=VERSION,
        drape_version=drape.__version__,
        dt=header.dt,
        gravity=np.asarray(header.gravity, np.float64),
        fabric=header.fabric,
        frames_wanted=header.frames,
        config=header.config,
    )
    file.attrs.create("columns", list(header.columns), (len(header.columns),), h5py.string_dtype())
    for name, array in header.arrays().items():
        describe(file.create_dataset(name, data=array))
    write_forms(file, header.forms)


def _identity(header: AnimationHeader) -> dict:
    """Key that two animations must share for one to go on where the other stopped; arrays by their check sums."""
    arrays = {
        name.replace("/", "."): f"{array.shape} {hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()[:8]}"
        for name, array in header.arrays().items()
    }
    values = {
        "config": yaml.safe_load(header.config) or {},
        "dt": float(header.dt),
        "frames": header.frames,
        "gravity": np.asarray(header.gravity, np.float64).tolist(),
        "fabric": header.fabric,
        "columns": dict(header.columns),
        "arrays": arrays,
    }
    return json.loads(json.dumps(values, default=str))
