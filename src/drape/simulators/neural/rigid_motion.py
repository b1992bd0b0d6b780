"""The rigid part of a motion: what turns and travels as one."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

UNTURNED = 1e-6
"""Weight of the identity beside what is fitted, as a share of it: points on one line, or none, do not turn about it."""


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """For each mesh of a batch the rotation R and the centres c, c' that minimise ``Σ w |c' + R (x - c) - x'|²``.

    Kabsch's: the singular vectors of ``Σ w (x' - c') (x - c)ᵀ``, in float64. Exact for what moves rigidly. No graph.
    """

    rotation: Float[Tensor, "meshes 3 3"]
    centre: Float[Tensor, "meshes 3"]
    """Of the points before [m]."""
    centre_next: Float[Tensor, "meshes 3"]
    """And after the motion [m]."""

    @classmethod
    def fit(
        cls,
        x: Float[Tensor, "points 3"],
        x_next: Float[Tensor, "points 3"],
        weight: Float[Tensor, " points"],
        mesh_of: Int[Tensor, " points"],
        num_meshes: int,
    ) -> RigidMotion:
        """To points that move from ``x`` to ``x_next``; of a mesh without points the identity."""
        with torch.no_grad():
            w = weight.double()[:, None]

            def total(values: Tensor) -> Tensor:
                return values.new_zeros(num_meshes, values.shape[-1]).index_add(0, mesh_of, values)

            mass = total(w).clamp(min=torch.finfo(w.dtype).tiny)
            centre, centre_next = (total(w * p) / mass for p in (x, x_next))
            before, after = x - centre[mesh_of], x_next - centre_next[mesh_of]
            covariance = total((w * after)[:, :, None].mul(before[:, None]).flatten(1)).view(-1, 3, 3)
            spread = total(w * before.square()).sum(-1) + torch.finfo(w.dtype).tiny
            covariance = covariance + UNTURNED * spread[:, None, None] * torch.eye(3).to(covariance)
            left, _, right = torch.linalg.svd(covariance)
            handed = torch.ones_like(left[:, 0])
            handed[:, 2] = torch.linalg.det(left @ right)
            return cls((left * handed[:, None]) @ right, centre, centre_next)

    def shift(self, x: Float[Tensor, "points 3"], mesh_of: Int[Tensor, " points"]) -> Float[Tensor, "points 3"]:
        """Displacement of points at ``x`` by the motion of ``mesh_of`` [m], in their precision."""
        arm = x - self.centre[mesh_of]
        turned = (self.rotation[mesh_of] @ arm[..., None])[..., 0]
        return (turned - arm + (self.centre_next - self.centre)[mesh_of]).to(x.dtype)
