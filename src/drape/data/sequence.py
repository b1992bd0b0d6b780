"""One sequence of a data set, a garment on a moving body or a sheet alone, read as far as it is asked for."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from drape.data.blender_clock import gravity_factor
from drape.errors import DrapeError
from drape.figure.skinning import pose_vertices
from drape.geometry.mesh import ClothMesh

if TYPE_CHECKING:
    from drape.data.hdf5 import GarmentFile


class GarmentWindow(NamedTuple):
    """A few frames of a sequence, one after the other."""

    positions: Float[np.ndarray, "frames vertices 3"] | None
    """Garment [m]; None in the motion of a body alone."""
    body_positions: Float[np.ndarray, "frames body_vertices 3"] | None
    """[m]; None of a sheet."""


@dataclass(frozen=True, eq=False)
class GarmentSequence:
    """One sequence of a data set; :meth:`GarmentFile.sequence` makes it. What was read once is kept.

    A sequence may be the motion of a body alone (VTO): then ``garment``, ``kind`` and ``fabric`` are empty, and what
    asks for the garment raises a DrapeError. It may be a sheet, without a ``body``: then what asks for that does.
    """

    file: GarmentFile = field(repr=False)
    name: str
    kind: str
    """tshirt, top, jumpsuit, dress, skirt, trousers, ..."""
    garment: str
    body: str
    fabric: str
    motion: str
    split: str
    attempts: int
    mass_per_vertex: float
    """[kg]; the mean where vertices differ, see :attr:`mass`."""
    friction: float
    """Coefficient of Coulomb's friction between garment and body."""
    quality: dict
    """Numbers of the quality control."""

    @classmethod
    def stored_attributes(cls) -> tuple[str, ...]:
        """Fields that are attributes of the group in the file."""
        return tuple(entry.name for entry in fields(cls) if entry.name not in ("file", "name", "kind"))

    @property
    def gravity(self) -> Float[np.ndarray, "3"]:
        """Gravity that acted on the garment [m/s²]: in some of Blender's recordings more than was asked for."""
        steps = self.quality.get("solver_steps")
        return self.file.gravity * (gravity_factor(int(steps)) if self.file.made_by_blender and steps else 1.0)

    @cached_property
    def num_frames(self) -> int:
        stored = next(name for name in ("transforms", "body_positions", "positions") if self._has(name))
        return self.file.index.layouts[f"sequences/{self.name}/{stored}"].shape[0]

    @property
    def is_recorded(self) -> bool:
        """Frames of the garment are there, to learn from and to compare with."""
        return self._has("positions")

    @property
    def mesh(self) -> ClothMesh:
        """Rest positions [m] and topology of the garment."""
        return self.file.mesh(self._garment())

    @cached_property
    def pinned(self) -> Int[np.ndarray, " pinned"]:
        """Vertices that are led along their recorded positions."""
        return self.file.array(f"garments/{self._garment()}/pinned")

    @cached_property
    def mass(self) -> Float[np.ndarray, " vertices"]:
        """Mass of each vertex [kg]."""
        stored = f"garments/{self._garment()}/mass"
        if stored in self.file.index.layouts:
            return self.file.array(stored)
        return np.full(self.mesh.num_vertices, float(self.mass_per_vertex))

    @cached_property
    def positions(self) -> Float[np.ndarray, "frames vertices 3"]:
        """The garment [m]."""
        return self._frames("positions", "recorded positions of the garment")

    @cached_property
    def twin(self) -> Float[np.ndarray, "frames vertices 3"] | None:
        """The same simulation, started 1e-6 m to the side [m]; its error is the noise floor. None without it."""
        return self._frames("twin", "") if self._has("twin") else None

    @cached_property
    def body_faces(self) -> Int[np.ndarray, "body_faces 3"]:
        self.check_body()
        return self.file.array(f"bodies/{self.body}/faces")

    @cached_property
    def body_rest_positions(self) -> Float[np.ndarray, "body_vertices 3"]:
        """The body in its rest pose [m]."""
        self.check_body()
        return self.file.array(f"bodies/{self.body}/rest_positions")

    @property
    def transforms(self) -> Float[np.ndarray, "frames joints 4 4"] | None:
        """Skinning transforms from the rest pose; None where the frames of the body are stored themselves."""
        return self._frames("transforms", "") if self._has("transforms") else None

    @cached_property
    def body_positions(self) -> Float[np.ndarray, "frames body_vertices 3"]:
        """The body [m]."""
        return self._body(0, self.num_frames)

    @cached_property
    def skinned(self) -> Float[np.ndarray, "frames vertices 3"] | None:
        """The garment as its skinning weights carry it [m]; None where there are no weights or no transforms."""
        return self.carried(0, self.num_frames) if self.is_carried else None

    @property
    def is_carried(self) -> bool:
        """There are skinning weights of the garment, and transforms."""
        return self._has("transforms") and f"garments/{self.garment}/bones" in self.file.index.layouts

    def check_body(self) -> None:
        """Refuse a sheet.

        Raises:
            DrapeError: there is no body.
        """
        if not self.body:
            raise DrapeError(
                f"{self._where()}: is a sheet without a body; expected a garment on one: choose a data set that has "
                "some, such as that of python src/generate.py data=garments"
            )

    def carried(self, start: int, length: int) -> Float[np.ndarray, "frames vertices 3"]:
        """The garment as its skinning weights carry it in frames ``start`` to ``start + length`` (exclusive) [m]."""
        return self._posed(f"garments/{self.garment}", start, start + length)

    def window(self, start: int, length: int) -> GarmentWindow:
        """Frames ``start`` to ``start + length`` (exclusive); nothing else is read.

        Raises:
            DrapeError: frames that are not there.
        """
        stop = start + length
        if not 0 <= start < stop <= self.num_frames:
            raise DrapeError(
                f"{self._where()}: asked for frames {start} to {stop}; expected frames in 0..{self.num_frames}"
            )
        stored = f"sequences/{self.name}/positions"
        positions = self.file.array(stored, start, stop) if self.is_recorded else None
        return GarmentWindow(positions, self._body(start, stop) if self.body else None)

    def _body(self, start: int, stop: int) -> Float[np.ndarray, "frames body_vertices 3"]:
        if self._has("transforms"):
            return self._posed(f"bodies/{self.body}", start, stop)
        self.check_body()
        return self.file.array(f"sequences/{self.name}/body_positions", start, stop)

    def _posed(self, group: str, start: int, stop: int) -> Float[np.ndarray, "frames carried 3"]:
        rest, bones, weights = self._carried(group)
        return pose_vertices(rest, bones, weights, self.file.array(f"sequences/{self.name}/transforms", start, stop))

    @cached_property
    def _carried_groups(self) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        return {}

    def _carried(self, group: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rest positions, bones and weights: read once, as every window needs them."""
        if group not in self._carried_groups:
            names = ("rest_positions", "bones", "weights")
            rest, bones, weights = (self.file.array(f"{group}/{name}") for name in names)
            self._carried_groups[group] = rest, bones, weights
        return self._carried_groups[group]

    def _has(self, name: str) -> bool:
        return f"sequences/{self.name}/{name}" in self.file.index.layouts

    def _frames(self, name: str, what: str) -> np.ndarray:
        if not self._has(name):
            raise DrapeError(f"{self._where()}: has no {what}; expected a data set with recorded garments")
        return self.file.array(f"sequences/{self.name}/{name}")

    def _garment(self) -> str:
        if not self.garment:
            raise DrapeError(
                f"{self._where()}: is the motion of a body alone, without a garment; choose a sequence with one"
            )
        return self.garment

    def _where(self) -> str:
        return f"{self.file.path}: sequences/{self.name}"
