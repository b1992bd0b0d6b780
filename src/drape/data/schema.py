"""The HDF5 schema of a data set of trajectories in one table, and the check that writing and reading share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from drape.errors import DrapeError
from drape.stored import attribute, sound

FORMAT = "drape trajectories"
VERSION = 1
PERHAPS_NONE = ("pinned",)
"""Dimensions of a dataset that may be empty."""
LARGE = 3
"""Dimensions of arrays with frames, which are checked frame by frame where they are read, as meshes are as meshes."""
SPLITS = ("train", "test")
"""``split[i]`` is an index into this tuple."""


@dataclass(frozen=True)
class Field:
    """One dataset. A dimension is a name (the same name has the same length everywhere) or a number."""

    name: str
    dims: tuple[str | int, ...]
    dtype: str
    unit: str
    meaning: str


FIELDS = (
    Field("mesh/rest_positions", ("vertices", 3), "float32", "m", "flat rest shape"),
    Field("mesh/faces", ("faces", 3), "int64", "1", "vertex indices, one winding for all faces"),
    Field("mesh/pinned", ("pinned",), "int64", "1", "vertices that do not move"),
    Field("positions", ("sequences", "frames", "vertices", 3), "float32", "m", "frame k is at time k * dt"),
    Field("fabric", ("sequences",), "int64", "1", "index into the attribute fabrics"),
    Field("split", ("sequences",), "int8", "1", "0 train, 1 test"),
    Field("attempts", ("sequences",), "int64", "1", "1: the first random start was accepted"),
)

ATTRIBUTES = {
    "format": repr(FORMAT),
    "schema_version": str(VERSION),
    "drape_version": "version of this package",
    "blender_version": "version of bpy",
    "seed": "sequence i, attempt k depends on (seed, i, k) only",
    "fps": "frames per second [1/s]",
    "dt": "time step 1 / fps [s]",
    "gravity": "acceleration really applied, three numbers [m/s2]",
    "up_axis": "'z'",
    "fabrics": "names of the groups below materials/; the dataset fabric counts in this order",
    "config": "the configuration that made the file, YAML",
}

MATERIAL_ATTRIBUTES = {
    "preset": "name of Blender's preset file",
    "mass_per_vertex": "[kg]",
    "tension_stiffness": "Blender's number; in SI tension * fps² / mean edge length [N/m]",
    "bending_stiffness": "Blender's number",
    "tension_damping": "Blender's number",
    "bending_damping": "Blender's number",
    "air_damping": "Blender's number",
    "quality": "solver steps per frame",
}
"""Attributes that every group materials/<fabric> has; it holds all other settings of the preset as well."""


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


def plain(value: object) -> object:
    """An HDF5 attribute as Python values."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def check_file(file: h5py.File, path: Path) -> None:
    """Check every attribute, dataset and value; positions are read one sequence at a time.

    Raises:
        DrapeError: path, name, what was found, what was expected.
    """
    _check_attributes(file, path)
    lengths: dict[str, int] = {}
    for field in FIELDS:
        check_field(file, path, field, lengths)
    check_materials(file, path, MATERIAL_ATTRIBUTES, "generate the file again")
    _check_indices(file, path, lengths["vertices"])
    _check_positions(file["positions"], path)


def _check_attributes(file: h5py.File, path: Path) -> None:
    for name, expected in (("format", FORMAT), ("schema_version", VERSION)):
        found = plain(file.attrs.get(name, "nothing"))
        if found != expected:
            raise DrapeError(
                f"{path}: attribute {name}: found {found!r}; expected {expected!r}; this is no data set of this "
                "version, make one with: python src/generate.py"
            )
    for name, meaning in ATTRIBUTES.items():
        if name not in file.attrs:
            raise DrapeError(f"{path}: attribute {name}: missing; expected {meaning}; generate the file again")
    check_gravity_and_rate(file, path)


def check_gravity_and_rate(file: h5py.File, path: Path) -> None:
    """Check the attributes gravity, dt and fps.

    Raises:
        DrapeError: gravity that is not three numbers, or dt that is not 1 / fps.
    """
    check_kinds(file.attrs, path)
    gravity, dt, fps = (np.asarray(file.attrs[name]) for name in ("gravity", "dt", "fps"))
    if gravity.shape != (3,) or not np.isfinite(gravity).all():
        raise DrapeError(f"{path}: attribute gravity: found {plain(gravity)}; expected three numbers [m/s2]")
    if not (dt > 0 and fps > 0 and np.isclose(dt * fps, 1.0)):
        raise DrapeError(f"{path}: attributes dt and fps: found {dt} s and {fps} 1/s; expected dt = 1 / fps > 0")


