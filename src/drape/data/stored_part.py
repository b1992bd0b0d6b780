"""Parts of a data set: its header, and for each sequence the body, the garment and the frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

import drape
from drape.data.schema import GARMENTS, VERSIONS


@dataclass(frozen=True, eq=False)
class Header:
    """Everything in a file that is not a body, a garment or a sequence."""

    source: str
    """Program that made the frames: ``blender 5.0.1``, ``cloth3d``, ``vto``, ``recorded``."""
    fps: float
    """Frames per second [1/s]."""
    gravity: tuple[float, float, float]
    """Acceleration really applied [m/s²]."""
    materials: Mapping[str, Mapping[str, float | int | str]]
    """Fabric name to Blender settings and ``mass_per_vertex`` [kg]."""
    config: str
    """The configuration as YAML."""
    seed: int = 0
    format: str = GARMENTS
    """One of ``schema.VERSIONS``."""

    @property
    def attributes(self) -> dict[str, object]:
        """Of the file; of sheets ``source`` has another name."""
        return {
            "format": self.format,
            "schema_version": VERSIONS[self.format],
            "drape_version": drape.__version__,
            "source": self.source,
            "seed": self.seed,
            "fps": float(self.fps),
            "dt": 1.0 / self.fps,
            "gravity": np.asarray(self.gravity, np.float64),
            "up_axis": "z",
            "fabrics": list(self.materials),
            "config": self.config,
        }


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
    """Origin of it; plain values."""


@dataclass(frozen=True, eq=False)
class StoredGarment:
    """A garment, or a sheet of cloth, as it goes into a file."""

    kind: str
    body: str
    """In whose rest pose it was made; empty without one."""
    rest_positions: Float[np.ndarray, "vertices 3"]
    """[m]"""
    faces: Int[np.ndarray, "faces 3"]
    pinned: Int[np.ndarray, " pinned"] = field(default_factory=lambda: np.zeros(0, np.int64))
    mass: Float[np.ndarray, " vertices"] | None = None
    """Of each vertex [kg], where it is not the sequence's ``mass_per_vertex``."""
    bones: Int[np.ndarray, "vertices 4"] | None = None
    weights: Float[np.ndarray, "vertices 4"] | None = None
    style: Mapping[str, object] = field(default_factory=dict)
    """Origin of it; plain values."""


@dataclass(frozen=True, eq=False)
class StoredSequence:
    """A sequence as it goes into a file; on a body exactly one of ``transforms`` and ``body_positions``.

    Without ``positions`` it is a motion, to be animated; then ``garment`` and ``fabric`` may be empty.
    """

    name: str
    """``00000``, ...; sequences are read in the order of their names."""
    body: str
    """Empty: a sheet."""
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
    """From the body's rest pose."""
    body_positions: Float[np.ndarray, "frames body_vertices 3"] | None = None
    """[m]"""
    twin: Float[np.ndarray, "frames vertices 3"] | None = None
    """The same simulation, started 1e-6 m to the side [m]."""


class Part(NamedTuple):
    """All that a sequence brings to a data set; body and garment go by the names that the sequence gives them."""

    body: StoredBody | None
    """None: a sheet."""
    garment: StoredGarment | None
    """None: the motion of a body alone."""
    sequence: StoredSequence

