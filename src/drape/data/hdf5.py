"""Write and read data sets of trajectories in HDF5; the layout and the check are those of schema."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from jaxtyping import Float, Int

import drape
from drape.data import schema
from drape.errors import DrapeError
from drape.scene.mesh import ClothMesh


@dataclass(frozen=True, eq=False)
class DatasetHeader:
    """Everything in a file that is not a sequence."""

    mesh: ClothMesh
    pinned: Int[np.ndarray, " pinned"]
    materials: Mapping[str, Mapping[str, float | bool | str]]
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
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        with h5py.File(temporary, "w") as file:
            _write_header(file, header)
            _write_sequences(file, sequences, count)
        TrajectoryFile(temporary).close()
        with open(temporary, "rb+") as handle:
            os.fsync(handle.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


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


class TrajectoryFile:
    """A data set opened for reading. Only what is asked for is read; positions are never kept.

    The file is checked in full (once, one sequence at a time) when the object is made. The object can be pickled and
    used after a fork: every process opens the file for itself.

    Raises:
        DrapeError: no such file, not HDF5 or cut off, or anything that the schema does not allow.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._handle: h5py.File | None = None
        self._process = -1
        schema.check_file(self._file(), self.path)

    def __getstate__(self) -> dict:
        return {**self.__dict__, "_handle": None, "_process": -1}

    def close(self) -> None:
        """Close the file; the next access opens it again."""
        if self._handle is not None and self._process == os.getpid():
            self._handle.close()
        self._handle = None

    def _file(self) -> h5py.File:
        if self._handle is None or self._process != os.getpid():
            self._handle, self._process = _open(self.path), os.getpid()
        return self._handle

    def attribute(self, name: str) -> object:
        """One of ``schema.ATTRIBUTES``."""
        return schema.plain(self._file().attrs[name])

    @cached_property
    def mesh(self) -> ClothMesh:
        group = self._file()["mesh"]
        return ClothMesh.from_faces(group["rest_positions"][:], group["faces"][:], name=f"{self.path}: mesh")

    @cached_property
    def pinned(self) -> Int[np.ndarray, " pinned"]:
        return self._file()["mesh/pinned"][:]

    @cached_property
    def dt(self) -> float:
        """Time step [s]."""
        return self.attribute("dt")

    @cached_property
    def gravity(self) -> Float[np.ndarray, " 3"]:
        """Acceleration really applied [m/s²]."""
        return np.asarray(self.attribute("gravity"), np.float64)

    @cached_property
    def fabrics(self) -> tuple[str, ...]:
        """Names of the fabrics; :attr:`fabric` counts in this order."""
        return tuple(self.attribute("fabrics"))

    @cached_property
    def materials(self) -> dict[str, dict[str, float | bool | str]]:
        """Blender's settings per fabric, and ``mass_per_vertex`` [kg]."""
        groups = self._file()["materials"]
        return {name: {key: schema.plain(value) for key, value in groups[name].attrs.items()} for name in self.fabrics}

    @cached_property
    def fabric(self) -> Int[np.ndarray, " sequences"]:
        """Index into :attr:`fabrics` per sequence."""
        return self._file()["fabric"][:]

    @cached_property
    def attempts(self) -> Int[np.ndarray, " sequences"]:
        """How many random starts a sequence took; 1 if the first was accepted."""
        return self._file()["attempts"][:]

    @property
    def num_sequences(self) -> int:
        return self._file()["positions"].shape[0]

    @property
    def num_frames(self) -> int:
        return self._file()["positions"].shape[1]

    def split(self, name: str) -> Int[np.ndarray, " selected"]:
        """The numbers of the sequences of split ``train`` or ``test``."""
        if name not in schema.SPLITS:
            raise DrapeError(f"{self.path}: split {name!r}; expected one of {', '.join(schema.SPLITS)}")
        return np.flatnonzero(self._file()["split"][:] == schema.SPLITS.index(name))

    def positions(
        self, sequence: int, start: int = 0, stop: int | None = None
    ) -> Float[np.ndarray, "frames vertices 3"]:
        """Positions [m] of frames ``start`` to ``stop`` (exclusive; default: to the end) of one sequence."""
        stop = self.num_frames if stop is None else stop
        if not (0 <= sequence < self.num_sequences and 0 <= start < stop <= self.num_frames):
            raise DrapeError(
                f"{self.path}: positions: asked for sequence {sequence}, frames {start} to {stop}; expected a sequence "
                f"in 0..{self.num_sequences - 1} and frames in 0..{self.num_frames}"
            )
        return self._file()["positions"][sequence, start:stop]


def _open(path: Path) -> h5py.File:
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; make it with: python src/generate.py data.path={path}")
    try:
        return h5py.File(path, "r")
    except OSError as error:
        raise DrapeError(
            f"{path}: found {path.stat().st_size} bytes that are no whole HDF5 file ({error}); it is cut off or "
            "something else: move it away and run python src/generate.py"
        ) from None