def check_field(file: h5py.File, path: Path, field: Field, lengths: dict[str, int]) -> None:
    """Check shape, kind of number and unit of one dataset; ``lengths`` gains the dimensions seen for the first time.

    Raises:
        DrapeError: path, name, what was found, what was expected.
    """
    check_dataset(file.get(field.name), path, field, lengths)


def check_dataset(dataset: object, path: Path, field: Field, lengths: dict[str, int]) -> None:
    """As :func:`check_field`, of what was found under the name of the field.

    Raises:
        DrapeError: as :func:`check_field`.
    """
    dims = ", ".join(str(lengths.get(dim, dim)) for dim in field.dims)
    expected = f"expected {field.dtype} of shape ({dims})"
    if not isinstance(dataset, h5py.Dataset):
        raise DrapeError(f"{path}: {field.name}: missing; {expected}; generate the file again")
    shape = dataset.shape
    fits = len(shape) == len(field.dims) and all(
        length == (dim if isinstance(dim, int) else lengths.setdefault(dim, length))
        for dim, length in zip(field.dims, shape, strict=True)
    )
    if not fits or dataset.dtype != np.dtype(field.dtype) or (0 in shape and field.dims != PERHAPS_NONE):
        raise DrapeError(
            f"{path}: {field.name}: found {dataset.dtype} of shape {shape}; {expected}; generate the file again"
        )
    checked_later = dataset.ndim >= LARGE or not field.meaning or field.name.endswith("rest_positions")
    if dataset.dtype.kind == "f" and not checked_later and not sound(dataset[()]).all():
        raise DrapeError(f"{path}: {field.name}: found a number that is not finite; expected {field.meaning}")
    unit = plain(dataset.attrs.get("units", "nothing"))
    if unit != field.unit:
        raise DrapeError(f"{path}: {field.name}: attribute units: found {unit!r}; expected {field.unit!r}")


def check_materials(file: h5py.File, path: Path, names: Iterable[str], cure: str) -> None:
    """Check that the group of every fabric has the attributes ``names``.

    Raises:
        DrapeError: path, fabric, what is missing, and the ``cure``.
    """
    for fabric in plain(file.attrs["fabrics"]):
        group = file.get(f"materials/{fabric}")
        missing = [name for name in names if group is None or name not in group.attrs]
        if missing:
            raise DrapeError(f"{path}: materials/{fabric}: missing {', '.join(missing)}; {cure}")
        check_material(group.attrs, path, fabric, names)


def check_material(values: Mapping[str, object], path: Path, fabric: str, names: Iterable[str]) -> None:
    """Check the kinds of the settings ``names`` of a fabric.

    Raises:
        DrapeError: path, fabric, setting, what was found, what was expected.
    """
    kinds = {"preset": "a text", "mass_per_vertex": "a number above 0"}
    for name in names:
        attribute(path, f"{name} of materials/{fabric}", plain(values[name]), kinds.get(name, "a number from 0 on"))


def _check_indices(file: h5py.File, path: Path, vertices: int) -> None:
    fabrics = plain(file.attrs["fabrics"])
    allowed = {
        "fabric": (len(fabrics), f" ({', '.join(fabrics)})"),
        "split": (len(SPLITS), f" ({', '.join(SPLITS)})"),
        "mesh/pinned": (vertices, ""),
        "mesh/faces": (vertices, ""),
    }
    for name, (stop, names) in allowed.items():
        values = file[name][:]
        bad = values[(values < 0) | (values >= stop)]
        if len(bad):
            where = int(np.argwhere(values == bad[0])[0][0])
            raise DrapeError(f"{path}: {name}: entry {where}: found {bad[0]}; expected 0..{stop - 1}{names}")


def _check_positions(positions: h5py.Dataset, path: Path) -> None:
    if positions.id.get_offset() is None:
        raise DrapeError(
            f"{path}: positions: found chunks or compression; expected numbers that lie in the file as they are, since "
            f"training maps them; repack them: h5repack -f positions:NONE -l positions:CONTI {path} repacked.h5"
        )
    for sequence in range(positions.shape[0]):
        finite = sound(positions[sequence]).all(axis=(1, 2))
        if not finite.all():
            raise DrapeError(
                f"{path}: positions: sequence {sequence}, frame {int(np.argmin(finite))}: found a number that is not "
                "finite; expected positions in metres; generate the file again"
            )
