"""Files of sheets: one mesh, and all sequences in one dataset, so that a thousand of them open and read at once.

As groups of their own a thousand sequences would take seconds to check whenever the file is opened. The index is the
same: :func:`index_of_sheets` calls the mesh the garment ``sheet``, and the sequences 000000, 000001, ...
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from drape.data.index import Index, Layout, layout_of
from drape.data.schema import MATERIAL_ATTRIBUTES, SHEET_ATTRIBUTES, SHEET_FIELDS, SPLITS, Field
from drape.data.schema_check import check_attributes, check_dataset, check_materials
from drape.data.stored_part import Header, Part, StoredGarment, StoredSequence
from drape.errors import DrapeError

SHEET = "sheet"
"""Name and kind of the one garment."""


def sheet_name(number: int) -> str:
    """Name of a sequence."""
    return f"{number:06d}"


def index_of_sheets(file: h5py.File, path: Path) -> Index:
    """Read and check all attributes and datasets; the values of positions are checked where they are read.

    Raises:
        DrapeError: path, name, what was found, what was expected, what to do.
    """
    attributes = check_attributes(file, path, SHEET_ATTRIBUTES)
    attributes["source"] = f"blender {attributes['blender_version']}"
    index = Index(attributes, check_materials(file, path, attributes["fabrics"], MATERIAL_ATTRIBUTES))
    lengths: dict[str, int] = {}
    for field in SHEET_FIELDS:
        check_dataset(file.get(field.name), path, field, lengths)
        group, _, name = field.name.rpartition("/")
        if group:
            index.layouts[f"garments/{SHEET}/{name}"] = layout_of(file[field.name], path, field, lengths)
        elif name == "positions":
            whole = layout_of(file[name], path, field, lengths)
    _check_indices(file, path, index.attributes["fabrics"], lengths["vertices"])
    index.groups["garments"][SHEET] = {"kind": SHEET, "body": "", "style": {}}
    _add_sequences(index, whole, *(file[name][:].tolist() for name in ("fabric", "split", "attempts")))
    return index


def _add_sequences(index: Index, whole: Layout, fabric: list[int], split: list[int], attempts: list[int]) -> None:
    shape, fabrics = whole.shape[1:], index.attributes["fabrics"]
    size = int(np.prod(shape)) * np.dtype(whole.dtype).itemsize
    for number, row in enumerate(zip(fabric, split, attempts, strict=True)):
        name, cloth = sheet_name(number), fabrics[row[0]]
        index.layouts[f"sequences/{name}/positions"] = Layout(whole.offset + number * size, shape, whole.dtype)
        index.groups["sequences"][name] = {
            "garment": SHEET,
            "body": "",
            "fabric": cloth,
            "motion": "",
            "split": SPLITS[row[1]],
            "attempts": row[2],
            "mass_per_vertex": float(index.materials[cloth]["mass_per_vertex"]),
            "friction": 0.0,
            "quality": {},
        }


def _check_indices(file: h5py.File, path: Path, fabrics: list[str], vertices: int) -> None:
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


class SheetWriter:
    """Adds ``count`` sequences of one mesh to a file, in the order of their names.

    Raises:
        DrapeError: a sequence on a body or of another mesh or length, another number of them.
    """

    def __init__(self, file: h5py.File, path: Path, header: Header, count: int) -> None:
        self._file, self._path, self._count, self._added = file, path, count, 0
        self._fabrics = list(header.materials)
        self._sheet: StoredGarment | None = None
        file.attrs.update({k: v for k, v in header.attributes.items() if k != "source"})
        file.attrs["blender_version"] = header.source.removeprefix("blender ")
        for fabric, settings in header.materials.items():
            file.create_group(f"materials/{fabric}").attrs.update(settings)

    def add(self, part: Part) -> None:
        """The next sequence."""
        where = f"{self._path}: sequence {self._added}"
        if part.body is not None or part.garment is None or part.garment.mass is not None:
            raise DrapeError(f"{where}: found a body, no cloth, or masses of vertices; expected a sheet alone")
        if self._sheet is None:
            self._sheet = part.garment
            for field in SHEET_FIELDS[:3]:
                self._create(field, np.asarray(getattr(part.garment, field.name.removeprefix("mesh/")), field.dtype))
        names = ("rest_positions", "faces", "pinned")
        if not all(np.array_equal(getattr(part.garment, name), getattr(self._sheet, name)) for name in names):
            raise DrapeError(f"{where}: found another mesh than before; expected one for all sheets")
        for field, value in zip(SHEET_FIELDS[3:], self._row(part.sequence).values(), strict=True):
            row = np.asarray(value, field.dtype)
            if field.name not in self._file:
                self._create(field, shape=(self._count, *row.shape), dtype=field.dtype)
            expected = self._file[field.name].shape[1:]
            if row.shape != expected:
                raise DrapeError(f"{where}: {field.name}: found shape {row.shape}; expected {expected}")
            if self._added < self._count:
                self._file[field.name][self._added] = row
        self._added += 1

    def _row(self, sequence: StoredSequence) -> dict[str, object]:
        found = {"fabric": (self._fabrics, sequence.fabric), "split": (SPLITS, sequence.split)}
        for name, (known, value) in found.items():
            if value not in known:
                raise DrapeError(
                    f"{self._path}: sequence {self._added}: {name}: found {value!r}; expected one of {', '.join(known)}"
                )
        indices = {name: list(known).index(value) for name, (known, value) in found.items()}
        return {"positions": sequence.positions, **indices, "attempts": sequence.attempts}

    def finish(self) -> None:
        """Check that all are there."""
        if self._added != self._count or self._count == 0:
            raise DrapeError(f"{self._path}: found {self._added} sequences; expected {max(self._count, 1)}")

    def _create(self, field: Field, data: np.ndarray | None = None, **shape: object) -> None:
        dataset = self._file.create_dataset(field.name, data=data, **shape)
        dataset.attrs.update(units=field.unit, meaning=field.meaning)
