"""One animated scene in HDF5: what is stored of it, and the reader; animation_writer writes it frame by frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float, Int

from drape.data.form_hdf5 import Forms, read_forms
from drape.data.formats import open_hdf5
from drape.data.schema import Field, plain
from drape.data.schema_check import check_dataset, check_kinds
from drape.errors import DrapeError
from drape.scene.obstacle import Obstacle
from drape.scene.scene import Scene
from drape.scene.state import State, Trajectory
from drape.stored import reading, sound

FORMAT = "drape animation"
VERSION = 1
FIELDS = (
    Field("mesh/rest_positions", ("vertices", 3), "float64", "m", "rest shape"),
    Field("mesh/faces", ("faces", 3), "int64", "1", "vertex indices, one winding for all faces"),
    Field("mesh/mass", ("vertices",), "float64", "kg", "mass of each vertex"),
    Field("mesh/pinned", ("vertices",), "bool", "1", "whose position is given"),
    Field("x", ("frames", "vertices", 3), "float64", "m", "frame k is at time k * dt; frame 0 is the initial state"),
    Field("v", ("frames", "vertices", 3), "float64", "m/s", "velocities"),
)
BODY = (
    Field("body/faces", ("body_faces", 3), "int64", "1", "vertex indices, winding outwards"),
    Field("body/positions", ("body_frames", "body_vertices", 3), "float64", "m", "one frame: it stands still"),
)
"""In a scene with a body."""
ATTRIBUTES = ("dt", "gravity", "fabric", "frames_wanted", "columns", "config", "drape_version")
COMMAND = "python src/animate.py"


@dataclass(frozen=True, eq=False)
class AnimationHeader:
    """Everything in the file of an animated scene that is not a frame of the cloth."""

    rest_positions: Float[np.ndarray, "vertices 3"]
    """[m]"""
    faces: Int[np.ndarray, "faces 3"]
    mass: Float[np.ndarray, " vertices"]
    """[kg]"""
    dt: float
    """Time between frames [s]."""
    frames: int
    """Number of frames that there are to be, the initial state counted."""
    gravity: Float[np.ndarray, "3"]
    """[m/s²]"""
    fabric: str = ""
    pinned: Int[np.ndarray, " pinned"] = field(default_factory=lambda: np.zeros(0, np.int64))
    obstacle: Obstacle | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    """Names and units of the numbers that are stored with each frame, such as ``{"residual": "N"}``."""
    config: str = "{}"
    """Settings that determine the frames, as YAML: an animation goes on only where this is the same."""
    forms: Forms = (None, None)
    """Forms of cloth and body in their files."""

    @classmethod
    def of_scene(cls, scene: Scene, columns: Mapping[str, str], config: str) -> AnimationHeader:
        """The header of a simulation of ``scene``."""
        return cls(
            rest_positions=scene.mesh.rest_positions.astype(np.float64),
            faces=scene.mesh.faces,
            mass=scene.mass,
            dt=scene.dt,
            frames=scene.frames + 1,
            gravity=scene.gravity,
            fabric=scene.material.name,
            pinned=np.zeros(0, np.int64) if scene.pins is None else scene.pins.vertices,
            obstacle=scene.obstacle,
            columns=columns,
            config=config,
            forms=scene.forms,
        )

    @property
    def first(self) -> int:
        """Number of the first frame in the file of a body that moves; 0 without."""
        body = self.forms[1]
        return 0 if body is None or self.obstacle is None or self.obstacle.is_static else body.first

    def arrays(self) -> dict[str, np.ndarray]:
        """The datasets of :data:`FIELDS` and :data:`BODY` that are no frames of the cloth."""
        arrays = {
            "mesh/rest_positions": self.rest_positions,
            "mesh/faces": self.faces,
            "mesh/mass": self.mass,
            "mesh/pinned": np.isin(np.arange(len(self.rest_positions)), self.pinned),
        }
        if self.obstacle is not None:
            arrays |= {"body/faces": self.obstacle.faces, "body/positions": self.obstacle.positions[: self.frames]}
        kinds = {entry.name: entry.dtype for entry in (*FIELDS, *BODY)}
        return {name: np.asarray(array, kinds[name]) for name, array in arrays.items()}


class AnimationFile:
    """An animated scene opened for reading; frames of the cloth and the body are read when they are asked for.

    ``num_frames`` are there, ``header.frames`` were wanted: fewer where the simulation was interrupted.

    Raises:
        DrapeError: no such file, not HDF5 or cut off, or not what :data:`FIELDS` says; when it is read, a frame that
            is damaged or not finite.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._file = open_hdf5(self.path, COMMAND)
        try:
            with reading(self.path, f"make it again with: {COMMAND}"):
                self._check()
                self._check_values()
        except DrapeError:
            self.close()
            raise

    def _check(self) -> None:
        for name, expected in (("format", FORMAT), ("schema_version", VERSION)):
            found = plain(self._file.attrs.get(name, "nothing"))
            if found != expected:
                raise DrapeError(
                    f"{self.path}: attribute {name}: found {found!r}; expected {expected!r}; this is no animation of "
                    f"this version, make one with: {COMMAND}"
                )
        missing = [name for name in ATTRIBUTES if name not in self._file.attrs]
        if missing:
            raise DrapeError(f"{self.path}: attributes: missing {', '.join(missing)}; make it again with: {COMMAND}")
        check_kinds(self._file.attrs, self.path)
        lengths: dict[str, int] = {}
        for entry in (*FIELDS, *(BODY if "body" in self._file else ())):
            check_dataset(self._file.get(entry.name), self.path, entry, lengths)
        for name in plain(self._file.attrs["columns"]):
            unit = plain(self._file[f"numbers/{name}"].attrs["units"]) if f"numbers/{name}" in self._file else "1"
            entry = Field(f"numbers/{name}", ("frames",), "float64", unit, "")
            check_dataset(self._file.get(entry.name), self.path, entry, lengths)

    def _check_values(self) -> None:
        """Refuse what no animation can have: faces of no vertex, nothing that weighs, more frames than were wanted."""
        rest, faces, mass = (self._file[f"mesh/{name}"][:] for name in ("rest_positions", "faces", "mass"))
        if not (faces.min() >= 0 and faces.max() < len(rest)):
            raise DrapeError(f"{self.path}: mesh/faces: found {faces.max()}; expected 0..{len(rest) - 1}")
        if not sound(rest).all():
            raise DrapeError(f"{self.path}: mesh/rest_positions: found a number that is not finite")
        if not (mass > 0).all():
            raise DrapeError(f"{self.path}: mesh/mass: found {mass.min()}; expected numbers above 0 [kg]")
        wanted = plain(self._file.attrs["frames_wanted"])
        if not self.num_frames <= wanted:
            raise DrapeError(f"{self.path}: x: found {self.num_frames} frames; expected at most {wanted}")

    def __enter__(self) -> AnimationFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def num_frames(self) -> int:
        return self._file["x"].shape[0]

    @property
    def is_complete(self) -> bool:
        """All frames that were wanted are there."""
        return self.num_frames == plain(self._file.attrs["frames_wanted"])

    @cached_property
    def header(self) -> AnimationHeader:
        """Meshes, masses, body, time, configuration."""
        with reading(self.path, f"make it again with: {COMMAND}"):
            return self._header()

    def _header(self) -> AnimationHeader:
        file, attributes = self._file, {name: plain(self._file.attrs[name]) for name in ATTRIBUTES}
        names = attributes["columns"]
        return AnimationHeader(
            rest_positions=file["mesh/rest_positions"][:],
            faces=file["mesh/faces"][:],
            mass=file["mesh/mass"][:],
            dt=attributes["dt"],
            frames=attributes["frames_wanted"],
            gravity=np.asarray(attributes["gravity"], np.float64),
            fabric=attributes["fabric"],
            pinned=np.flatnonzero(file["mesh/pinned"][:]),
            obstacle=Obstacle(file["body/faces"][:], file["body/positions"][:]) if "body" in file else None,
            columns={name: plain(file[f"numbers/{name}"].attrs["units"]) for name in names},
            config=attributes["config"],
            forms=read_forms(file),
        )

    def x(self, frame: int) -> Float[np.ndarray, "vertices 3"]:
        """Positions at one frame [m]."""
        return self._frame("x", frame)

    def state(self, frame: int) -> State:
        """Positions and velocities at one frame."""
        return State(self._frame("x", frame), self._frame("v", frame))

    def _frame(self, name: str, frame: int) -> np.ndarray:
        if not 0 <= frame < self.num_frames:
            raise DrapeError(f"{self.path}: {name}: asked for frame {frame}; expected 0..{self.num_frames - 1}")
        with reading(self.path, f"make it again with: {COMMAND}"):
            found = self._file[name][frame]
        if not np.isfinite(found).all():
            raise DrapeError(f"{self.path}: {name}: frame {frame}: found a number that is not finite")
        return found

    def trajectory(self) -> Trajectory:
        """All frames at once."""
        x, v = (np.stack([self._frame(name, frame) for frame in range(self.num_frames)]) for name in ("x", "v"))
        return Trajectory(x, v, plain(self._file.attrs["dt"]))

    def numbers(self) -> dict[str, Float[np.ndarray, " frames"]]:
        """Per name of ``header.columns`` a value for each frame; NaN where nothing was measured."""
        return {name: self._file[f"numbers/{name}"][:] for name in self.header.columns}


def describe(dataset: h5py.Dataset) -> None:
    """State the unit and the meaning of a dataset of :data:`FIELDS` or :data:`BODY`."""
    entry = next(entry for entry in (*FIELDS, *BODY) if f"/{entry.name}" == dataset.name)
    dataset.attrs.update(units=entry.unit, meaning=entry.meaning)
