"""Read data sets of recordings in HDF5; the layout and the check are those of recording_schema."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float, Int

from drape.data import recording_schema as layout
from drape.data.hdf5 import open_hdf5
from drape.data.piece import Piece
from drape.data.schema import SPLITS, plain
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.stored import reading


class RecordingFile:
    """A data set of recordings opened for reading: what :class:`TrajectoryFile` is, for sequences of several pieces.

    Everything but positions is kept; those are mapped from the file. The object can be pickled and used after a fork.

    Raises:
        DrapeError: no such file, not HDF5 or cut off, or anything that the schema does not allow.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        with open_hdf5(self.path, f"python src/generate.py data=recorded data.path={self.path}") as file:
            with reading(self.path, "convert the recordings again"):
                layout.check_file(file, self.path)
            self._attributes = {name: plain(value) for name, value in file.attrs.items()}
            self.fabrics: tuple[str, ...] = tuple(self._attributes["fabrics"])
            self.materials = {
                name: {key: plain(value) for key, value in file[f"materials/{name}"].attrs.items()}
                for name in self.fabrics
            }
            self.pieces = _pieces(file, self.path)
            groups = [file[layout.sequence_path(number)] for number in range(len(file["sequences"]))]
            self.names = [str(group.attrs["name"]) for group in groups]
            self._piece, self.fabric, self._split = (
                np.array([int(group.attrs[name]) for group in groups]) for name in ("piece", "fabric", "split")
            )
            self._places = [(group["positions"].id.get_offset(), group["positions"].shape) for group in groups]
        self._maps: dict[int, np.ndarray] = {}

    def __getstate__(self) -> dict:
        return {**self.__dict__, "_maps": {}}

    def attribute(self, name: str) -> object:
        """One of ``recording_schema.ATTRIBUTES_OF_FILE``."""
        return self._attributes[name]

    @cached_property
    def dt(self) -> float:
        """Time step [s]."""
        return float(self._attributes["dt"])

    @cached_property
    def gravity(self) -> Float[np.ndarray, " 3"]:
        """[m/s²]"""
        return np.asarray(self._attributes["gravity"], np.float64)

    @property
    def num_sequences(self) -> int:
        return len(self._places)

    def frames_of(self, sequence: int) -> int:
        """Number of frames of a sequence."""
        return self._places[sequence][1][0]

    def piece(self, sequence: int) -> Piece:
        """The piece of cloth of a sequence."""
        return self.pieces[self._piece[sequence]]

    def split(self, name: str) -> Int[np.ndarray, " selected"]:
        """The numbers of the sequences of split ``train`` or ``test``."""
        if name not in SPLITS:
            raise DrapeError(f"{self.path}: split {name!r}; expected one of {', '.join(SPLITS)}")
        return np.flatnonzero(self._split == SPLITS.index(name))

    def positions(
        self, sequence: int, start: int = 0, stop: int | None = None
    ) -> Float[np.ndarray, "frames vertices 3"]:
        """Positions [m] of frames ``start`` to ``stop`` (exclusive; default: to the end) of one sequence."""
        frames = self.frames_of(sequence) if 0 <= sequence < self.num_sequences else 0
        stop = frames if stop is None else stop
        if not 0 <= start < stop <= frames:
            raise DrapeError(
                f"{self.path}: positions: asked for sequence {sequence}, frames {start} to {stop}; expected a sequence "
                f"in 0..{self.num_sequences - 1} and some of its frames"
            )
        return self._map(sequence)[start:stop].copy()

    def windows(
        self, sequences: Int[np.ndarray, " windows"], frames: Int[np.ndarray, "length windows"]
    ) -> Float[np.ndarray, "length vertices 3"]:
        """Positions [m] of the ``frames`` of each window, the vertices of all windows one after the other."""
        pairs = zip(sequences.tolist(), frames.T, strict=True)
        return np.concatenate([self._map(sequence)[seen] for sequence, seen in pairs], axis=1)

    def _map(self, sequence: int) -> np.ndarray:
        if sequence not in self._maps:
            offset, shape = self._places[sequence]
            self._maps[sequence] = np.asarray(np.memmap(self.path, np.float32, "r", offset, shape))
        return self._maps[sequence]


def _pieces(file: h5py.File, path: Path) -> list[Piece]:
    meshes: dict[tuple[bytes, bytes], ClothMesh] = {}
    pieces = []
    for number in range(len(file["pieces"])):
        group = file[layout.piece_path(number)]
        rest, faces = group["rest_positions"][:], group["faces"][:]
        key = rest.tobytes(), faces.tobytes()
        if key not in meshes:
            meshes[key] = ClothMesh.from_faces(rest, faces, name=f"{path}: {layout.piece_path(number)}")
        pieces.append(Piece(meshes[key], group["pinned"][:], group["mass"][:]))
    return pieces
