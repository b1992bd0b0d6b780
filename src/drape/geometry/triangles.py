"""Closest points on triangles."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.geometry.corners import cross, dot


def closest_on_triangles(
    point: Float[Tensor, "3 pairs"], corners: Float[Tensor, "3 3 pairs"]
) -> tuple[Float[Tensor, "3 pairs"], Float[Tensor, " pairs"]]:
    """Barycentric coordinates of the point of each triangle closest to its ``point``, and the distance.

    The closest of four: the foot on the plane where it lies inside, and the closest point of each side. Correct for
    triangles without area as well: what is left of them are their sides. Coordinates are exactly 0 on sides.
    """
    tiny = torch.finfo(point.dtype).tiny
    sides = corners.roll(-1, 0) - corners
    arms = point - corners
    along = [(dot(arms[k], sides[k]) / dot(sides[k], sides[k]).clamp(min=tiny)).clamp(0.0, 1.0) for k in range(3)]
    gaps = [arms[k] - along[k] * sides[k] for k in range(3)]
    inside, square = _foot_on_plane(arms, sides)
    square = square.masked_fill((inside <= 0.0).any(0), torch.inf)
    square, best = torch.stack([*(dot(gap, gap) for gap in gaps), square]).min(0)
    on_side = torch.stack(along).gather(0, best.clamp(max=2)[None])[0]
    foot = torch.zeros_like(point).scatter_(0, (best % 3)[None], (1.0 - on_side)[None])
    foot = foot.scatter_(0, ((best + 1) % 3)[None], on_side[None])
    return torch.where(best == 3, inside, foot), square.sqrt()


def _foot_on_plane(
    arms: Float[Tensor, "3 3 pairs"], sides: Float[Tensor, "3 3 pairs"]
) -> tuple[Float[Tensor, "3 pairs"], Float[Tensor, " pairs"]]:
    """Barycentric coordinates of the foot on the plane and its squared distance; (0, 0, 0) where there is no plane."""
    normal = cross(sides[0], sides[1])
    square = dot(normal, normal)
    scale = torch.where(square > 0.0, 1.0 / square.clamp(min=torch.finfo(square.dtype).tiny), 0.0)
    b2 = dot(cross(sides[0], arms[0]), normal) * scale
    b1 = dot(cross(sides[2], arms[2]), normal) * scale
    foot = torch.stack([1.0 - b1 - b2, b1, b2]).masked_fill(scale == 0.0, 0.0)
    return foot, dot(arms[0], normal).square() * scale
