"""HDF5 files opened, and the index of a data set by the format and the version that it says it has."""

from __future__ import annotations

from pathlib import Path

import h5py

from drape.data import earlier_friction
from drape.data.earlier_recordings import index_of_recordings
from drape.data.index import Index
from drape.data.schema import GARMENTS, RECORDINGS, SHEETS, VERSIONS, plain
from drape.data.sheets import index_of_sheets
from drape.errors import DrapeError
from drape.stored import check_hdf5, reading


def open_hdf5(path: Path, command: str) -> h5py.File:
    """Open a file for reading; ``command`` is what makes such a file.

    Raises:
        DrapeError: no such file, not HDF5, or cut off.
    """
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; make it with: {command}")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise DrapeError(
            f"{path}: found {path.stat().st_size} bytes that are no whole HDF5 file ({error}); it is cut off or "
            f"something else: move it away and run {command}"
        ) from None
    try:
        with reading(path, f"make it again with: {command}"):
            check_hdf5(file, path)
    except DrapeError:
        file.close()
        raise
    return file


def index_of(file: h5py.File, path: Path, command: str) -> Index:
    """The index of a data set of any format and version; ``command`` is what makes one.

    Raises:
        DrapeError: another format or version, or anything that the schema does not allow.
    """
    kind, version = (plain(file.attrs.get(name, "nothing")) for name in ("format", "schema_version"))
    versions = range(1, VERSIONS.get(kind, 0) + 1) if isinstance(kind, str) else ()
    if version not in versions:
        name, found, known = ("schema_version", version, versions) if versions else ("format", kind, VERSIONS)
        raise DrapeError(
            f"{path}: attribute {name}: found {found!r}; expected {' or '.join(map(repr, known))}; this is no data set "
            f"of this version, make one with: {command}"
        )
    if kind == SHEETS:
        return index_of_sheets(file, path)
    if kind == RECORDINGS and version == 1:
        return index_of_recordings(file, path)
    index = Index.of_groups(file, path)
    if kind == GARMENTS and version == 1:
        earlier_friction.mend(index.attributes, index.groups["sequences"], path)
    return index
