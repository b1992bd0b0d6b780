"""Small data sets of sheets, of random numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from drape.data import schema
from drape.data.hdf5_writer import sheet_writer
from drape.data.sheets import SHEET, sheet_name
from drape.data.stored_part import Header, Part, StoredGarment, StoredSequence
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh

SETTINGS = dict.fromkeys(schema.MATERIAL_ATTRIBUTES, 1.0) | {"preset": "Silk", "mass_per_vertex": 0.15}
MESH = square_grid(1.0, 4)


def header(**changes: object) -> Header:
    values = {
        "source": "blender 5.0.1",
        "materials": {"silk": SETTINGS, "denim": SETTINGS | {"preset": "Denim", "mass_per_vertex": 1.0}},
        "fps": 30.0,
        "gravity": (0.0, 0.0, -9.81),
        "seed": 3,
        "config": "data: {}",
        "format": schema.SHEETS,
    }
    return Header(**(values | changes))


def sequences_of(
    rows: Iterable[np.ndarray], fabrics: Sequence[str] = ("silk", "denim"), training: int = 3
) -> list[StoredSequence]:
    """Of positions: fabrics in turn, the first ``training`` to train on; sequence i took i + 1 attempts."""
    return [
        StoredSequence(
            sheet_name(i), "", "", schema.SPLITS[i >= training], SHEET, fabrics[i % len(fabrics)], attempts=i + 1,
            positions=x,
        )
        for i, x in enumerate(rows)
    ]  # fmt: skip


def sequences(count: int = 4, frames: int = 5) -> list[StoredSequence]:
    rng = np.random.default_rng(0)
    return sequences_of(rng.normal(size=(frames, 16, 3)).astype(np.float32) for _ in range(count))


def write(
    path: Path, header: Header, sequences: list[StoredSequence], mesh: ClothMesh = MESH, pinned: Sequence[int] = (0, 3),
    count: int | None = None,
) -> Path:  # fmt: skip
    """A file of sheets; it is told to expect ``count`` of them."""
    garment = StoredGarment(SHEET, "", mesh.rest_positions, mesh.faces, np.array(pinned, np.int64))
    with sheet_writer(path, header, len(sequences) if count is None else count) as writer:
        for sequence in sequences:
            writer.add(Part(None, garment, sequence))
    return path
