"""Write a data set of garments on moving bodies, one sequence at a time; the check is that of reading."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float, Int

import drape
from drape.data import garment_schema as schema
from drape.data.garment_hdf5 import GarmentFile
from drape.data.garment_index import GarmentIndex
from drape.data.whole_file import flush, reserve, whole_file
from drape.errors import DrapeError


@dataclass(frozen=True, eq=False)
class GarmentHeader:
    """Everything in a file that is not a body, a garment or a sequence."""

    source: str
    """Program that made the frames: ``blender 5.0.1``, ``cloth3d``, ``vto``."""
    fps: float
    """Frames per second [1/s]."""
    gravity: tuple[float, float, float]
    """Acceleration really applied [m/s²]."""
    materials: Mapping[str, Mapping[str, float | int | str]]
    """Fabric name to Blender settings and ``mass_per_vertex`` [kg]."""
    config: str
    """The configuration as YAML."""
    seed: int = 0


@dataclass(frozen=True, eq=False)
class StoredBody:
    """A body as it goes into a file."""

    rest_positions: Float[np.ndarray, "vertices 3"]
    """[m], z up"""
    faces: Int[np.ndarray, "faces 3"]
    bones: Int[np.ndarray, "vertices 4"] | None = None
    """With ``weights``: where sequences store transforms."""
    weights: Float[np.ndarray, "vertices 4"] | None = None
    shape: Mapping[str, object] = field(default_factory=dict)
    """Settings that it was made from; plain values."""


@dataclass(frozen=True, eq=False)
class StoredGarment:
    """A garment as it goes into a file."""

    kind: str
    body: str
    """In whose rest pose it was made."""
    rest_positions: Float[np.ndarray, "vertices 3"]
    """[m]"""
    faces: Int[np.ndarray, "faces 3"]
    pinned: Int[np.ndarray, " pinned"] = field(default_factory=lambda: np.zeros(0, np.int64))
    bones: Int[np.ndarray, "vertices 4"] | None = None
    weights: Float[np.ndarray, "vertices 4"] | None = None
    style: Mapping[str, object] = field(default_factory=dict)
    """Settings that it was made from; plain values."""


@dataclass(frozen=True, eq=False)
class StoredGarmentSequence:
    """A sequence as it goes into a file: exactly one of ``transforms`` and ``body_positions``.

    Without ``positions`` it is a motion, to be animated; then ``garment`` and ``fabric`` may be empty.
    """

    name: str
    """``00000``, ...; sequences are read in the order of their names."""
    body: str
    motion: str
    split: str
    garment: str = ""
    fabric: str = ""
    mass_per_vertex: float = 0.0
    """[kg]"""
    friction: float = 0.0
    attempts: int = 1
    quality: Mapping[str, object] = field(default_factory=dict)
    """Numbers of the quality control; plain values."""
    positions: Float[np.ndarray, "frames vertices 3"] | None = None
    """Garment [m], one frame every 1 / fps seconds."""
    transforms: Float[np.ndarray, "frames joints 4 4"] | None = None
    body_positions: Float[np.ndarray, "frames body_vertices 3"] | None = None
    """[m]"""
    twin: Float[np.ndarray, "frames vertices 3"] | None = None
    """The same simulation, started 1e-6 m to the side [m]."""


class GarmentWriter:
    """Adds bodies, then their garments, then sequences to a file; every part is checked when it is added.

    Raises:
        DrapeError: the part does not fit the schema, or what was added before.
    """

    def __init__(self, file: h5py.File, path: Path, header: GarmentHeader) -> None:
        self._file = file
        self._path = path
        self._index = GarmentIndex()
        file.attrs.update(
            format=schema.FORMAT,
            schema_version=schema.VERSION,
            drape_version=drape.__version__,
            source=header.source,
            seed=header.seed,
            fps=float(header.fps),
            dt=1.0 / header.fps,
            gravity=np.asarray(header.gravity, np.float64),
            up_axis="z",
            fabrics=np.array(list(header.materials), h5py.string_dtype()),
            config=header.config,
        )
        for fabric, settings in header.materials.items():
            file.create_group(f"materials/{fabric}").attrs.update(settings)
        self._index.materials.update(header.materials)

    def add_body(self, name: str, body: StoredBody) -> None:
        """A body; sequences and garments refer to it by name."""
        self._add("bodies", name, body)

    def add_garment(self, name: str, garment: StoredGarment) -> None:
        """A garment; sequences refer to it by name."""
        self._add("garments", name, garment)

    def add_sequence(self, sequence: StoredGarmentSequence) -> None:
        """A sequence of a body and a garment that were added before."""
        self._add("sequences", sequence.name, sequence)

    def has(self, kind: str, name: str) -> bool:
        """Whether ``name`` of ``bodies``, ``garments`` or ``sequences`` was added."""
        return name in self._index.groups[kind]

    def _add(self, kind: str, name: str, part: object) -> None:
        if not name or "/" in name or name in self._index.groups[kind]:
            raise DrapeError(f"{self._path}: {kind}: found the name {name!r}; expected a new one, without '/'")
        group = self._file.create_group(f"{kind}/{name}")
        for key in schema.GROUP_ATTRIBUTES[kind]:
            value = getattr(part, key)
            group.attrs[key] = json.dumps(value, sort_keys=True) if key in schema.JSON_ATTRIBUTES else value
        for entry in schema.FIELDS[kind]:
            array = getattr(part, entry.name)
            if array is None:
                continue
            data = np.ascontiguousarray(array, entry.dtype)
            if not np.isfinite(data).all():
                raise DrapeError(f"{self._path}: {kind}/{name}/{entry.name}: found a number that is not finite")
            group.create_dataset(entry.name, data=data).attrs.update(units=entry.unit, meaning=entry.meaning)
        self._index.add(self._file, self._path, kind, name)


@contextlib.contextmanager
def garment_writer(path: Path | str, header: GarmentHeader, size: int = 0) -> Iterator[GarmentWriter]:
    """A writer to a temporary name; when the block ends well the whole file is checked and becomes ``path``.

    ``size``: about how many bytes there will be, so that a full disk is found before the work.

    Raises:
        DrapeError: what was added does not fit the schema; ``path`` is untouched.
        OSError: the disk is full or not writable; ``path`` is untouched.
    """
    path = Path(path)
    with whole_file(path) as temporary:
        reserve(temporary, size)
        with h5py.File(temporary, "w", libver="v110") as file:  # opens much faster than HDF5's oldest format
            yield GarmentWriter(file, path, header)
        with GarmentFile(temporary) as written:
            written.check_frames()
        flush(temporary)


def write_garments(
    path: Path | str,
    header: GarmentHeader,
    bodies: Mapping[str, StoredBody],
    garments: Mapping[str, StoredGarment],
    sequences: Iterable[StoredGarmentSequence],
    size: int = 0,
) -> None:
    """Write a whole data set under a temporary name, check it, and move it to ``path``; sequences come one by one.

    ``size``: about how many bytes there will be, so that a full disk is found before the work.

    Raises:
        DrapeError: what is given does not fit the schema; ``path`` is untouched.
        OSError: the disk is full or not writable; ``path`` is untouched.
    """
    with garment_writer(path, header, size) as writer:
        for name, body in bodies.items():
            writer.add_body(name, body)
        for name, garment in garments.items():
            writer.add_garment(name, garment)
        for sequence in sequences:
            writer.add_sequence(sequence)
