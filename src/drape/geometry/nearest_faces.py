"""The face of the body that is nearest to each point of the cloth: exact, on the side where the point is."""

from __future__ import annotations

from collections.abc import MutableMapping
from dataclasses import dataclass, fields, replace
from math import pi
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from drape.geometry.corners import cross, dot
from drape.geometry.face_tree import closest_of_tree, frames, halved, sided
from drape.geometry.fixed_size import is_fixed
from drape.geometry.mesh_distances import Pairs, closest_faces, gathered
from drape.geometry.triangles import closest_on_triangles

TIE = 1e-7
"""Faces count as equally near where distances differ by less than this share of the size of a face."""
GAP = 10.0
"""Sizes of the largest cloth or body by which those of different meshes are moved apart for the search."""
DEPTH = 0.2
"""Largest depth inside a body [m]; farther behind a face, and than is asked for, is behind a surface."""
FLAT = 1e-9
"""A face of the body whose double area is below this share of its squared size has no side and is left out."""


class Frame(NamedTuple):
    """A point on a face and the orthonormal axes of the face there; axes are 0 where the face has no area."""

    point: Float[Tensor, "near 3"]
    tangents: Float[Tensor, "near 2 3"]
    normal: Float[Tensor, "near 3"]


@dataclass(frozen=True, eq=False)
class NearestFaces:
    """Points of the cloth at the start of a step, and the face of the body that each is nearest to."""

    points: Int[Tensor, " near"]
    """Rows of what was searched for, each at most once, in ascending order."""
    faces: Int[Tensor, " near"]
    barycentric: Float[Tensor, "near 3"]
    """Of the closest point on the face."""
    distance: Float[Tensor, " near"]
    """To the closest point [m]; negative inside the body."""
    along: Float[Tensor, "near 2"]
    """Offset of the point from the closest one along the tangents of the face at t [m]; 0 except at edges."""
    height: Float[Tensor, " near"]
    """Offset of the point from the closest one along the normal of the face at t [m]."""
    end: Frame
    """The closest point of the body at t + dt."""
    there: Bool[Tensor, " near"] | None = None
    """The rows that count; None: all. Where :func:`is_fixed` others are kept."""

    @classmethod
    def find(
        cls,
        x: Float[Tensor, "points 3"],
        mesh_of_point: Int[Tensor, " points"],
        faces: Int[Tensor, "faces 3"],
        mesh_of_face: Int[Tensor, " faces"],
        body: Float[Tensor, "body_vertices 3"],
        body_next: Float[Tensor, "body_vertices 3"],
    ) -> NearestFaces:
        """For each row of ``x`` the nearest face of its own ``body``; no graph. All rows, unless there is no face.

        Inside or outside is told by the mean of the normals of all faces that share the closest point, weighted
        by their angles there (Baerentzen and Aanaes 2005), so corners and edges have the right side; of those
        faces the one is taken that faces the point most directly on this side. Searched in float64. Faces share a
        point where they share vertices: see :attr:`drape.scene.obstacle.Obstacle.welded_faces`.
        """
        with torch.no_grad():
            points, corners, all_faces = x.double(), body.double()[faces], faces
            kept = _with_area(corners)
            if len(kept) < len(faces):
                faces, mesh_of_face, corners = faces[kept], mesh_of_face[kept], corners[kept]
            if x.device.type == "cpu":
                near = _by_tree(points, mesh_of_point, corners, mesh_of_face, faces, all_faces)
            else:
                near = _choose(closest_faces(points, mesh_of_point, corners, mesh_of_face), points, corners)
            start = _frame(corners[near.face], near.barycentric)
            arm = points[near.point] - start.point
            along, height = (start.tangents * arm[:, None]).sum(-1), (start.normal * arm).sum(-1)
            parts = (part.to(x.dtype) for part in (near.barycentric, near.distance, along, height))
            barycentric, distance, along, height = parts
            found = cls(near.point, kept[near.face], barycentric, distance, along, height, start)
            return found.until(all_faces, body_next)

    def until(self, faces: Int[Tensor, "faces 3"], body_next: Float[Tensor, "body_vertices 3"]) -> NearestFaces:
        """The same for a step at whose end the body is at ``body_next`` [m]."""
        end = _frame(body_next.double()[faces[self.faces]], self.barycentric.double())
        return replace(self, end=Frame(*(part.to(self.distance.dtype) for part in end)))

    def to(self, dtype: torch.dtype) -> NearestFaces:
        """In another precision."""
        changed = {name: getattr(self, name).to(dtype) for name in ("barycentric", "distance", "along", "height")}
        return replace(self, **changed, end=Frame(*(part.to(dtype) for part in self.end)))

    def within(self, reach: float, first: int | None = None) -> NearestFaces:
        """Those at most ``reach`` [m] from the body, or inside it; of the ``first`` so many points only."""
        near = self
        if first is not None and is_fixed(self.points.device):  # in ascending order: no later row is one of them
            near = self.chosen(slice(first))
        counts = (near.distance <= reach) & (near.distance >= -max(reach, DEPTH))
        if first is not None:
            counts &= near.points < first
        return near.where(counts)

    def where(self, chosen: Bool[Tensor, " near"]) -> NearestFaces:
        """Some of them: fewer rows, or as many of which some do not count, see :func:`is_fixed`."""
        if not is_fixed(chosen.device):
            return self.chosen(chosen.nonzero()[:, 0])
        return replace(self, there=chosen if self.there is None else chosen & self.there)

    def joined(self, other: NearestFaces) -> NearestFaces:
        """Both, the other's after these."""
        parts = {name: torch.cat([part, getattr(other, name)]) for name, part in self._rows().items()}
        return NearestFaces(**parts, end=Frame(*(torch.cat(pair) for pair in zip(self.end, other.end, strict=True))))

    def chosen(self, rows: Int[Tensor, " chosen"] | slice) -> NearestFaces:
        """Some of them."""
        parts = {name: part[rows] for name, part in self._rows().items()}
        return NearestFaces(**parts, end=Frame(*(part[rows] for part in self.end)))

    def _rows(self) -> dict[str, Tensor]:
        parts = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "end"}
        return {name: part for name, part in parts.items() if part is not None}


