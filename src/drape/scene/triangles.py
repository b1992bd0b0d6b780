"""Closest points on triangles."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.scene.corners import cross, dot


def closest_on_triangles(
    point: Float[Tensor, "3 pairs"], corners: Float[Tensor, "3 3 pairs"]
) -> tuple[Float[Tensor, "3 pairs"], Float[Tensor, " pairs"]]:
    """Barycentric coordinates of the point of each triangle closest to its ``point``, and the distance.

    The closest of four: the foot on the plane where it lies inside, and the closest point of each side. Correct for
    triangles without area as well: what is left of them are their sides. Coordinates are exactly 0 on sides.
    """
    tiny = torch.finfo(point.dtype).tiny
    feet = [_foot_on_plane(point, corners)]
    for start, end in ((0, 1), (1, 2), (2, 0)):
        side = corners[end] - corners[start]
        along = dot(point - corners[start], side) / dot(side, side).clamp(min=tiny)
        weight = along.clamp(0.0, 1.0)
        foot = torch.zeros_like(point)
        foot[start], foot[end] = 1.0 - weight, weight
        feet.append(foot)
    squares = torch.stack([dot(_at(foot, corners) - point, _at(foot, corners) - point) for foot in feet])
    inside = (feet[0] > 0.0).all(0)
    squares[0] = squares[0].masked_fill(~inside, torch.inf)
    square, best = squares.min(0)
    chosen = torch.stack(feet).gather(0, best.expand(1, 3, -1))[0]
    return chosen, square.sqrt()


def _at(barycentric: Float[Tensor, "3 pairs"], corners: Float[Tensor, "3 3 pairs"]) -> Float[Tensor, "3 pairs"]:
    return (barycentric[:, None] * corners).sum(0)


def _foot_on_plane(point: Float[Tensor, "3 pairs"], corners: Float[Tensor, "3 3 pairs"]) -> Float[Tensor, "3 pairs"]:
    """Barycentric coordinates of the foot on the plane of the triangle; (0, 0, 0) where it has no area."""
    first, second, arm = corners[1] - corners[0], corners[2] - corners[0], point - corners[0]
    normal = cross(first, second)
    square = dot(normal, normal)
    scale = torch.where(square > 0.0, 1.0 / square.clamp(min=torch.finfo(point.dtype).tiny), 0.0)
    b2 = dot(cross(first, arm), normal) * scale
    b1 = dot(cross(arm, second), normal) * scale
    return torch.stack([1.0 - b1 - b2, b1, b2]).masked_fill(scale == 0.0, 0.0)
