"""Sparse Hessians from small pieces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy import sparse
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary


class _Pattern(NamedTuple):
    """Where the entries of the blocks of some stencils stand in the data of a sparse matrix."""

    place: Int[Tensor, " entries"]
    indices: np.ndarray
    indptr: np.ndarray

    @classmethod
    def of(cls, vertices: Int[Tensor, "stencils corners"], num_vertices: int) -> _Pattern:
        slots = 3 * vertices.cpu().T[:, None] + torch.arange(3)[:, None]
        shape = (*slots.shape[:2], *slots.shape)
        size = 3 * num_vertices
        keys = (slots[:, :, None, None] * size + slots).expand(shape).reshape(-1)
        found, place = torch.unique(keys, return_inverse=True)
        counts = torch.bincount(found // size, minlength=size)
        indptr = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
        return cls(place, (found % size).int().numpy(), indptr.int().numpy())


_patterns: WeakTensorKeyDictionary = WeakTensorKeyDictionary()
"""Found once for each tensor of vertices, as long as it lives: finding it costs several times what filling it does."""


def from_stencils(
    vertices: Int[Tensor, "stencils corners"],
    blocks: Float[Tensor, "stencils corners 3 corners 3"],
    num_vertices: int,
) -> sparse.csr_array:
    """The sum of ``blocks`` on the coordinates of their ``vertices``, ``3 num_vertices`` square."""
    if vertices.shape[1] == 1:
        return _block_diagonal(vertices[:, 0], blocks[:, 0, :, 0], num_vertices)
    if vertices not in _patterns:
        _patterns[vertices] = _Pattern.of(vertices, num_vertices)
    pattern, size = _patterns[vertices], 3 * num_vertices
    entries = blocks.detach().double().cpu().permute(1, 2, 3, 4, 0).reshape(-1)
    data = entries.new_zeros(len(pattern.indices)).scatter_add_(0, pattern.place, entries)
    return sparse.csr_array((data.numpy(), pattern.indices, pattern.indptr), (size, size))


def _block_diagonal(
    vertices: Int[Tensor, " stencils"], blocks: Float[Tensor, "stencils 3 3"], num_vertices: int
) -> sparse.csr_array:
    """All blocks are there, whichever vertices they are of: as contacts come and go, the places of entries stay."""
    entries = blocks.detach().double().cpu()
    data = entries.new_zeros(num_vertices, 3, 3).index_add_(0, vertices.cpu(), entries)
    rows = np.arange(num_vertices + 1)
    return sparse.bsr_array((data.numpy(), rows[:-1], rows), (3 * num_vertices,) * 2).tocsr()


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
