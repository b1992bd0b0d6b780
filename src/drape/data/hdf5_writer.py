"""Write a data set of trajectories in HDF5; the layout is that of schema, the check that of reading."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from jaxtyping import Float, Int

import drape
from drape.data import schema
from drape.data.hdf5 import TrajectoryFile
from drape.data.whole_file import flush, reserve, whole_file
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh


@dataclass(frozen=True, eq=False)
class DatasetHeader:
    """Everything in a file that is not a sequence."""

    mesh: ClothMesh
    pinned: Int[np.ndarray, " pinned"]
    materials: Mapping[str, Mapping[str, float | int | str]]
    """Fabric name to Blender settings and ``mass_per_vertex`` [kg]; the dataset ``fabric`` counts in this order."""
    fps: float
    """Frames per second [1/s]."""
    gravity: tuple[float, float, float]
    """Acceleration really applied [m/s²]."""
    seed: int
    blender_version: str
    config: str
    """The configuration as YAML."""


class StoredSequence(NamedTuple):
    """One sequence as it goes into a file."""

    positions: Float[np.ndarray, "frames vertices 3"]
    """Positions [m], one frame every 1 / fps seconds."""
    fabric: int
    split: int
    attempts: int


def write_trajectories(path: Path, header: DatasetHeader, sequences: Iterable[StoredSequence], count: int) -> None:
    """Write ``count`` sequences under a temporary name, check the result, and move it to ``path``.

    Raises:
        DrapeError: the sequences do not fit the schema; ``path`` is untouched.
        OSError: the disk is full or not writable; ``path`` is untouched.
    """
    path = Path(path)
    sequences = iter(sequences)
    first = list(itertools.islice(sequences, 1))
    with whole_file(path) as temporary:
        reserve(temporary, count * sum(sequence.positions.nbytes for sequence in first))
        with h5py.File(temporary, "w") as file:
            _write_header(file, header)
            _write_sequences(file, itertools.chain(first, sequences), count)
        TrajectoryFile(temporary).close()
        flush(temporary)


def _write_header(file: h5py.File, header: DatasetHeader) -> None:
    file.attrs.update(
        format=schema.FORMAT,
        schema_version=schema.VERSION,
        drape_version=drape.__version__,
        blender_version=header.blender_version,
        seed=header.seed,
        fps=header.fps,
        dt=1.0 / header.fps,
        gravity=np.asarray(header.gravity, np.float64),
        up_axis="z",
        fabrics=list(header.materials),
        config=header.config,
    )
    arrays = {"rest_positions": header.mesh.rest_positions, "faces": header.mesh.faces, "pinned": header.pinned}
    for field in schema.FIELDS:
        if field.name.startswith("mesh/"):
            data = np.asarray(arrays[field.name.removeprefix("mesh/")], field.dtype)
            _describe(file.create_dataset(field.name, data=data), field)
    for fabric, settings in header.materials.items():
        file.create_group(f"materials/{fabric}").attrs.update(settings)


def _write_sequences(file: h5py.File, sequences: Iterable[StoredSequence], count: int) -> None:
    fields = [field for field in schema.FIELDS if field.dims[0] == "sequences"]
    written = 0
    for index, sequence in enumerate(sequences):
        for field in fields:
            value = np.asarray(getattr(sequence, field.name), field.dtype)
            if index == 0:
                _describe(file.create_dataset(field.name, (count, *value.shape), field.dtype), field)
            expected = file[field.name].shape[1:]
            if value.shape != expected:
                raise DrapeError(f"sequence {index}: {field.name}: found shape {value.shape}; expected {expected}")
            file[field.name][index] = value
        written += 1
    if written != count or count == 0:
        raise DrapeError(f"{file.filename}: found {written} sequences; expected {max(count, 1)}")


def _describe(dataset: h5py.Dataset, field: schema.Field) -> None:
    dataset.attrs.update(units=field.unit, meaning=field.meaning)
