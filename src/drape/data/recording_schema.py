"""The HDF5 schema of a data set of recordings: cloth of anyone, of one mesh or several."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from drape.data.schema import SPLITS, Field, check_dataset, check_gravity_and_rate, check_materials, plain
from drape.errors import DrapeError
from drape.scene.material import ATTRIBUTES
from drape.stored import sound

FORMAT = "drape recordings"
VERSION = 1

PIECE_FIELDS = (
    Field("rest_positions", ("vertices", 3), "float32", "m", "rest shape"),
    Field("faces", ("faces", 3), "int64", "1", "vertex indices, one winding for all faces"),
    Field("pinned", ("pinned",), "int64", "1", "vertices that do not move, perhaps none"),
    Field("mass", ("vertices",), "float64", "kg", "mass of each vertex"),
)
"""Of each group ``pieces/<number>``: a mesh, how it is held, what it weighs; several sequences may be of one piece."""
POSITIONS = Field("positions", ("frames", "vertices", 3), "float32", "m", "frame k is at time k * dt, +z is up")
"""Of each group ``sequences/<number>``."""
SEQUENCE_ATTRIBUTES = {
    "name": "of the file or folder that was recorded",
    "piece": "number below pieces/",
    "fabric": "index into the attribute fabrics",
    "split": "0 train, 1 test",
}
ATTRIBUTES_OF_FILE = {
    "format": repr(FORMAT),
    "schema_version": str(VERSION),
    "drape_version": "version of this package",
    "fps": "frames per second [1/s]",
    "dt": "time step 1 / fps [s]",
    "gravity": "three numbers [m/s2]",
    "up_axis": "'z'",
    "fabrics": "names of the groups below materials/; the attribute fabric of a sequence counts in this order",
    "config": "the configuration that made the file, YAML",
}
MATERIAL_ATTRIBUTES = (*ATTRIBUTES, "air_damping")
"""Of each group ``materials/<fabric>``; ``mass_per_vertex`` [kg] is the mean, the others 0 where nothing is known."""


def piece_path(number: int) -> str:
    """The group of a piece."""
    return f"pieces/{number}"


def sequence_path(number: int) -> str:
    """The group of a sequence."""
    return f"sequences/{number:06d}"


def check_file(file: h5py.File, path: Path) -> None:
    """Check every attribute, dataset and value; positions are read one sequence at a time.

    Raises:
        DrapeError: path, name, what was found, what was expected.
    """
    _check_attributes(file, path)
    pieces = [_check_piece(file, path, number) for number in range(len(file.get("pieces", ())))]
    count = len(file.get("sequences", ()))
    if not pieces or not count:
        raise DrapeError(f"{path}: found {len(pieces)} pieces and {count} sequences; expected some; convert it again")
    for number in range(count):
        _check_sequence(file, path, number, pieces)


def _check_attributes(file: h5py.File, path: Path) -> None:
    for name, meaning in ATTRIBUTES_OF_FILE.items():
        if name not in file.attrs:
            raise DrapeError(f"{path}: attribute {name}: missing; expected {meaning}; convert the recordings again")
    found = plain(file.attrs["schema_version"])
    if found != VERSION:
        raise DrapeError(f"{path}: attribute schema_version: found {found}; expected {VERSION}; convert it again")
    check_gravity_and_rate(file, path)
    check_materials(file, path, MATERIAL_ATTRIBUTES, "convert the recordings again")


def _check_piece(file: h5py.File, path: Path, number: int) -> int:
    """Returns the number of vertices."""
    lengths: dict[str, int] = {}
    group = file[piece_path(number)]
    for field in PIECE_FIELDS:
        name = f"{piece_path(number)}/{field.name}"
        check_dataset(
            group.get(field.name), path, Field(name, field.dims, field.dtype, field.unit, field.meaning), lengths
        )
    for name in ("faces", "pinned"):
        values = group[name][:]
        if values.size and not (values.min() >= 0 and values.max() < lengths["vertices"]):
            raise DrapeError(
                f"{path}: {piece_path(number)}/{name}: found indices {values.min()}..{values.max()}; expected "
                f"0..{lengths['vertices'] - 1}"
            )
    mass = group["mass"][:]
    if not (np.isfinite(mass).all() and (mass > 0).all()):
        raise DrapeError(f"{path}: {piece_path(number)}/mass: found {mass.min()}; expected positive numbers [kg]")
    return lengths["vertices"]


def _check_sequence(file: h5py.File, path: Path, number: int, pieces: list[int]) -> None:
    where, group = f"{path}: {sequence_path(number)}", file[sequence_path(number)]
    limits = {"piece": len(pieces), "fabric": len(file.attrs["fabrics"]), "split": len(SPLITS)}
    for name, stop in limits.items():
        found = plain(group.attrs.get(name, -1))
        if not 0 <= found < stop:
            raise DrapeError(f"{where}: attribute {name}: found {found}; expected 0..{stop - 1}; convert it again")
    field = Field(f"{sequence_path(number)}/positions", POSITIONS.dims, POSITIONS.dtype, POSITIONS.unit, "")
    check_dataset(group.get("positions"), path, field, {"vertices": pieces[group.attrs["piece"]]})
    if group["positions"].id.get_offset() is None:
        raise DrapeError(f"{where}: positions: found chunks or compression; expected numbers that lie as they are")
    finite = sound(group["positions"][:]).all(axis=(1, 2))
    if not finite.all():
        raise DrapeError(f"{where}: positions: frame {int(np.argmin(finite))}: found a number that is not finite")
