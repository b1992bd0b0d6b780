"""Two plain records: the contents of a mesh file, and the triangles made of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class Polygons:
    """Faces with any number of corners: those of polygon k follow those of polygon k - 1."""

    corners: Int[np.ndarray, " corners"]
    """The vertex at each corner."""
    sizes: Int[np.ndarray, " polygons"]
    """Number of corners of each polygon."""

    @classmethod
    def of_faces(cls, faces: Int[np.ndarray, "faces sides"]) -> Polygons:
        """All with the same number of corners."""
        faces = np.asarray(faces, np.int64)
        return cls(faces.reshape(-1), np.full(len(faces), faces.shape[1], np.int64))

    @property
    def starts(self) -> Int[np.ndarray, " polygons"]:
        """The first corner of each polygon."""
        return np.cumsum(self.sizes) - self.sizes

    def same_as(self, other: Polygons) -> bool:
        """The same polygons in the same order."""
        return np.array_equal(self.sizes, other.sizes) and np.array_equal(self.corners, other.corners)


@dataclass(frozen=True, eq=False)
class MeshFile:
    """The meshes of a file as one, as they stand there: polygons, order of vertices, unit, axes, texture, frames."""

    path: Path
    polygons: Polygons
    positions: Float[np.ndarray, "frames file_vertices 3"]
    """In the unit and the axes of the file."""
    fps: float | None = None
    """Frames per second; None where the file does not say."""
    first: int = 0
    """Number of the first frame."""
    unit: float | None = None
    """Metres per unit; None where the file does not say."""
    up: str | None = None
    """``y`` or ``z``; None where the file does not say."""
    usual: str = "z"
    """Up axis where neither the file nor anybody says."""
    uv: Float[np.ndarray, "corners 2"] | None = None
    """Texture coordinates of each corner, NaN where it has none; None where no corner has."""
    materials: tuple[str, ...] = ()
    material: Int[np.ndarray, " polygons"] | None = None
    """Index into ``materials`` of each polygon, -1 for none."""
    objects: tuple[tuple[str, ...], ...] = ()
    """Of each object that the file names: the groups that it stands in, and its own name last."""
    object: Int[np.ndarray, " polygons"] | None = None
    """Index into ``objects`` of each polygon."""
    said: tuple[str, ...] = ()
    """Remarks of reading beyond the meshes, such as which clip was taken."""


@dataclass(frozen=True, eq=False)
class FileForm:
    """Form of a simulated mesh in its file, so that it can be written as it came in."""

    vertex: Int[np.ndarray, " file_vertices"]
    """Vertex that each one of the file has become; -1 where it belongs to no face."""
    placed: Float[np.ndarray, "file_vertices 3"]
    """Positions in the file [m], +z up: where those stay that belong to no face."""
    polygons: Polygons
    scale: float
    """Metres per unit of the file, with what the scene is enlarged by."""
    up: str
    """Axis of the file that points up, ``y`` or ``z``."""
    first: int
    """Number of the first frame."""
    uv: Float[np.ndarray, "corners 2"] | None = None
    materials: tuple[str, ...] = ()
    material: Int[np.ndarray, " polygons"] | None = None

    def spread(self, x: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "file_vertices 3"]:
        """Positions [m], +z up, of the vertices of the file."""
        return np.where((self.vertex >= 0)[:, None], x[self.vertex], self.placed)

    def in_file(self, x: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "file_vertices 3"]:
        """Positions of the vertices of the file, in its unit and axes."""
        spread = self.spread(x) / self.scale
        return np.stack([spread[:, 0], spread[:, 2], -spread[:, 1]], axis=1) if self.up == "y" else spread


@dataclass(frozen=True, eq=False)
class ReadMesh:
    """Triangles in metres with +z up, made of a :class:`MeshFile`; ``changes`` counts what was changed."""

    source: MeshFile
    positions: Float[np.ndarray, "frames vertices 3"]
    """[m]"""
    faces: Int[np.ndarray, "faces 3"]
    form: FileForm
    parts: int
    """Pieces that touch nowhere."""
    changes: Mapping[str, int] = field(default_factory=dict)
    """Numbers of changes by their names: ``{"copies of vertices merged": 12}``."""
    shells: tuple[str, ...] = ()
    """Remarks on surfaces that were inside out, one entry each."""

    @property
    def in_order(self) -> Int[np.ndarray, " vertices"]:
        """The vertex of the file that each one is: the first, where several have become one."""
        used = np.flatnonzero(self.form.vertex >= 0)
        return used[np.unique(self.form.vertex[used], return_index=True)[1]]

    def summary(self, what: str) -> str:
        """One line on what was read and changed; ``what`` it is opens it."""
        size = " x ".join(f"{side:.3g}" for side in np.ptp(self.positions[0], axis=0))
        seen = [f"{self.source.path.name}, {size} m", f"{len(self.positions[0])} vertices", f"{len(self.faces)} faces"]
        seen.append("1 part" if self.parts == 1 else f"{self.parts} parts that touch nowhere")
        if len(self.positions) > 1:
            rate = "" if self.source.fps is None else f" at {self.source.fps:g} per second"
            seen.append(f"{len(self.positions)} frames{rate}")
        changed = [f"{words}: {count}" for words, count in self.changes.items() if count]
        return f"{what}: " + "; ".join([", ".join(seen), *changed, *self.shells, *self.source.said])
