"""The face of the body that is nearest to each vertex of the cloth: exact, on the side where the vertex is."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.energy.near_centres import Centres, Pairs, gathered, pairs_in_reach
from drape.scene.corners import cross, dot
from drape.scene.triangles import closest_on_triangles

TIE = 1e-7
"""Faces count as equally near where distances differ by less than this share of the size of a face."""
FLAT = 1e-9
"""A face of the body whose double area is below this share of its squared size has no side and is left out."""


class Frame(NamedTuple):
    """A point on a face and the orthonormal axes of the face there; axes are 0 where the face has no area."""

    point: Float[Tensor, "near 3"]
    tangents: Float[Tensor, "near 2 3"]
    normal: Float[Tensor, "near 3"]


@dataclass(frozen=True, eq=False)
class NearestFaces:
    """The vertices near the body at the start of a step, and what each is near to."""

    vertices: Int[Tensor, " near"]
    """Each at most once, in ascending order."""
    faces: Int[Tensor, " near"]
    barycentric: Float[Tensor, "near 3"]
    """Of the closest point on the face."""
    distance: Float[Tensor, " near"]
    """To the closest point [m]; negative inside the body."""
    along: Float[Tensor, "near 2"]
    """Offset of the vertex from the closest point along the tangents of the face at t [m]; 0 except at edges."""
    height: Float[Tensor, " near"]
    """Offset of the vertex from the closest point along the normal of the face at t [m]."""
    end: Frame
    """Where the closest point of the body is at t + dt."""

    @classmethod
    def find(
        cls,
        x: Float[Tensor, "vertices 3"],
        mesh_of_vertex: Int[Tensor, " vertices"],
        faces: Int[Tensor, "faces 3"],
        mesh_of_face: Int[Tensor, " faces"],
        body: Float[Tensor, "body_vertices 3"],
        body_next: Float[Tensor, "body_vertices 3"],
        search_range: float,
    ) -> NearestFaces:
        """For each vertex of ``x`` at most ``search_range`` [m] from a face of its own ``body``; no graph.

        Inside or outside is told by the mean of the normals of all faces that share the closest point, weighted
        by their angles there (Baerentzen and Aanaes 2005), so corners and edges have the right side; of those
        faces the one is taken that faces the vertex most directly on this side. Searched in float64.
        """
        with torch.no_grad():
            points, corners = x.double(), body.double()[faces]
            kept = _with_area(corners)
            centres = Centres.of(corners[kept], mesh_of_face[kept])
            pairs = pairs_in_reach(points, mesh_of_vertex, corners[kept], centres, search_range)
            near = _choose(pairs, points, corners[kept], search_range)
            face = kept[near.face]
            chosen = faces[face]
            start, end = (_frame(place.double()[chosen], near.barycentric) for place in (body, body_next))
            arm = points[near.vertex] - start.point
            along, height = (start.tangents * arm[:, None]).sum(-1), (start.normal * arm).sum(-1)
            parts = (near.barycentric, near.distance, along, height)
            end = Frame(*(part.to(x.dtype) for part in end))
            return cls(near.vertex, face, *(part.to(x.dtype) for part in parts), end)


class _Near(NamedTuple):
    vertex: Int[Tensor, " near"]
    face: Int[Tensor, " near"]
    barycentric: Float[Tensor, "near 3"]
    distance: Float[Tensor, " near"]


def _with_area(corners: Float[Tensor, "faces 3 3"]) -> Int[Tensor, " kept"]:
    sides = corners - corners.roll(1, 1)
    double_area = torch.linalg.cross(sides[:, 0], sides[:, 1]).norm(dim=-1)
    return (double_area > FLAT * sides.square().sum((1, 2))).nonzero()[:, 0]


def _choose(
    pairs: Pairs, points: Float[Tensor, "vertices 3"], corners: Float[Tensor, "faces 3 3"], search_range: float
) -> _Near:
    """Of all pairs that may be nearest the one that is, with its sign."""
    point, triangle = gathered(points, pairs.vertex), gathered(corners, pairs.face)
    barycentric, distance = closest_on_triangles(point, triangle)
    count = len(points)
    best = distance.new_full((count,), torch.inf).scatter_reduce(0, pairs.vertex, distance, "amin")
    nearest = best[pairs.vertex]
    tied = ((distance <= nearest + TIE * pairs.radius) & (nearest <= search_range)).nonzero()[:, 0]
    vertex, face = pairs.vertex[tied], pairs.face[tied]
    barycentric, triangle = barycentric[:, tied], triangle[..., tied]
    normal = cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    arm = point[:, tied] - (barycentric[:, None] * triangle).sum(0)
    height = dot(arm, normal) / dot(normal, normal).sqrt()
    outward = height.new_zeros(count).index_add(0, vertex, _angle(barycentric, triangle) * height)
    sign = torch.where(outward < 0.0, -1.0, 1.0)
    score = sign[vertex] * height
    highest = score.new_full((count,), -torch.inf).scatter_reduce(0, vertex, score, "amax")
    winners = (score == highest[vertex]).nonzero()[:, 0]
    first = winners.new_full((count,), len(tied)).scatter_reduce(0, vertex[winners], winners, "amin")
    chosen = first[first < len(tied)]
    vertex = vertex[chosen]
    return _Near(vertex, face[chosen], barycentric[:, chosen].T, sign[vertex] * best[vertex])


def _angle(barycentric: Float[Tensor, "3 pairs"], corners: Float[Tensor, "3 3 pairs"]) -> Float[Tensor, " pairs"]:
    """The angle that a face spans around a point of it: 2π inside, π on a side, that of the corner on a corner."""
    on_side = (barycentric == 0.0).sum(0)
    corner = barycentric.argmax(0).expand(1, 3, -1)
    apex, left, right = (corners.roll(-turn, 0).gather(0, corner)[0] for turn in range(3))
    left, right = left - apex, right - apex
    span = torch.atan2(dot(cross(left, right), cross(left, right)).sqrt(), dot(left, right))
    return torch.where(on_side == 2, span, torch.where(on_side == 1, pi, 2.0 * pi))


def _frame(corners: Float[Tensor, "near 3 3"], barycentric: Float[Tensor, "near 3"]) -> Frame:
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = torch.nn.functional.normalize(torch.linalg.cross(first, second), dim=-1, eps=1e-30)
    tangent = torch.nn.functional.normalize(first, dim=-1, eps=1e-30)
    other = torch.linalg.cross(normal, tangent)
    point = (barycentric[..., None] * corners).sum(1)
    return Frame(point, torch.stack([tangent, other], 1), normal)
