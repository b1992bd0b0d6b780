"""Untangling of cloth by intersection contour minimisation (Volino & Magnenat-Thalmann 2006)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse

from drape.contact.collisions import Body, Cloth, Collisions, crossings_of
from drape.contact.crossings import Crossings, Hits
from drape.contact.meeting import Meeting

STEP = 0.05
"""Length of a move of each side, as a share of the mean edge at rest."""
LENGTH_ROUNDS = 3
"""Rounds of Jacobi that give moved edges their lengths back after each move."""


def untangle(
    collisions: Collisions,
    x: Cloth,
    body: Body = None,
    *,
    held: Bool[np.ndarray, " vertices"] | None = None,
    moves: int = 100,
) -> tuple[Cloth, Crossings]:
    """Positions with fewer crossings, and the crossings that remain; ``x`` itself where nothing crosses.

    Where an edge with direction e passes through a face with normal n, it is moved against the face along

        G = Σ R - 2 (e · R) / (e · n) n,

    which shortens the contour in which the surfaces meet; R are the directions of the contour, away from the edge, in
    the one or two faces at the edge. Out of a body, whose normals look outwards, cloth moves along them; the body
    stays itself, as do vertices ``held``. Edges then get back the length they had.
    Only local tangles are resolved: contours that are long and straight, or a body deeper inside than ``moves`` steps,
    stay; what is returned is the best of at most ``moves`` moves, and the caller must look at what remains. Cloth that
    is wholly inside a body, or a layer wholly on the wrong side, crosses nothing, and is neither moved nor reported.
    """
    held = np.zeros(len(x), bool) if held is None else held
    edges = collisions.cloth.mesh.edges
    lengths = np.linalg.norm(np.subtract(*x[edges.T]), axis=1)
    step = STEP * float(np.linalg.norm(np.subtract(*collisions.cloth.mesh.rest_positions[edges.T]), axis=1).mean())
    now, best, fewest, moved = np.array(x, np.float64), np.array(x, np.float64), np.inf, np.zeros(len(x), bool)
    for _ in range(moves + 1):
        found = collisions.hits(now, body)
        count = sum(len(each.edges) for _, each in found)
        if count < fewest:
            best, fewest, remaining = now.copy(), count, found
        if not count:
            break
        parts = (_moves(*part, step)[: len(x)] for part in _placed(found, now, body))
        move = sum(parts, np.zeros_like(now))
        move[held] = 0.0
        moved |= move.any(axis=1)
        now += move
        _keep_lengths(now, edges, lengths, moved & ~held)
    return best, crossings_of(remaining)


def _placed(found: list[tuple[Meeting, Hits]], x: Cloth, body: Body) -> list[tuple[Meeting, Hits, np.ndarray]]:
    both = x if body is None else np.concatenate([x, body])
    return [(meeting, each, both[: meeting.mesh.num_vertices]) for meeting, each in found]


def _moves(meeting: Meeting, found: Hits, points: np.ndarray, step: float) -> Float[np.ndarray, "points 3"]:
    """Mean of the moves that the crossings ask of each point."""
    ends, corners = meeting.mesh.edges[found.edges], meeting.mesh.faces[found.faces]
    direction = (_outward if meeting.free < len(points) else _contour_gradient)(meeting, found, points)
    push = step * direction / np.sqrt((direction**2).sum(1, keepdims=True) + 0.01)
    shares = np.concatenate([1.0 - found.share[:, None], found.share[:, None], -found.corners], axis=1)
    ids = np.concatenate([ends, corners], axis=1)
    total, weight = np.zeros_like(points), np.full(len(points), 1e-12)
    np.add.at(total, ids, shares[:, :, None] * push[:, None])
    np.add.at(weight, ids, np.abs(shares))
    return total / weight[:, None]


def _contour_gradient(meeting: Meeting, found: Hits, points: np.ndarray) -> Float[np.ndarray, "hits 3"]:
    """G, the way of the edge against the face."""
    ends, normals = meeting.mesh.edges[found.edges], meeting.mesh.face_normals(points)
    hit, face = _faces_at(meeting, found)
    e, n = _unit(points[ends[hit, 1]] - points[ends[hit, 0]]), normals[found.faces[hit]]
    inward = points[meeting.mesh.faces[face]].mean(axis=1) - points[ends[hit, 0]]
    contour = _unit(np.cross(normals[face], n))
    inward -= (inward * e).sum(1, keepdims=True) * e
    contour *= np.sign((contour * inward).sum(1, keepdims=True))
    slope = (e * contour).sum(1) / _away_from_zero((e * n).sum(1))
    gradient = np.zeros((len(ends), 3))
    np.add.at(gradient, hit, contour - 2.0 * slope[:, None] * n)
    return gradient


def _outward(meeting: Meeting, found: Hits, points: np.ndarray) -> Float[np.ndarray, "hits 3"]:
    """The way of the edge against the face that takes the cloth out of the body."""
    normals = meeting.mesh.face_normals(points)
    hit, face = _faces_at(meeting, found)
    at_edge = np.zeros((len(found.edges), 3))
    np.add.at(at_edge, hit, normals[face])
    of_body = (meeting.mesh.faces[found.faces] >= meeting.free).all(axis=1, keepdims=True)
    return np.where(of_body, normals[found.faces], -_unit(at_edge))


def _faces_at(meeting: Meeting, found: Hits) -> tuple[np.ndarray, np.ndarray]:
    """For each hit the one or two faces at its edge: which hit, which face."""
    rows = meeting.mesh.faces_to_edges.ravel()
    shape = (meeting.mesh.num_edges, meeting.mesh.num_faces)
    at_edge = sparse.csr_array((np.ones(len(rows)), (rows, np.repeat(np.arange(shape[1]), 3))), shape=shape)
    return at_edge[found.edges].nonzero() if len(found.edges) else (np.empty(0, np.int64),) * 2


def _keep_lengths(x: Cloth, edges: np.ndarray, lengths: np.ndarray, loose: Bool[np.ndarray, " vertices"]) -> None:
    """Move loose vertices in place so that edges come near their lengths: mean of half the excess of each edge."""
    edges, lengths = (each[loose[edges].any(axis=1)] for each in (edges, lengths))
    count = np.maximum(np.bincount(edges.ravel(), minlength=len(x)), 1)
    for _ in range(LENGTH_ROUNDS):
        arm = x[edges[:, 1]] - x[edges[:, 0]]
        now = np.linalg.norm(arm, axis=1)
        excess = 0.5 * (1.0 - lengths / np.maximum(now, 1e-12))[:, None] * arm
        change = np.zeros_like(x)
        np.add.at(change, edges, np.stack([excess, -excess], axis=1))
        x += np.where(loose[:, None], change / count[:, None], 0.0)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)


def _away_from_zero(v: np.ndarray) -> np.ndarray:
    return np.where(v < 0, -1.0, 1.0) * np.maximum(np.abs(v), 0.1)
