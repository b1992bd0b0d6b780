"""Candidates for the nearest face to a point, on a device: from all distances."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.geometry.mesh_distances import mesh_distances

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
