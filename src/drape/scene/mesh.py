"""Rest positions and topology of a cloth, checked once and immutable afterwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from drape.errors import DrapeError


@dataclass(frozen=True, eq=False)
class ClothMesh:
    """A triangle mesh in its rest state; build it with :meth:`from_faces`.

    Edges are unique and undirected, stored as (smaller, larger) vertex index and sorted. ``edge_faces`` holds the
    two faces of an edge, first the one that runs along it forwards; a boundary edge lists its only face twice
    (``boundary`` tells them apart).
    """

    rest_positions: Float[np.ndarray, "vertices 3"]
    """Rest positions [m]."""
    faces: Int[np.ndarray, "faces 3"]
    edges: Int[np.ndarray, "edges 2"]
    edge_faces: Int[np.ndarray, "edges 2"]
    edge_opposite: Int[np.ndarray, "edges 2"]
    """The vertex opposite to the edge in each of its two faces."""
    boundary: Bool[np.ndarray, " edges"]

    @property
    def num_vertices(self) -> int:
        return len(self.rest_positions)

    @property
    def num_edges(self) -> int:
        return len(self.edges)

    @property
    def num_faces(self) -> int:
        return len(self.faces)

    @property
    def rest_lengths(self) -> Float[np.ndarray, " edges"]:
        """Rest length of each edge [m]."""
        ends = self.rest_positions[self.edges].astype(np.float64)
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)

    @classmethod
    def from_faces(
        cls, rest_positions: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], name: str = "mesh"
    ) -> ClothMesh:
        """Validate a triangle mesh and derive its edges.

        Raises:
            DrapeError: non-finite or duplicate rest positions, indices out of range, unused vertices, degenerate or
                duplicate faces, edges with more than two faces, or inconsistent winding. ``name`` opens the sentence.
        """
        rest_positions = np.ascontiguousarray(rest_positions)
        faces = np.ascontiguousarray(faces, dtype=np.int64)
        _check_vertices(rest_positions, faces, name)
        _check_faces(rest_positions, faces, name)
        edges, edge_faces, edge_opposite, boundary = _edges(faces, name)
        arrays = (rest_positions, faces, edges, edge_faces, edge_opposite, boundary)
        for array in arrays:
            array.setflags(write=False)
        return cls(*arrays)


def _check_vertices(positions: np.ndarray, faces: np.ndarray, name: str) -> None:
    count = len(positions)
    if not np.isfinite(positions).all():
        bad = int(np.flatnonzero(~np.isfinite(positions).all(axis=1))[0])
        raise DrapeError(f"{name}: vertex {bad} is at {positions[bad]}; expected finite rest positions")
    if len(faces) == 0:
        raise DrapeError(f"{name}: found no faces; expected a triangle mesh; export its faces, too")
    if faces.min() < 0 or faces.max() >= count:
        raise DrapeError(f"{name}: faces index {faces.min()}..{faces.max()}, expected 0..{count - 1}")
    unused = np.setdiff1d(np.arange(count), faces)
    if len(unused):
        raise DrapeError(f"{name}: {len(unused)} vertices belong to no face (first: {unused[0]}); remove them")
    _, first, repeats = np.unique(positions, axis=0, return_index=True, return_counts=True)
    if (repeats > 1).any():
        where = int(first[repeats > 1][0])
        raise DrapeError(f"{name}: {int((repeats - 1).sum())} duplicate vertices (one is {where}); merge them")


def _check_faces(positions: np.ndarray, faces: np.ndarray, name: str) -> None:
    corners = positions[faces].astype(np.float64)
    sides = corners - np.roll(corners, 1, axis=1)
    double_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    flat = double_area <= 1e-9 * (sides**2).sum(axis=(1, 2))
    if flat.any():
        where = int(np.flatnonzero(flat)[0])
        raise DrapeError(
            f"{name}: {int(flat.sum())} faces have no area (first: {where}, vertices {faces[where].tolist()}); "
            "remove them or merge their vertices"
        )
    _, repeats = np.unique(np.sort(faces, axis=1), axis=0, return_counts=True)
    if (repeats > 1).any():
        raise DrapeError(f"{name}: {int((repeats - 1).sum())} faces stand twice; remove the copies")


def _edges(faces: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    face_of = np.tile(np.arange(len(faces)), 3)
    opposite_of = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    if len(np.unique(directed, axis=0)) != len(directed):
        counted = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
        many = counted[0][counted[1] > 2]
        if len(many):
            raise DrapeError(
                f"{name}: {len(many)} edges have more than two faces (one is {many[0].tolist()}); split them"
            )
        raise DrapeError(f"{name}: neighbouring faces wind in opposite directions; orient all faces consistently")
    undirected = np.sort(directed, axis=1)
    edges, inverse, counts = np.unique(undirected, axis=0, return_inverse=True, return_counts=True)
    runs_backwards = directed[:, 0] > directed[:, 1]
    order = np.lexsort((runs_backwards, inverse.reshape(-1)))  # first the face along which the edge runs forwards
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    slots = order[np.stack([first, first + counts - 1], axis=1)]
    return edges, face_of[slots], opposite_of[slots], counts == 1
