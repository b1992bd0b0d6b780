"""Checks of attributes, datasets and materials of an HDF5 file against the tables of its schema."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from drape.data.schema import AGAIN, Field, plain
from drape.errors import DrapeError
from drape.stored import attribute, sound

PERHAPS_NONE = ("pinned",)
"""Dimensions of a dataset that may be empty."""
LARGE = 3
"""Dimensions of arrays with frames, which are checked frame by frame where they are read, as meshes are as meshes."""
KINDS = {
    "drape_version": "a text", "blender_version": "a text", "source": "a text", "up_axis": "'z'", "config": "a text",
    "fabric": "a text", "fabrics": "names", "fps": "a number above 0", "dt": "a number above 0",
    "gravity": "three numbers", "frames_wanted": "a whole number from 1 on", "seed": "a whole number from 0 on",
}  # fmt: skip
"""Of attributes, whichever file has them."""


def check_kinds(attributes: Mapping[str, object], path: Path) -> None:
    """Check the attributes of a file that :data:`KINDS` knows.

    Raises:
        DrapeError: path, name, what was found, what was expected.
    """
    for name, expected in KINDS.items():
        if name in attributes:
            attribute(path, name, plain(attributes[name]), expected)


def check_attributes(file: h5py.File, path: Path, expected: Mapping[str, str]) -> dict[str, Any]:
    """The attributes of a file as Python values; those that are ``expected``, with their meaning, are there and right.

    Raises:
        DrapeError: one that is missing or of another kind, or dt that is not 1 / fps.
    """
    for name, meaning in expected.items():
        if name not in file.attrs:
            raise DrapeError(f"{path}: attribute {name}: missing; expected {meaning}; {AGAIN}")
    check_kinds(file.attrs, path)
    gravity, dt, fps = (np.asarray(file.attrs[name]) for name in ("gravity", "dt", "fps"))
    if gravity.shape != (3,) or not np.isfinite(gravity).all():
        raise DrapeError(f"{path}: attribute gravity: found {plain(gravity)}; expected three numbers [m/s2]")
    if not (dt > 0 and fps > 0 and np.isclose(dt * fps, 1.0)):
        raise DrapeError(f"{path}: attributes dt and fps: found {dt} s and {fps} 1/s; expected dt = 1 / fps > 0")
    return {name: plain(value) for name, value in file.attrs.items()}


def check_dataset(dataset: object, path: Path, field: Field, lengths: dict[str, int]) -> None:
    """Check shape, kind of number and unit of what was found under the name of a field; None: nothing was.

    ``lengths`` gains the dimensions seen for the first time.

    Raises:
        DrapeError: path, name, what was found, what was expected.
    """
    dims = ", ".join(str(dim if isinstance(dim, int) else lengths.get(dim, dim)) for dim in field.dims)
    expected = f"expected {field.dtype} of shape ({dims})"
    if not isinstance(dataset, h5py.Dataset):
        raise DrapeError(f"{path}: {field.name}: missing; {expected}; {AGAIN}")
    shape = dataset.shape
    fits = len(shape) == len(field.dims) and all(
        length == (dim if isinstance(dim, int) else lengths.setdefault(dim, length))
        for dim, length in zip(field.dims, shape, strict=True)
    )
    if not fits or dataset.dtype != np.dtype(field.dtype) or (0 in shape and field.dims != PERHAPS_NONE):
        raise DrapeError(f"{path}: {field.name}: found {dataset.dtype} of shape {shape}; {expected}; {AGAIN}")
    checked_later = dataset.ndim >= LARGE or not field.meaning or field.name.endswith("rest_positions")
    if dataset.dtype.kind == "f" and not checked_later and not sound(dataset[()]).all():
        raise DrapeError(f"{path}: {field.name}: found a number that is not finite; expected {field.meaning}")
    unit = plain(dataset.attrs.get("units", "nothing"))
    if unit != field.unit:
        raise DrapeError(f"{path}: {field.name}: attribute units: found {unit!r}; expected {field.unit!r}")


def check_materials(file: h5py.File, path: Path, fabrics: Iterable[str], names: Iterable[str]) -> dict[str, dict]:
    """The settings of every fabric; those called ``names`` are there, and numbers or texts as they should be.

    Raises:
        DrapeError: path, fabric, what is missing, or setting, what was found, what was expected.
    """
    found, kinds = {}, {"preset": "a text", "mass_per_vertex": "a number above 0"}
    for fabric in fabrics:
        group = file.get(f"materials/{fabric}")
        missing = [name for name in names if group is None or name not in group.attrs]
        if missing:
            raise DrapeError(f"{path}: materials/{fabric}: missing {', '.join(missing)}; {AGAIN}")
        found[fabric] = {name: plain(value) for name, value in group.attrs.items()}
        for name in names:
            expected = kinds.get(name, "a number from 0 on")
            attribute(path, f"{name} of materials/{fabric}", found[fabric][name], expected)
    return found
