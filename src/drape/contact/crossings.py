"""Self-intersection of triangle meshes: where edges pass through faces, and which faces cross there."""

from __future__ import annotations

from operator import attrgetter
from typing import NamedTuple

import ipctk
import numpy as np
from jaxtyping import Float, Int
from scipy import sparse


class Hits(NamedTuple):
    """Edges that pass through the inside of a face they share no vertex with."""

    edges: Int[np.ndarray, " hits"]
    faces: Int[np.ndarray, " hits"]
    share: Float[np.ndarray, " hits"]
    """Of the way along the edge."""
    corners: Float[np.ndarray, "hits 3"]
    """Barycentric coordinates in the face."""
    places: Float[np.ndarray, "hits 3"]
    """[m]."""


class Crossings(NamedTuple):
    """Pairs of faces that cross; faces of the body are numbered after those of the cloth."""

    pairs: Int[np.ndarray, "pairs 2"]
    """Each once, the smaller number first, in ascending order."""
    places: Float[np.ndarray, "pairs 3"]
    """A point of each crossing [m]."""

    def __str__(self) -> str:
        if not len(self.pairs):
            return "no faces cross"
        place = ", ".join(f"{value:.3g}" for value in self.places[0])
        return f"{len(self.pairs)} pairs of faces cross, the first near ({place})"


def hits(mesh: ipctk.CollisionMesh, points: Float[np.ndarray, "points 3"]) -> Hits:
    """Edges through faces; faces that only touch, or lie in one plane, do not count.

    An edge passes through a face if its ends are on both sides, and its line runs past all corners one way round.
    """
    search = ipctk.LBVH()
    search.can_vertices_collide = mesh.can_collide
    search.build(points, mesh.edges, mesh.faces)
    found = search.detect_edge_face_candidates()
    ids = np.array(list(map(attrgetter("edge_id", "face_id"), found)), np.int64).reshape(-1, 2)
    a, b = np.moveaxis(points[mesh.edges[ids[:, 0]]], 1, 0)
    corners = points[mesh.faces[ids[:, 1]]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    below, above = (np.einsum("pi,pi->p", normal, end - corners[:, 0]) for end in (a, b))
    passed = np.flatnonzero(below * above < 0)  # few are left, so that the rest costs nothing
    arms = corners[passed] - a[passed, None]
    turns = np.einsum("pki,pi->pk", np.cross(np.roll(arms, -1, 1), np.roll(arms, -2, 1)), (b - a)[passed])
    inside = (turns > 0).all(axis=1) | (turns < 0).all(axis=1)
    passed, turns = passed[inside], turns[inside]
    share = below[passed] / (below[passed] - above[passed])
    places = a[passed] + share[:, None] * (b - a)[passed]
    return Hits(ids[passed, 0], ids[passed, 1], share, turns / turns.sum(axis=1, keepdims=True), places)


def crossings(mesh: ipctk.CollisionMesh, found: Hits) -> Crossings:
    """The faces at the edges of ``found`` with the faces those pass through."""
    rows, columns = mesh.faces_to_edges.ravel(), np.repeat(np.arange(len(mesh.faces)), 3)
    at_edge = sparse.csr_array((np.ones(len(rows), bool), (rows, columns)), shape=(len(mesh.edges), len(mesh.faces)))
    hit, face = at_edge[found.edges].nonzero() if len(found.edges) else (np.empty(0, np.int64),) * 2
    pairs = np.sort(np.stack([face, found.faces[hit]], axis=1), axis=1)
    pairs, first = np.unique(pairs, axis=0, return_index=True)
    return Crossings(pairs.astype(np.int64), found.places[hit[first]])
