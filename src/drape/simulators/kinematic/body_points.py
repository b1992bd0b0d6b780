"""The points of the body that cloth is about to touch: where a graph network meets the body."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Bool, Float, Int
from torch import Tensor

from drape.energy.step import Step


@dataclass(frozen=True, eq=False)
class BodyPoints:
    """The closest point of the body to each vertex near it, moving with its face; so any body mesh will do."""

    vertices: Int[Tensor, " near"]
    x: Float[Tensor, "near 3"]
    """The points at t [m]."""
    x_next: Float[Tensor, "near 3"]
    """The same points of the body at t + dt [m]."""
    velocity: Float[Tensor, "near 3"]
    """[m/s]"""
    normal: Float[Tensor, "near 3"]
    """Of the face at t + dt."""
    distance: Float[Tensor, " near"]
    """Of the vertex at t [m]; negative inside the body."""
    there: Bool[Tensor, " near"] | None = None
    """Those that count; None: all. See :func:`drape.geometry.fixed_size.is_fixed`."""

    @classmethod
    def of(cls, step: Step, reach: float) -> BodyPoints:
        """Of vertices inside the body or up to ``reach`` [m] away."""
        near, body = step.near_vertices(reach), step.body
        corners = body.x[body.faces[near.faces]]
        x, x_next = (near.barycentric[..., None] * corners).sum(1), near.end.point
        velocity = (x_next - x) / step.dt
        return cls(near.points, x, x_next, velocity, near.end.normal, near.distance, near.there)
