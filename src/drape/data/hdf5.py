"""Read data sets of cloth in HDF5, whatever their format; schema has the layout, index the check."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from drape.data.formats import index_of, open_hdf5
from drape.data.index import Layout
from drape.data.schema import AGAIN, FIELDS, GROUP_ATTRIBUTES, SPLITS, plain
from drape.data.sequence import GarmentSequence
from drape.data.stored_part import Part, StoredBody, StoredGarment, StoredSequence
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.stored import reading, sound

GENERATE = "python src/generate.py data=garments"


class GarmentFile:
    """A data set opened for reading, of garments or of sheets, which are garments without a body.

    Names and attributes are in memory, arrays stay in the file. Opening checks the structure, all references, indices
    and meshes. Frames are mapped, and checked to be finite whenever they are read (the writer has checked them all
    before the file got its name), so that opening takes the same time however long the sequences are. The object can be
    pickled and used after a fork.

    Args:
        path: of the file.
        command: that makes such a file, for messages.

    Raises:
        DrapeError: no such file, not HDF5 or cut off, or anything that the schema does not allow.
    """

    def __init__(self, path: Path | str, command: str = GENERATE) -> None:
        self.path = Path(path)
        with open_hdf5(self.path, command) as file, reading(self.path, AGAIN):
            self.index = index_of(file, self.path, command)
        self._stamp = self._found_stamp()
        self._meshes: dict[str | bytes, ClothMesh] = {}
        self._check_length()

    def __enter__(self) -> GarmentFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getstate__(self) -> dict:
        passing = ("_map", "_piled", "sequences")
        return {key: value for key, value in self.__dict__.items() if key not in passing} | {"_meshes": {}}

    def close(self) -> None:
        """Let go of the file; the next access opens it again."""
        self.__dict__.pop("_map", None)
        self.__dict__.pop("_piled", None)

    def _found_stamp(self) -> tuple[int, int]:
        stat = self.path.stat()
        return stat.st_size, stat.st_mtime_ns

    def _check_length(self) -> None:
        for name, layout in self.index.layouts.items():
            end = layout.offset + int(np.prod(layout.shape)) * np.dtype(layout.dtype).itemsize
            if end > self._stamp[0]:
                raise DrapeError(
                    f"{self.path}: {name}: found a file of {self._stamp[0]} bytes; expected at least {end}; it is cut "
                    "off: copy or make it again"
                )

    @cached_property
    def _map(self) -> np.memmap:
        if not self.path.is_file() or self._found_stamp() != self._stamp:
            raise DrapeError(f"{self.path}: was replaced or changed since it was opened; open it again")
        return np.memmap(self.path, np.uint8, "r")

    def attribute(self, name: str) -> Any:
        """One of ``schema.ATTRIBUTES``."""
        return plain(self.index.attributes[name])

    @property
    def source(self) -> str:
        """Program that made the frames."""
        return self.attribute("source")

    @property
    def made_by_blender(self) -> bool:
        """Whether Blender's cloth made the frames."""
        return str(self.source).startswith("blender")

    @property
    def fps(self) -> float:
        """Frames per second [1/s]."""
        return self.attribute("fps")

    @property
    def dt(self) -> float:
        """Time step [s]."""
        return self.attribute("dt")

    @property
    def gravity(self) -> Float[np.ndarray, " 3"]:
        """Acceleration really applied [m/s²]."""
        return np.asarray(self.attribute("gravity"), np.float64)

    @property
    def fabrics(self) -> tuple[str, ...]:
        return tuple(self.attribute("fabrics"))

    @property
    def materials(self) -> dict[str, dict]:
        """Blender's settings per fabric, and ``mass_per_vertex`` [kg]."""
        return self.index.materials

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the sequences, sorted."""
        return tuple(sorted(self.index.groups["sequences"]))

    def split(self, name: str) -> tuple[str, ...]:
        """The sequences of split ``train`` or ``test``."""
        if name not in SPLITS:
            raise DrapeError(f"{self.path}: split {name!r}; expected one of {', '.join(SPLITS)}")
        return tuple(key for key in self.names if self.index.groups["sequences"][key]["split"] == name)

    def check_fabrics(self, fabrics: Sequence[str]) -> None:
        """Refuse fabrics that the file does not have.

        Raises:
            DrapeError: some are missing.
        """
        unknown = [name for name in fabrics if name not in self.fabrics]
        if unknown:
            asked, known = ", ".join(unknown), ", ".join(self.fabrics)
            raise DrapeError(f"{self.path}: no fabric {asked}; it has {known}; choose material=... of these")

    def numbers(self, split: str, fabrics: Sequence[str]) -> list[int]:
        """The sequences of a split that are of these fabrics, as numbers that count through :attr:`sequences`.

        Raises:
            DrapeError: there is none.
        """
        names = set(self.split(split))
        found = [k for k, each in enumerate(self.sequences) if each.name in names and each.fabric in fabrics]
        if not found:
            raise DrapeError(
                f"{self.path}: split {split}: found no sequence of {', '.join(fabrics)}; expected some; generate more "
                "sequences or choose other fabrics"
            )
        return found

    def sequence(self, name: str) -> GarmentSequence:
        """One sequence; its frames are read when they are asked for.

        Raises:
            DrapeError: there is no such sequence.
        """
        if name not in self.index.groups["sequences"]:
            raise DrapeError(
                f"{self.path}: found no sequence {name!r}; expected one of {len(self.names)}, from {self.names[0]} to "
                f"{self.names[-1]}"
            )
        attributes = self.index.groups["sequences"][name]
        garment = self.index.groups["garments"].get(attributes["garment"], {"kind": ""})
        known = {key: attributes[key] for key in GarmentSequence.stored_attributes()}
        return GarmentSequence(file=self, name=name, kind=garment["kind"], **known)

    @cached_property
    def sequences(self) -> tuple[GarmentSequence, ...]:
        """All of them, in the order of their names."""
        return tuple(self.sequence(name) for name in self.names)

    def mesh(self, garment: str) -> ClothMesh:
        """Rest positions [m] and topology of a garment; garments of the same mesh share the object.

        Raises:
            DrapeError: the mesh is no cloth, such as an edge with three faces.
        """
        if garment not in self._meshes:
            where = f"garments/{garment}"
            rest, faces = (self._stored(f"{where}/{name}").copy() for name in ("rest_positions", "faces"))
            content = rest.tobytes() + faces.tobytes()
            if content not in self._meshes:
                self._meshes[content] = ClothMesh.from_faces(rest, faces, name=f"{self.path}: {where}")
            self._meshes[garment] = self._meshes[content]
        return self._meshes[garment]

    def array(
        self, name: str, start: int = 0, stop: int | None = None
    ) -> Float[np.ndarray, "..."] | Int[np.ndarray, "..."]:
        """Rows ``start`` to ``stop`` (default: all) of a dataset: a copy, in float64 or int64.

        Raises:
            DrapeError: a number that is not finite, or a file that was changed meanwhile.
        """
        stored = self._stored(name, start, stop)
        return stored.astype(np.float64 if stored.dtype.kind == "f" else np.int64)

    def _stored(self, name: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """As :meth:`array`, not copied, as it is stored."""
        offset, shape, kind = self.index.layouts[name]
        whole: np.ndarray = np.ndarray(shape, kind, buffer=self._map if np.prod(shape) else None, offset=offset)
        rows = whole[start:stop]
        finite = sound(rows) if rows.dtype.kind == "f" else np.ones(1, bool)
        if not finite.all():
            row = start + int(np.argmin(finite.reshape(len(rows), -1).all(axis=1)))
            raise DrapeError(
                f"{self.path}: {name}: frame {row}: found a number that is not finite; expected finite numbers; {AGAIN}"
            )
        return rows

    def windows(
        self, numbers: Int[np.ndarray, " windows"], frames: Int[np.ndarray, "length windows"]
    ) -> Float[np.ndarray, "length vertices 3"]:
        """Recorded positions [m] of the ``frames`` of windows, the vertices of all windows one after the other.

        ``numbers`` count through :attr:`sequences`. Not checked again (:func:`open_trajectories` has), in float32.
        """
        if isinstance(self._piled, np.ndarray):
            return self._piled[numbers, frames].reshape(len(frames), -1, 3)
        pairs = zip(numbers.tolist(), frames.T, strict=True)
        return np.concatenate([self._piled[number][seen] for number, seen in pairs], axis=1)

    @cached_property
    def _piled(self) -> Float[np.ndarray, "sequences frames vertices 3"] | list[Float[np.ndarray, "frames vertices 3"]]:
        """Recorded positions of each sequence; as one array where they lie in the file like that, as sheets do."""
        layouts = [self.index.layouts[f"sequences/{name}/positions"] for name in self.names]
        offset, shape, kind = layouts[0]
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        if layouts == [Layout(offset + number * size, shape, kind) for number in range(len(layouts))]:
            return np.asarray(np.ndarray((len(layouts), *shape), kind, buffer=self._map, offset=offset))
        return [np.asarray(np.ndarray(each.shape, each.dtype, self._map, each.offset)) for each in layouts]

    def check_frames(self) -> None:
        """Read every frame of every sequence once, one sequence at a time.

        Raises:
            DrapeError: a number that is not finite.
        """
        for name in self.names:
            for entry in FIELDS["sequences"]:
                if f"sequences/{name}/{entry.name}" in self.index.layouts:
                    self._stored(f"sequences/{name}/{entry.name}")

    def part(self, name: str) -> Part:
        """Sequence ``name`` with everything that it needs, as it goes into another file."""
        sequence = self.sequence(name)
        garment = StoredGarment(**self._part("garments", sequence.garment)) if sequence.garment else None
        body = StoredBody(**self._part("bodies", sequence.body)) if sequence.body else None
        return Part(body, garment, StoredSequence(name=name, **self._part("sequences", name)))

    def _part(self, kind: str, group: str) -> dict[str, Any]:
        attributes = {key: self.index.groups[kind][group][key] for key in GROUP_ATTRIBUTES[kind]}
        names = {entry.name: f"{kind}/{group}/{entry.name}" for entry in FIELDS[kind]}
        arrays = {key: self.array(name) for key, name in names.items() if name in self.index.layouts}
        return attributes | arrays
