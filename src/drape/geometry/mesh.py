"""Rest positions and topology of a cloth, checked once and immutable afterwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from drape.errors import DrapeError


@dataclass(frozen=True, eq=False)
class ClothMesh:
    """A triangle mesh in its rest state; build it with :meth:`from_faces`.

    Edges are undirected, stored as (smaller, larger) vertex index and sorted. ``edge_faces`` holds the
    two faces of an edge, first the one that runs along it forwards; a boundary edge lists its only face twice
    (``boundary`` tells them apart). Where more than two faces meet, as at the seam of a pocket, an edge stands there
    once for each piece of cloth that has it.
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
                duplicate faces, or inconsistent winding. ``name`` opens the sentence.
        """
        rest_positions = np.ascontiguousarray(rest_positions)
        faces = np.ascontiguousarray(faces, dtype=np.int64)
        _check_vertices(rest_positions, faces, name)
        _check_faces(rest_positions, faces, name)
        edges, edge_faces, edge_opposite, boundary = _edges(rest_positions, faces, name)
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


def _edges(positions: np.ndarray, faces: np.ndarray, name: str) -> tuple[np.ndarray, ...]:
    """Edges, their faces, the vertices opposite to them, and which are on a boundary."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    face_of = np.tile(np.arange(len(faces)), 3)
    opposite_of = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    undirected = np.sort(directed, axis=1)
    edges, inverse, counts = np.unique(undirected, axis=0, return_inverse=True, return_counts=True)
    inverse, backwards = inverse.reshape(-1), directed[:, 0] > directed[:, 1]
    order = np.lexsort((backwards, inverse))  # first the face along which the edge runs forwards
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    slots = order[np.stack([first, first + counts - 1], axis=1)]
    if (counts == 2).any() and not (backwards[slots[counts == 2]] == [False, True]).all():
        raise DrapeError(f"{name}: neighbouring faces wind in opposite directions; orient all faces consistently")
    several = [(k, order[first[k] : first[k] + counts[k]]) for k in np.flatnonzero(counts > 2)]
    sewn = [pair for _, sides in several for pair in _sewn(positions, directed, opposite_of, backwards, sides)]
    slots = np.concatenate([slots[counts <= 2], np.array(sewn, np.int64).reshape(-1, 2)])
    order = np.argsort(inverse[slots[:, 0]], kind="stable")
    slots = slots[order]
    return edges[inverse[slots[:, 0]]], face_of[slots], opposite_of[slots], slots[:, 0] == slots[:, 1]


def _sewn(
    positions: np.ndarray, directed: np.ndarray, opposite: np.ndarray, backwards: np.ndarray, sides: np.ndarray
) -> list[tuple[int, int]]:
    """Three faces or more at an edge, as where a pocket is sewn on: pieces of cloth that share its vertices.

    Of the faces that run along the edge in opposite directions, those that go on straightest are one piece; who is left
    has its border there.
    """
    start, end = positions[directed[sides[0]]].astype(np.float64)
    along = (end - start) / np.linalg.norm(end - start)
    arms = positions[opposite[sides]].astype(np.float64) - start
    arms -= (arms @ along)[:, None] * along
    arms /= np.linalg.norm(arms, axis=1, keepdims=True)
    forth, back = np.flatnonzero(~backwards[sides]), np.flatnonzero(backwards[sides])
    straight = arms[forth] @ arms[back].T  # -1: flat
    pairs, left = [], set(range(len(sides)))
    for place in np.argsort(straight, axis=None, kind="stable"):
        one, other = forth[place // max(len(back), 1)], back[place % max(len(back), 1)]
        if {one, other} <= left:
            pairs.append((int(sides[one]), int(sides[other])))
            left -= {one, other}
    return pairs + [(int(sides[alone]), int(sides[alone])) for alone in sorted(left)]
