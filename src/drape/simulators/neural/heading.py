"""The heading of a garment: a frame in which features do not depend on a turn about the vertical."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.geometry.mesh_batch import MeshBatch


class Heading:
    """The turn about the vertical (z) of each cloth of a batch that takes its rest positions nearest to ``x``.

    ``θ = atan2(Σ r̃ × x̃, Σ r̃ · x̃)`` over the vertices, horizontal components, each from its mean: the least-squares
    turn. What is expressed in this frame does not change when the whole scene turns, so a network that works in it is
    equivariant exactly; where the sums vanish, θ is 0. No graph.
    """

    def __init__(self, x: Float[Tensor, "vertices 3"], mesh: MeshBatch):
        with torch.no_grad():
            rest, now = (_centred(p[:, :2], mesh) for p in (mesh.rest_positions.to(x.dtype), x))
            along = mesh.sum_vertices((rest * now).sum(-1))
            across = mesh.sum_vertices(rest[:, 0] * now[:, 1] - rest[:, 1] * now[:, 0])
            angle = torch.atan2(across, along).to(x.dtype)
            c, s, zero, one = angle.cos(), angle.sin(), torch.zeros_like(angle), torch.ones_like(angle)
            self._turn = torch.stack([c, -s, zero, s, c, zero, zero, zero, one], -1).view(-1, 3, 3)

    def inward(self, vectors: Float[Tensor, "*batch 3"], mesh_of: Tensor) -> Float[Tensor, "*batch 3"]:
        """World vectors in the frames of the cloths ``mesh_of`` that they belong to."""
        return (vectors[..., None, :] @ self._turn[mesh_of]).squeeze(-2)

    def outward(self, vectors: Float[Tensor, "*batch 3"], mesh_of: Tensor) -> Float[Tensor, "*batch 3"]:
        """The inverse of :meth:`inward`."""
        return (self._turn[mesh_of] @ vectors[..., None]).squeeze(-1)


def _centred(points: Float[Tensor, "vertices 2"], mesh: MeshBatch) -> Float[Tensor, "vertices 2"]:
    count = mesh.sum_vertices(torch.ones_like(points[:, 0]))
    mean = torch.stack([mesh.sum_vertices(points[:, k]) for k in range(2)], -1) / count[:, None]
    return points - mean.to(points.dtype)[mesh.mesh_of_vertex]
