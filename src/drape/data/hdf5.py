"""Read data sets of trajectories in HDF5; the layout and the check are those of schema."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float, Int

from drape.data import schema
from drape.data.piece import Piece
from drape.errors import DrapeError
from drape.scene.mesh import ClothMesh
from drape.stored import check_hdf5, reading


class TrajectoryFile:
    """A data set opened for reading. Only what is asked for is read; positions are mapped from the file, never kept.

    The file is checked in full (once, one sequence at a time) when the object is made. The object can be pickled and
    used after a fork: every process opens the file for itself.

    Raises:
        DrapeError: no such file, not HDF5 or cut off, or anything that the schema does not allow.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._handle: h5py.File | None = None
        self._process = -1
        file = self._file()
        with reading(self.path, "generate the file again"):
            schema.check_file(file, self.path)
            self.mesh  # noqa: B018  # a mesh that is no cloth is refused now

    def __getstate__(self) -> dict:
        state = {**self.__dict__, "_handle": None, "_process": -1}
        state.pop("_positions", None)
        return state

    def close(self) -> None:
        """Close the file; the next access opens it again."""
        if self._handle is not None and self._process == os.getpid():
            self._handle.close()
        self._handle = None
        self.__dict__.pop("_positions", None)

    def _file(self) -> h5py.File:
        if self._handle is None or self._process != os.getpid():
            self._handle = open_hdf5(self.path, f"python src/generate.py data.path={self.path}")
            self._process = os.getpid()
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
    def materials(self) -> dict[str, dict[str, float | int | str]]:
        """Blender's settings per fabric, and ``mass_per_vertex`` [kg]."""
        groups = self._file()["materials"]
        return {name: {key: schema.plain(value) for key, value in groups[name].attrs.items()} for name in self.fabrics}

    @cached_property
    def fabric(self) -> Int[np.ndarray, " sequences"]:
        """Index into :attr:`fabrics` per sequence."""
        return self._file()["fabric"][:]

    @cached_property
    def attempts(self) -> Int[np.ndarray, " sequences"]:
        """Number of random starts of a sequence; 1 if the first was accepted."""
        return self._file()["attempts"][:]

    @cached_property
    def num_sequences(self) -> int:
        return self._file()["positions"].shape[0]

    @cached_property
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
        return self._positions[sequence, start:stop].copy()  # what is returned stays when the file is closed

    def windows(
        self, sequences: Int[np.ndarray, " windows"], frames: Int[np.ndarray, "length windows"]
    ) -> Float[np.ndarray, "length vertices 3"]:
        """Positions [m] of the ``frames`` of each window, the vertices of all windows one after the other."""
        return self._positions[sequences, frames].reshape(len(frames), -1, 3)

    def frames_of(self, sequence: int) -> int:
        """Number of frames of a sequence: the same for all."""
        return self.num_frames

    def piece(self, sequence: int) -> Piece:
        """The piece of cloth of a sequence: one for each fabric, whose vertices all weigh the same."""
        return self._pieces[self.fabric[sequence]]

    @cached_property
    def _pieces(self) -> list[Piece]:
        masses = [float(self.materials[name]["mass_per_vertex"]) for name in self.fabrics]
        return [Piece(self.mesh, self.pinned, np.full(self.mesh.num_vertices, mass)) for mass in masses]

    @cached_property
    def _positions(self) -> Float[np.ndarray, "sequences frames vertices 3"]:
        dataset = self._file()["positions"]
        return np.asarray(np.memmap(self.path, dataset.dtype, "r", dataset.id.get_offset(), dataset.shape))


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