_ORDERS: MutableMapping[Tensor, np.ndarray] = WeakIdKeyDictionary()
"""Of the faces of a body in a tree. Bodies bend and go on, so what is near in one frame mostly is so in the next."""


class _Near(NamedTuple):
    point: Int[Tensor, " near"]
    face: Int[Tensor, " near"]
    barycentric: Float[Tensor, "near 3"]
    distance: Float[Tensor, " near"]


def _with_area(corners: Float[Tensor, "faces 3 3"]) -> Int[Tensor, " kept"]:
    a, b, c = corners.permute(1, 2, 0).contiguous()
    first, second, third = b - a, c - b, a - c
    normal = cross(first, second)
    squares = dot(first, first) + dot(second, second) + dot(third, third)
    return (dot(normal, normal).sqrt() > FLAT * squares).nonzero()[:, 0]


def _by_tree(
    points: Float[Tensor, "points 3"],
    mesh_of_point: Int[Tensor, " points"],
    corners: Float[Tensor, "faces 3 3"],
    mesh_of_face: Int[Tensor, " faces"],
    faces: Int[Tensor, "faces 3"],
    all_faces: Int[Tensor, "all_faces 3"],
) -> _Near:
    """On the CPU; those of different meshes are moved apart for the search."""
    point, place, target = torch.arange(len(points)), points, corners
    if not len(points) or not len(faces):
        return _Near(point[:0], point[:0], points.new_empty(0, 3), points.new_empty(0))
    if int(torch.maximum(mesh_of_point.max(), mesh_of_face.max())) > 0:
        point = torch.isin(mesh_of_point, mesh_of_face).nonzero()[:, 0]
        both = torch.cat([points, corners.reshape(-1, 3)])
        along = GAP * (both.amax(0) - both.amin(0)).amax() * torch.tensor([1.0, 0.0, 0.0], dtype=points.dtype)
        place, target = (points + mesh_of_point[:, None] * along)[point], corners + mesh_of_face[:, None, None] * along
    known = place.contiguous().numpy(), target.contiguous().numpy()
    order = _ORDERS.get(all_faces)
    if order is None or len(order) != len(faces):
        order = _ORDERS[all_faces] = halved(known[1])
    closest = torch.from_numpy(closest_of_tree(*known, order))
    if not bool((closest >= 0).all()):  # of what is not a number
        point, closest = point[closest >= 0], closest[closest >= 0]
    given = points[point].numpy(), corners.contiguous().numpy(), faces.contiguous().numpy(), closest.numpy()
    found = sided(*given, int(faces.max()) + 1, TIE)
    return _Near(point, *(torch.from_numpy(part) for part in found))


