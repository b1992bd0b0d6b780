"""Sparse Hessians from small pieces; symmetric, so only their upper triangles are kept."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy import sparse
from torch import Tensor

Piece = tuple[Int[Tensor, "_ _"], Float[Tensor, "_ _ 3 _ 3"]]
"""``stencils corners`` vertices, and the ``stencils corners 3 corners 3`` blocks on their coordinates."""


class Filled(NamedTuple):
    """Stencils that add their entries to a matrix themselves."""

    vertices: Int[Tensor, "stencils corners"]
    add: Callable[[np.ndarray, np.ndarray], None]
    """Given the data of the matrix, and where in it each pair of coordinates of each stencil stands: the upper triangle
    of a block row by row, ``stencils pairs``."""


class _Pattern(NamedTuple):
    """Places of the entries of some stencils in the data of the upper triangle of a sparse matrix."""

    places: list[Tensor]
    """Of each set of stencils, ``entries``; of those that add themselves ``stencils pairs``, side by side in memory."""
    diagonal: Int[Tensor, "vertices pairs"]
    """Of the block of each vertex on the diagonal; all are there, whichever vertices stencils are of."""
    matrix: sparse.csr_array
    """Of zeros: what is made from it shares the places of the entries, and need not check them."""

    @classmethod
    def of(cls, pieces: Sequence[Piece | Filled], num_vertices: int) -> _Pattern:
        size = 3 * num_vertices
        keys = [_keys(some, size) for some in (*(piece[0] for piece in pieces), torch.arange(num_vertices)[:, None])]
        found, place = torch.unique(torch.cat([some.reshape(-1) for some in keys]), return_inverse=True)
        counts = torch.bincount(found // size, minlength=size)
        indptr = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
        *places, diagonal = place.split([some.numel() for some in keys])
        for k, piece in enumerate(pieces):
            if isinstance(piece, Filled):
                places[k] = places[k].int().view(-1, len(piece.vertices)).T.contiguous()
        entries = np.zeros(len(found)), (found % size).int().numpy(), indptr.int().numpy()
        matrix = sparse.csr_array(entries, (size, size))
        matrix.sort_indices()  # they are, but this is what remembers it
        return cls(places, diagonal.view(-1, num_vertices).T, matrix)

    def filled(self, data: Float[np.ndarray, " entries"]) -> sparse.csr_array:
        """The matrix with these entries."""
        matrix = copy.copy(self.matrix)
        matrix.data = data
        return matrix


def _pairs(corners: int) -> Int[Tensor, "2 pairs"]:
    """Row and column of the upper triangle of a block: each pair of coordinates once."""
    return torch.triu_indices(3 * corners, 3 * corners)


def _keys(vertices: Int[Tensor, "stencils corners"], size: int) -> Int[Tensor, "pairs stencils"]:
    """Row times ``size`` plus column, in the upper triangle, of each pair of coordinates of each stencil."""
    slots = (3 * vertices.cpu()[:, :, None] + torch.arange(3)).flatten(1).T
    one, other = slots[_pairs(vertices.shape[1])]
    return torch.minimum(one, other) * size + torch.maximum(one, other)


class StencilSum:
    """Adds up stencils, and remembers where entries go as long as the tensors of their vertices are the same ones.

    Finding the places costs several times what filling them does. Stencils of one vertex that do not add themselves may
    change: they stand on the diagonal, whose places are always there.
    """

    def __init__(self) -> None:
        self._kinds: list[tuple[Tensor, bool]] = []
        self._pattern: _Pattern | None = None

    def upper(self, pieces: Sequence[Piece | Filled], num_vertices: int) -> sparse.csr_array:
        """The upper triangle of the sum of ``pieces``, ``3 num_vertices`` square."""
        several = [piece for piece in pieces if isinstance(piece, Filled) or piece[0].shape[1] > 1]
        kinds = [(piece[0], isinstance(piece, Filled)) for piece in several]
        pattern = self._pattern
        if pattern is None or num_vertices != len(pattern.diagonal) or not self._fits(kinds):
            pattern = _Pattern.of(several, num_vertices)
            self._kinds, self._pattern = kinds, pattern
        data = torch.zeros(pattern.matrix.nnz, dtype=torch.float64)
        for piece, place in zip(several, pattern.places, strict=True):
            if isinstance(piece, Filled):
                piece.add(data.numpy(), place.numpy())
            else:
                data.scatter_add_(0, place, _entries(piece[1]).reshape(-1))
        for piece in pieces:
            if not isinstance(piece, Filled) and piece[0].shape[1] == 1:
                place = pattern.diagonal[piece[0][:, 0].cpu()].T
                data.scatter_add_(0, place.reshape(-1), _entries(piece[1]).reshape(-1))
        return pattern.filled(data.numpy())

    def _fits(self, kinds: list[tuple[Tensor, bool]]) -> bool:
        same = len(kinds) == len(self._kinds)
        pairs = zip(kinds, self._kinds, strict=True) if same else ()
        return same and all(one is other and filled == was for (one, filled), (other, was) in pairs)


def _entries(blocks: Float[Tensor, "stencils corners 3 corners 3"]) -> Float[Tensor, "pairs stencils"]:
    corners = blocks.shape[1]
    together = blocks.detach().double().cpu().permute(1, 2, 3, 4, 0).reshape(9 * corners**2, -1)
    row, column = _pairs(corners)
    return together[3 * corners * row + column]


def from_jacobian(
    jacobian: tuple[sparse.csr_array, ...], curvature: Float[Tensor, "pieces features features"]
) -> sparse.csr_array:
    """The upper triangle of ``Jᵀ C₊ J``, C₊ the positive semi-definite part of the ``curvature`` of each piece.

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
    return sparse.triu(stacked.T @ stacked, format="csr")
