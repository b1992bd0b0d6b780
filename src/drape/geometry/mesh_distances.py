"""All distances between points of the same cloth, and the faces that may be nearest: for devices, without a tree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

CHUNK = 2**26
"""Distances held at a time."""


class OfMeshes(NamedTuple):
    """Rows of each mesh, side by side; meshes with fewer are filled up."""

    row: Int[Tensor, "meshes most"]
    is_there: Bool[Tensor, "meshes most"]

    @classmethod
    def of(cls, mesh_of: Int[Tensor, " rows"], num_meshes: int) -> OfMeshes:
        """Of rows with the numbers of their meshes, in any order."""
        count = mesh_of.bincount(minlength=num_meshes)
        place = torch.arange(int(count.max()), device=mesh_of.device)
        first = count.cumsum(0) - count
        row = (first[:, None] + place).clamp(max=len(mesh_of) - 1)
        return cls(mesh_of.argsort(stable=True)[row], place < count[:, None])


def mesh_distances(
    points: Float[Tensor, "points 3"],
    mesh_of_point: Int[Tensor, " points"],
    targets: Float[Tensor, "targets 3"],
    mesh_of_target: Int[Tensor, " targets"],
) -> Iterator[tuple[Int[Tensor, "meshes some"], Bool[Tensor, "meshes some"], Int[Tensor, "meshes most"], Tensor]]:
    """(points, whether they are there, targets, distances between them [m]) of each mesh, some points at a time.

    Distances are of shape (meshes, some, most), from scalar products in float64: exact to 1e-8 m where coordinates are
    below 1 m; infinite to targets that are not there.
    """
    num_meshes = 1 + int(torch.maximum(mesh_of_point.max(), mesh_of_target.max()))
    of_points, of_targets = OfMeshes.of(mesh_of_point, num_meshes), OfMeshes.of(mesh_of_target, num_meshes)
    points, there = points.double(), targets.double()[of_targets.row]
    some = max(1, CHUNK // of_targets.row.numel())
    for row, is_there in zip(of_points.row.split(some, 1), of_points.is_there.split(some, 1), strict=True):
        distance = torch.cdist(points[row], there, compute_mode="use_mm_for_euclid_dist")
        yield row, is_there, of_targets.row, distance.masked_fill_(~of_targets.is_there[:, None], torch.inf)


SLACK = 1e-5
"""Share by which rounding may misjudge the distance to a centre."""


class Pairs(NamedTuple):
    """Pairs of a point and a face that may be its nearest."""

    point: Int[Tensor, " pairs"]
    face: Int[Tensor, " pairs"]


def closest_faces(
    points: Float[Tensor, "points 3"],
    mesh_of_point: Int[Tensor, " points"],
    corners: Float[Tensor, "faces 3 3"],
    mesh_of_face: Int[Tensor, " faces"],
) -> Pairs:
    """For each point all faces of its own body that may be the nearest. Points whose mesh has no face have no pair.

    The centre of a face is on it, so that the nearest face is no farther away than the nearest centre.
    """
    if not len(points) or not len(corners):
        none = torch.empty(0, dtype=torch.long, device=points.device)
        return Pairs(none, none)
    centre = corners.mean(1)
    radius = (corners - centre[:, None]).norm(dim=-1).amax(-1)
    pairs = []
    for point, is_there, face, distance in mesh_distances(points, mesh_of_point, centre, mesh_of_face):
        near = distance <= (distance.amin(-1, keepdim=True) + radius[face][:, None]) * (1.0 + SLACK)
        of_mesh, row, column = (near & is_there[..., None] & distance.isfinite()).nonzero(as_tuple=True)
        pairs.append((point[of_mesh, row], face[of_mesh, column]))
    return Pairs(*(torch.cat(part) for part in zip(*pairs, strict=True)))


def gathered(values: Float[Tensor, "all ..."], index: Int[Tensor, " chosen"]) -> Float[Tensor, "... chosen"]:
    """``values[index]`` with the chosen in the last place, contiguous."""
    flat = values.flatten(1).T.contiguous()
    return flat.index_select(1, index).view(*values.shape[1:], len(index))
