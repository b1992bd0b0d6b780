"""Rows that belong together: sum and softmax over all rows of one owner, along lists instead of dense matrices."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor


def segment_sum(
    rows: Float[Tensor, "rows *dims"], owner: Int[Tensor, " rows"], count: int
) -> Float[Tensor, "{count} *dims"]:
    """Sum of the rows of each of ``count`` owners; 0 for one without rows."""
    return rows.new_zeros(count, *rows.shape[1:]).index_add(0, owner, rows)


def segment_softmax(
    logits: Float[Tensor, "rows heads"], owner: Int[Tensor, " rows"], count: int
) -> Float[Tensor, "rows heads"]:
    """Softmax over the rows of each of ``count`` owners, in each column on its own."""
    with torch.no_grad():
        largest = logits.new_full((count, logits.shape[1]), -torch.inf)
        largest = largest.scatter_reduce(0, owner[:, None].expand_as(logits), logits, "amax")
    weight = (logits - largest.index_select(0, owner)).exp()
    return weight / segment_sum(weight, owner, count).index_select(0, owner)
