"""Read data sets of garments on moving bodies; garment_schema has the layout, garment_index the check."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from drape.data.garment_index import GarmentIndex
from drape.data.garment_schema import FIELDS, SPLITS
from drape.data.garment_sequence import GarmentSequence, GarmentWindow
from drape.data.hdf5 import open_hdf5
from drape.data.schema import plain
from drape.errors import DrapeError
from drape.scene.mesh import ClothMesh
from drape.stored import reading, sound

__all__ = ["GarmentFile", "GarmentSequence", "GarmentWindow"]


class GarmentFile:
    """A data set of garments opened for reading: names and attributes are in memory, arrays stay in the file.

    Opening checks the structure, all references, indices and meshes. Frames are mapped, and checked to be finite
    whenever they are read (the writer has checked them all before the file got its name), so that opening takes the
    same time however long the sequences are. The object can be pickled and used after a fork.

    Raises:
        DrapeError: no such file, not HDF5 or cut off, or anything that the schema does not allow.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        command = "python src/generate.py data=garments"
        with open_hdf5(self.path, command) as file, reading(self.path, "make the file again"):
            self.index = GarmentIndex.of_file(file, self.path)
        self._stamp = self._found_stamp()
        self._meshes: dict[str, ClothMesh] = {}
        self._check_length()

    def __enter__(self) -> GarmentFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getstate__(self) -> dict:
        return {key: value for key, value in self.__dict__.items() if key != "_map"} | {"_meshes": {}}

    def close(self) -> None:
        """Let go of the file; the next access opens it again."""
        self.__dict__.pop("_map", None)

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

    def attribute(self, name: str) -> object:
        """One of ``garment_schema.ATTRIBUTES``."""
        return plain(self.index.attributes[name])

    @property
    def source(self) -> str:
        """Program that made the frames."""
        return self.attribute("source")

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

    def mesh(self, garment: str) -> ClothMesh:
        """Rest positions [m] and topology of a garment.

        Raises:
            DrapeError: the mesh is no cloth, such as an edge with three faces.
        """
        if garment not in self._meshes:
            where = f"garments/{garment}"
            rest, faces = self.array(f"{where}/rest_positions"), self.array(f"{where}/faces")
            self._meshes[garment] = ClothMesh.from_faces(rest, faces, name=f"{self.path}: {where}")
        return self._meshes[garment]

    def array(
        self, name: str, start: int = 0, stop: int | None = None
    ) -> Float[np.ndarray, "..."] | Int[np.ndarray, "..."]:
        """Rows ``start`` to ``stop`` (default: all) of a dataset: a copy, in float64 or int64.

        Raises:
            DrapeError: a number that is not finite, or a file that was changed meanwhile.
        """
        offset, shape, kind = self.index.layouts[name]
        stored = np.ndarray(shape, kind, buffer=self._map if np.prod(shape) else None, offset=offset)[start:stop]
        if stored.dtype.kind != "f":
            return stored.astype(np.int64)
        finite = sound(stored)
        if not finite.all():
            row = start + int(np.argmin(finite.reshape(len(stored), -1).all(axis=1)))
            raise DrapeError(
                f"{self.path}: {name}: frame {row}: found a number that is not finite; expected finite numbers; "
                "make the file again"
            )
        return stored.astype(np.float64)

    def check_frames(self) -> None:
        """Read every frame of every sequence once, one sequence at a time.

        Raises:
            DrapeError: a number that is not finite.
        """
        for name in self.names:
            for entry in FIELDS["sequences"]:
                if f"sequences/{name}/{entry.name}" in self.index.layouts:
                    self.array(f"sequences/{name}/{entry.name}")
