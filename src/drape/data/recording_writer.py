"""Write a data set of recordings in HDF5; the layout is that of recording_schema, the check that of reading."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from jaxtyping import Float

import drape
from drape.data import recording_schema as layout
from drape.data.piece import Piece
from drape.data.recording_hdf5 import RecordingFile
from drape.data.schema import SPLITS, Field
from drape.data.whole_file import flush, whole_file


@dataclass(frozen=True)
class RecordingHeader:
    """Everything in a file that is not a sequence."""

    fabrics: Sequence[str]
    """A sequence names one of them; the groups of their materials are in this order."""
    fps: float
    """[1/s]"""
    gravity: tuple[float, float, float]
    """[m/s²]"""
    config: str
    """The configuration as YAML."""


class RecordedSequence(NamedTuple):
    """One sequence as it goes into a file."""

    name: str
    positions: Float[np.ndarray, "frames vertices 3"]
    """[m], +z up."""
    piece: Piece
    fabric: str
    split: str


def write_recordings(
    path: Path,
    header: RecordingHeader,
    sequences: Iterable[RecordedSequence],
    attributes: Mapping[str, Mapping[str, float]],
) -> None:
    """Write the sequences one by one under a temporary name, check the result, and move it to ``path``.

    ``attributes``: what is known of each fabric, in Blender's numbers; what is not is 0. The mass of a vertex is the
    mean over its training sequences.

    Raises:
        DrapeError: anything that the schema does not allow; ``path`` is untouched.
        OSError: the disk is full or not writable; ``path`` is untouched.
    """
    with whole_file(path) as temporary:
        with h5py.File(temporary, "w") as file:
            file.attrs.update(
                format=layout.FORMAT,
                schema_version=layout.VERSION,
                drape_version=drape.__version__,
                fps=header.fps,
                dt=1.0 / header.fps,
                gravity=np.asarray(header.gravity, np.float64),
                up_axis="z",
                fabrics=list(header.fabrics),
                config=header.config,
            )
            masses = _write_sequences(file, header, sequences)
            for fabric, found in masses.items():
                known = dict.fromkeys(layout.MATERIAL_ATTRIBUTES, 0.0) | {"mass_per_vertex": float(np.mean(found))}
                file.create_group(f"materials/{fabric}").attrs.update(known | dict(attributes.get(fabric, {})))
        RecordingFile(temporary)
        flush(temporary)


def _write_sequences(
    file: h5py.File, header: RecordingHeader, sequences: Iterable[RecordedSequence]
) -> dict[str, list[float]]:
    """Returns the mean mass of a vertex of each sequence by fabric: of those for training, or of all without any."""
    numbers: dict[tuple[bytes, ...], int] = {}
    masses: dict[str, dict[str, list[float]]] = {fabric: {split: [] for split in SPLITS} for fabric in header.fabrics}
    for number, sequence in enumerate(sequences):
        piece = sequence.piece
        arrays = (piece.mesh.rest_positions, piece.mesh.faces, piece.pinned, piece.mass)
        key = tuple(np.ascontiguousarray(array).tobytes() for array in arrays)
        if key not in numbers:
            numbers[key] = len(numbers)
            for field, array in zip(layout.PIECE_FIELDS, arrays, strict=True):
                _write(file, f"{layout.piece_path(numbers[key])}/{field.name}", field, array)
        group = layout.sequence_path(number)
        _write(file, f"{group}/positions", layout.POSITIONS, sequence.positions)
        file[group].attrs.update(
            name=sequence.name,
            piece=numbers[key],
            fabric=list(header.fabrics).index(sequence.fabric),
            split=SPLITS.index(sequence.split),
        )
        masses[sequence.fabric][sequence.split].append(float(piece.mass.mean()))
    return {fabric: found["train"] or found["test"] for fabric, found in masses.items()}


def _write(file: h5py.File, name: str, field: Field, array: np.ndarray) -> None:
    dataset = file.create_dataset(name, data=np.asarray(array, field.dtype))
    dataset.attrs.update(units=field.unit, meaning=field.meaning)
