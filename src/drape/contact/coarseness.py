"""Whether skin shows through: a coarse cloth on a curved body sinks in between its points of contact.

Between points that are l apart, a cloth that is stretched over a body of radius R is a chord, and sinks in by
``l² / (8 R)``. Where this is more than the distance that contact keeps, the body shows through.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from drape.geometry.mesh import ClothMesh
from drape.geometry.normals import face_normals
from drape.scene.obstacle import Obstacle

SHARE = 0.05
"""Of the edges of the cloth, the longest ones, and of the area of the body, the most curved one, that decide."""


def too_coarse(mesh: ClothMesh, obstacle: Obstacle, per_edge: int, thickness: float) -> str | None:
    """A sentence where a cloth is too coarse for a body at frame 0, and what helps; None where it is fine enough.

    Args:
        per_edge: points of contact inside each edge of the cloth.
        thickness: distance from the body at which contact begins [m].
    """
    edge, spacing = longest_edge(mesh), point_spacing(mesh, per_edge)
    radius = least_radius(obstacle.at(0), obstacle.welded_faces)
    depth = min(spacing**2 / (8.0 * radius), spacing / 2.0)
    if depth <= thickness:
        return None
    fine = math.sqrt(8.0 * radius * thickness)
    return (
        f"contact: points of the cloth that meet the body are up to {_told(spacing)} apart (edges of {_told(edge)}, "
        f"per_edge {per_edge}), and {100 * SHARE:.0f} % of the body is curved by a radius below {_told(radius)}: found "
        f"that cloth sinks in by up to {_told(depth)} there, expected at most the thickness of the contact, "
        f"{_told(thickness)}; skin will show through. Take a mesh with edges below {_told((per_edge + 1) * fine)}, or "
        "contact=surface or ipc, which ask points of the body too, or a larger contact.thickness"
    )


def longest_edge(mesh: ClothMesh) -> float:
    """Length [m] that ``SHARE`` of the edges exceed."""
    return float(np.quantile(mesh.rest_lengths, 1.0 - SHARE))


def point_spacing(mesh: ClothMesh, per_edge: int) -> float:
    """Distance between points of contact [m] on a cloth with so many inside each edge."""
    return longest_edge(mesh) / (per_edge + 1)


def least_radius(x: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]) -> float:
    """The radius of curvature [m] that ``SHARE`` of the area is below; infinite where less than that is convex.

    Sharp edges count as curved over the faces beside them: those of a large floor, or of finely divided boxes, are
    a small share of the area or of a large radius.
    """
    curvature, area = curvatures(Turns.of(x, faces), len(x), faces)
    order = np.argsort(-curvature)
    place = np.searchsorted(np.cumsum(area[order]), SHARE * area.sum())
    highest = curvature[order[min(place, len(order) - 1)]]
    return 1.0 / highest if highest > 0 else math.inf


def curvatures(
    turns: Turns, num_vertices: int, faces: Int[np.ndarray, "faces 3"]
) -> tuple[Float[np.ndarray, " vertices"], Float[np.ndarray, " vertices"]]:
    """The larger principal curvature at each vertex [1/m], positive where convex, and the area of the vertex [m²].

    Of a mesh with these ``turns``.

    ``Σ_e ½ l_e β_e t_e t_eᵀ / A`` over the edges at a vertex, of length l, with the angle β between the normals of
    their two faces and the direction t across them on the surface (Cohen-Steiner and Morvan 2003). A is a third of
    the faces at the vertex.
    """
    each = 0.5 * (turns.length * turns.angle)[:, None, None] * turns.across[:, :, None] * turns.across[:, None, :]
    total, area = np.zeros((num_vertices, 3, 3)), np.zeros(num_vertices)
    for corner in turns.edges.T:
        np.add.at(total, corner, each)
    for corner in faces.T:
        np.add.at(area, corner, turns.face_area / 3.0)
    return np.linalg.eigvalsh(total / np.maximum(area, 1e-30)[:, None, None])[:, 2], area


class Turns(NamedTuple):
    """Edges that two faces share."""

    edges: Int[np.ndarray, "edges 2"]
    length: Float[np.ndarray, " edges"]
    """[m]"""
    angle: Float[np.ndarray, " edges"]
    """Between the normals of both faces, positive where the surface is convex."""
    across: Float[np.ndarray, "edges 3"]
    """The direction on the surface that is normal to the edge."""
    faces: Int[np.ndarray, "edges 2"]
    """The first runs along the edge as ``edges`` does."""
    face_area: Float[np.ndarray, " faces"]
    """Of all faces of the mesh [m²]."""

    @classmethod
    def of(cls, x: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]) -> Turns:
        """Of a mesh; faces without area have no edges, nor have more than two faces one where they meet."""
        normal = face_normals(x, faces)
        size = np.linalg.norm(normal, axis=1)
        has_area = np.flatnonzero(size > 1e-9 * size.max())
        unit = normal[has_area] / size[has_area, None]
        edges, first, second = _inner_edges(faces[has_area])
        along = x[edges[:, 1]] - x[edges[:, 0]]
        length = np.linalg.norm(along, axis=1)
        left, right = unit[first], unit[second]
        turn = np.einsum("ei,ei->e", np.cross(left, right), along / length[:, None])
        angle = np.arctan2(turn, np.einsum("ei,ei->e", left, right))
        across = np.cross(along, left + right)
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
        return cls(edges, length, angle, across, has_area[np.stack([first, second], 1)], 0.5 * size)


def _inner_edges(faces: Int[np.ndarray, "faces 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges of two faces as the first runs along them, that face and the other; where more meet there is no side."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    _, which, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(which.reshape(-1), kind="stable")
    first = np.cumsum(count) - count
    pairs = np.stack([order[first[count == 2]], order[first[count == 2] + 1]])
    opposite = (ends[pairs[0]] == ends[pairs[1]][:, ::-1]).all(axis=1)
    pairs = pairs[:, opposite]
    return ends[pairs[0]], pairs[0] // 3, pairs[1] // 3


def _told(length: float) -> str:
    return f"{1e3 * length:.3g} mm" if length < 0.9995 else f"{length:.3g} m"
