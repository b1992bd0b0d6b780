"""Write data sets of cloth in HDF5, one sequence at a time; schema has the layout, the check is that of reading."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from drape.data.hdf5 import GarmentFile
from drape.data.index import Index
from drape.data.schema import FIELDS, GROUP_ATTRIBUTES, JSON_ATTRIBUTES
from drape.data.sheets import SheetWriter
from drape.data.stored_part import Header, Part
from drape.data.whole_file import flush, reserve, whole_file
from drape.errors import DrapeError


class GroupWriter:
    """Adds bodies, garments and sequences to a file as groups; every one is checked when it is added.

    Raises:
        DrapeError: a part does not fit the schema, or what was added before.
    """

    def __init__(self, file: h5py.File, path: Path, header: Header) -> None:
        self._file, self._path, self._index = file, path, Index()
        fabrics = np.array(list(header.materials), h5py.string_dtype())
        file.attrs.update(header.attributes | {"fabrics": fabrics})
        for fabric, settings in header.materials.items():
            file.create_group(f"materials/{fabric}").attrs.update(settings)
        self._index.materials.update({fabric: dict(settings) for fabric, settings in header.materials.items()})

    def add(self, part: Part) -> None:
        """Add the sequence, and its body and garment if they are not there yet."""
        sequence = part.sequence
        for kind, name, stored in (("bodies", sequence.body, part.body), ("garments", sequence.garment, part.garment)):
            if stored is not None and name not in self._index.groups[kind]:
                self._add(kind, name, stored)
        self._add("sequences", sequence.name, sequence)

    def set_mass(self, fabric: str, mass_per_vertex: float) -> None:
        """The mean mass of a vertex of a fabric [kg], where it is known only when all sequences are there."""
        self._file[f"materials/{fabric}"].attrs["mass_per_vertex"] = mass_per_vertex

    def _add(self, kind: str, name: str, part: object) -> None:
        if not name or "/" in name or name in self._index.groups[kind]:
            raise DrapeError(f"{self._path}: {kind}: found the name {name!r}; expected a new one, without '/'")
        group = self._file.create_group(f"{kind}/{name}")
        for key in GROUP_ATTRIBUTES[kind]:
            value = getattr(part, key)
            group.attrs[key] = json.dumps(value, sort_keys=True) if key in JSON_ATTRIBUTES else value
        for entry in FIELDS[kind]:
            array = getattr(part, entry.name)
            if array is None:
                continue
            data = np.ascontiguousarray(array, entry.dtype)
            if not np.isfinite(data).all():
                raise DrapeError(f"{self._path}: {kind}/{name}/{entry.name}: found a number that is not finite")
            group.create_dataset(entry.name, data=data).attrs.update(units=entry.unit, meaning=entry.meaning)
        self._index.add(self._file, self._path, kind, name)


@contextlib.contextmanager
def data_writer(path: Path | str, header: Header, size: int = 0) -> Iterator[GroupWriter]:
    """A writer to a temporary name; when the block ends well the whole file is checked and becomes ``path``.

    ``size``: about how many bytes there will be, so that a full disk is found before the work.

    Raises:
        DrapeError: what was added does not fit the schema; ``path`` is untouched.
        OSError: the disk is full or not writable; ``path`` is untouched.
    """
    with _checked(Path(path), size) as file:
        yield GroupWriter(file, Path(path), header)


@contextlib.contextmanager
def sheet_writer(path: Path | str, header: Header, count: int, size: int = 0) -> Iterator[SheetWriter]:
    """As :func:`data_writer`, of ``count`` sheets of one mesh, in the format that has them in one dataset.

    Raises:
        DrapeError, OSError: as :func:`data_writer`.
    """
    with _checked(Path(path), size) as file:
        writer = SheetWriter(file, Path(path), header, count)
        yield writer
        writer.finish()


@contextlib.contextmanager
def _checked(path: Path, size: int) -> Iterator[h5py.File]:
    with whole_file(path) as temporary:
        reserve(temporary, size)
        with h5py.File(temporary, "w", libver="v110") as file:  # opens much faster than HDF5's oldest format
            yield file
        with GarmentFile(temporary) as written:
            written.check_frames()
        flush(temporary)
