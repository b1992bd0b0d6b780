"""Sparse Hessians from small pieces."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy import sparse
from torch import Tensor


def from_stencils(
    vertices: Int[Tensor, "stencils corners"],
    blocks: Float[Tensor, "stencils corners 3 corners 3"],
    num_vertices: int,
) -> sparse.csr_array:
    """The sum of ``blocks`` on the coordinates of their ``vertices``, ``3 num_vertices`` square."""
    slots = 3 * vertices.cpu().numpy()[:, :, None] + np.arange(3)
    rows = np.broadcast_to(slots[:, :, :, None, None], blocks.shape)
    columns = np.broadcast_to(slots[:, None, None], blocks.shape)
    entries = blocks.detach().double().cpu().numpy().reshape(-1)
    size = 3 * num_vertices
    return sparse.coo_array((entries, (rows.reshape(-1), columns.reshape(-1))), (size, size)).tocsr()


def from_jacobian(
    jacobian: tuple[sparse.csr_array, ...], curvature: Float[Tensor, "pieces features features"]
) -> sparse.csr_array:
    """``Jᵀ C₊ J`` with C₊ the positive semi-definite part of the ``curvature`` of each piece in its features.

    ``jacobian[k]`` is ∂feature_k/∂x, a row a piece; there may be fewer of them than ``curvature`` has features.
    """
    count = len(jacobian)
    curvature = curvature[:, :count, :count].detach().double().cpu()
    values, vectors = torch.linalg.eigh(0.5 * (curvature + curvature.mT))
    roots = (vectors * values.clamp(min=0.0).sqrt()[:, None, :]).numpy()
    scaled = [
        sum(sparse.diags_array(roots[:, feature, mode]) @ jacobian[feature] for feature in range(count))
        for mode in range(count)
    ]
    stacked = sparse.vstack(scaled, format="csr")
    return (stacked.T @ stacked).tocsr()
