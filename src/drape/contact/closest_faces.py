"""Which faces can be nearest to a point: libigl's tree of boxes on the CPU, all distances on a device."""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.contact.mesh_distances import mesh_distances
from drape.scene.triangles import closest_on_triangles

SLACK = 1e-5
"""Share by which rounding may misjudge the distance to a centre."""
GAP = 10.0
"""Sizes of the largest cloth or body by which those of different meshes are moved apart for the search."""


class Pairs(NamedTuple):
    """Pairs of a point and a face that may be its nearest."""

    point: Int[Tensor, " pairs"]
    face: Int[Tensor, " pairs"]


def closest_faces(
    points: Float[Tensor, "points 3"],
    mesh_of_point: Int[Tensor, " points"],
    faces: Int[Tensor, "faces 3"],
    mesh_of_face: Int[Tensor, " faces"],
    body: Float[Tensor, "body_vertices 3"],
) -> Pairs:
    """For each point a face of its own body at the smallest distance, with all that share its closest point.

    Faces share it where it lies on a side or a corner of theirs: the side on which the point is follows from all of
    them. Points whose mesh has no face have no pair.
    """
    if not len(points) or not len(faces):
        none = torch.empty(0, dtype=torch.long, device=points.device)
        return Pairs(none, none)
    if points.device.type == "cpu":
        return _by_tree(points, mesh_of_point, faces, mesh_of_face, body)
    return _by_distances(points, mesh_of_point, body[faces], mesh_of_face)


def _by_tree(points: Tensor, mesh_of_point: Tensor, faces: Tensor, mesh_of_face: Tensor, body: Tensor) -> Pairs:
    known = torch.isin(mesh_of_point, mesh_of_face).nonzero()[:, 0]
    shift = _apart(points[known], mesh_of_point[known], body, mesh_of_face)
    corners = body[faces]
    if shift is None:
        place, target, vertices = points[known], faces, body
    else:  # a vertex of the body may be a corner of faces of several meshes, so each face has corners of its own
        place = points[known] + shift[0]
        vertices = (corners + shift[1][:, None]).reshape(-1, 3)
        target = torch.arange(len(vertices)).view(-1, 3)
    tree = igl.AABB()
    arrays = vertices.numpy(), target.numpy()
    tree.init(*arrays)
    _, face, _ = tree.squared_distance(*arrays, np.ascontiguousarray(place.numpy()))
    face = torch.from_numpy(face)
    return _sharing(known, face, points[known], faces, corners)


def _apart(
    points: Tensor, mesh_of_point: Tensor, body: Tensor, mesh_of_face: Tensor
) -> tuple[Tensor, Tensor] | None:
    """Shifts of points and faces [m] after which every point is nearest to its own body; None with one mesh only."""
    last = int(torch.maximum(mesh_of_point.max(), mesh_of_face.max()))
    if last == 0:
        return None
    both = torch.cat([points, body])
    along = GAP * (both.amax(0) - both.amin(0)).amax() * torch.tensor([1.0, 0.0, 0.0], dtype=points.dtype)
    return mesh_of_point[:, None] * along, mesh_of_face[:, None] * along


def _sharing(point: Tensor, face: Tensor, x: Tensor, faces: Tensor, corners: Tensor) -> Pairs:
    """(point, face) as found, and where the closest point is on a side, all faces around one of its ends."""
    barycentric, _ = closest_on_triangles(x.T, corners[face].permute(1, 2, 0))
    on_side = (barycentric == 0.0).any(0).nonzero()[:, 0]
    end = faces[face[on_side]].gather(1, barycentric[:, on_side].argmax(0)[:, None])[:, 0]
    around = faces.reshape(-1).argsort(stable=True)  # corners of faces, vertex after vertex
    count = faces.reshape(-1).bincount()
    first = count.cumsum(0) - count
    several = count[end]
    row = torch.arange(len(end)).repeat_interleave(several)
    place = torch.arange(len(row)) - (several.cumsum(0) - several)[row] + first[end][row]
    inside = (barycentric != 0.0).all(0)
    found = torch.cat([point[inside], point[on_side[row]]]), torch.cat([face[inside], around[place] // 3])
    return Pairs(*found)


def _by_distances(points: Tensor, mesh: Tensor, corners: Tensor, mesh_of_face: Tensor) -> Pairs:
    """The centre of a face is on it, so that the nearest face is no farther away than the nearest centre."""
    centre = corners.mean(1)
    radius = (corners - centre[:, None]).norm(dim=-1).amax(-1)
    pairs = []
    for point, is_there, face, distance in mesh_distances(points, mesh, centre, mesh_of_face):
        near = distance <= (distance.amin(-1, keepdim=True) + radius[face][:, None]) * (1.0 + SLACK)
        of_mesh, row, column = (near & is_there[..., None] & distance.isfinite()).nonzero(as_tuple=True)
        pairs.append((point[of_mesh, row], face[of_mesh, column]))
    return Pairs(*(torch.cat(part) for part in zip(*pairs, strict=True)))


def gathered(values: Float[Tensor, "all ..."], index: Int[Tensor, " chosen"]) -> Float[Tensor, "... chosen"]:
    """``values[index]`` with the chosen in the last place, contiguous."""
    flat = values.flatten(1).T.contiguous()
    return flat.index_select(1, index).view(*values.shape[1:], len(index))