def _choose(pairs: Pairs, points: Float[Tensor, "points 3"], corners: Float[Tensor, "faces 3 3"]) -> _Near:
    """Of all pairs that may be nearest the one that is, with its sign."""
    place, triangle = gathered(points, pairs.point), gathered(corners, pairs.face)
    barycentric, distance = closest_on_triangles(place, triangle)
    count = len(points)
    best = distance.new_full((count,), torch.inf).scatter_reduce(0, pairs.point, distance, "amin")
    size = (triangle - triangle.roll(1, 0)).square().sum(1).amax(0).sqrt()
    tied = (distance <= best[pairs.point] + TIE * size).nonzero()[:, 0]
    point, face = pairs.point[tied], pairs.face[tied]
    barycentric, triangle = barycentric[:, tied], triangle[..., tied]
    normal = cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    arm = place[:, tied] - (barycentric[:, None] * triangle).sum(0)
    height = dot(arm, normal) / dot(normal, normal).sqrt()
    outward = height.new_zeros(count).index_add(0, point, _angle(barycentric, triangle) * height)
    sign = torch.where(outward < 0.0, -1.0, 1.0)
    score = sign[point] * height
    highest = score.new_full((count,), -torch.inf).scatter_reduce(0, point, score, "amax")
    winners = (score == highest[point]).nonzero()[:, 0]
    first = winners.new_full((count,), len(tied)).scatter_reduce(0, point[winners], winners, "amin")
    chosen = first[first < len(tied)]
    point = point[chosen]
    return _Near(point, face[chosen], barycentric[:, chosen].T, sign[point] * best[point])


def _angle(barycentric: Float[Tensor, "3 pairs"], corners: Float[Tensor, "3 3 pairs"]) -> Float[Tensor, " pairs"]:
    """The angle that a face spans around a point of it: 2π inside, π on a side, that of the corner on a corner."""
    on_side = (barycentric == 0.0).sum(0)
    corner = barycentric.argmax(0).expand(1, 3, -1)
    apex, left, right = (corners.roll(-turn, 0).gather(0, corner)[0] for turn in range(3))
    left, right = left - apex, right - apex
    span = torch.atan2(dot(cross(left, right), cross(left, right)).sqrt(), dot(left, right))
    return torch.where(on_side == 2, span, torch.where(on_side == 1, pi, 2.0 * pi))


def _frame(corners: Float[Tensor, "near 3 3"], barycentric: Float[Tensor, "near 3"]) -> Frame:
    if corners.device.type == "cpu":
        return Frame(*(torch.from_numpy(part) for part in frames(corners.numpy(), barycentric.contiguous().numpy())))
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = torch.nn.functional.normalize(torch.linalg.cross(first, second), dim=-1, eps=1e-30)
    tangent = torch.nn.functional.normalize(first, dim=-1, eps=1e-30)
    other = torch.linalg.cross(normal, tangent)
    point = (barycentric[..., None] * corners).sum(1)
    return Frame(point, torch.stack([tangent, other], 1), normal)
