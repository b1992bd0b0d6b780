"""One motion of VTO or HOOD, made plain by ``drape.data.smpl.convert_pickle``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError

WIDTHS = {"poses": 72, "translation": 3, "shape": 10}
COMMAND = "python -m drape.data.smpl.convert_pickle"


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """An SMPL body in motion; y is up."""

    poses: Float[np.ndarray, "frames 72"]
    """Axis-angle of every joint relative to its parent [rad]."""
    translation: Float[np.ndarray, "frames 3"]
    """[m]"""
    shape: Float[np.ndarray, "frames 10"]

    @property
    def num_frames(self) -> int:
        return len(self.poses)


def read_motion(path: Path) -> BodyMotion:
    """Read a converted motion; a single frame may have lost its dimension, a constant shape be given once.

    Raises:
        DrapeError: no such file, not an npz of a motion, arrays of other shapes or lengths, NaN.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            found = {name: np.asarray(file[name]) for name in file.files}
    except Exception as error:  # cut off, something else, an array of objects
        raise DrapeError(
            f"{path}: cannot be read ({type(error).__name__}: {error}); make it with: {COMMAND}"
        ) from error
    arrays = {name: _rows(path, name, found.get(name), width) for name, width in WIDTHS.items()}
    frames = len(arrays["poses"])
    if len(arrays["shape"]) == 1:
        arrays["shape"] = np.repeat(arrays["shape"], frames, axis=0)
    lengths = {name: len(array) for name, array in arrays.items()}
    if set(lengths.values()) != {frames}:
        shown = ", ".join(f"{count} of {name}" for name, count in lengths.items())
        raise DrapeError(f"{path}: found {shown}; expected as many frames of each; convert it again: {COMMAND}")
    return BodyMotion(**arrays)


def _rows(path: Path, name: str, found: np.ndarray | None, width: int) -> np.ndarray:
    fits = found is not None and found.dtype.kind in "iuf" and found.size > 0 and found.shape[-1:] == (width,)
    if found is None or not fits or found.ndim > 2:
        what = "nothing" if found is None else f"{found.dtype} of shape {found.shape}"
        raise DrapeError(f"{path}: {name}: found {what}; expected numbers of shape (frames, {width}); see {COMMAND}")
    rows = np.atleast_2d(found).astype(np.float64)
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        raise DrapeError(f"{path}: {name}: frame {int(np.argmin(finite))}: found a number that is not finite")
    return rows
