"""Uniform cubic B-splines: basis, coefficients from values, and a table in three coordinates, two of them angles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.ndimage import spline_filter1d
from torch import Tensor, nn
from torch.nn.functional import embedding_bag

MARGIN = 3
"""How often the outermost coefficients are repeated: beyond, the spline is constant, and C² on the way there."""


def coefficients(
    values: Float[np.ndarray, "..."], periodic_axes: tuple[int, ...] = ()
) -> Float[np.ndarray, "..."]:
    """Coefficients of the tensor-product spline through ``values`` at unit distance.

    The axes that are not periodic end with slope zero; what that costs fades within eight nodes.
    """
    for axis in range(values.ndim):
        values = spline_filter1d(values, 3, axis, mode="grid-wrap" if axis in periodic_axes else "mirror")
    return values


def basis(f: Float[Tensor, "*edges"], orders: int) -> list[list[Float[Tensor, "*edges"]]]:
    """The weights of the four coefficients around the place ``f`` in [0, 1] of a cell of unit length.

    ``basis(...)[d]`` are those of the d-th derivative, for d < orders <= 3.
    """
    g = 1.0 - f
    ff, gg = f * f, g * g
    weights = [[g * gg / 6.0, (0.5 * f - 1.0) * ff + 2.0 / 3.0, (0.5 * g - 1.0) * gg + 2.0 / 3.0, f * ff / 6.0]]
    if orders > 1:
        weights.append([-0.5 * gg, (1.5 * f - 2.0) * f, (2.0 - 1.5 * g) * g, 0.5 * ff])
    if orders > 2:
        weights.append([g, 3.0 * f - 2.0, 3.0 * g - 2.0, f])
    return weights


def combine(taps: Tensor | Sequence[Tensor], weights: Sequence[Float[Tensor, " edges"]]) -> Tensor:
    """``Σ_k taps[k] · weights[k]``, the edges last."""
    total = taps[0] * weights[0]
    for k in (1, 2, 3):
        total.addcmul_(taps[k], weights[k])
    return total


def clamped(x: Float[Tensor, " edges"], nodes: int) -> Float[Tensor, " edges"]:
    """``x``, counted in nodes from the first, with everything outside moved to where the spline is constant."""
    return x.clamp(1 - MARGIN, nodes + MARGIN - 2.001)


def whole(cell: Float[Tensor, "*edges"]) -> Int[Tensor, "*edges"]:
    """The number of a cell; 0 for what is not a number, so that it cannot be looked up anywhere else."""
    return cell.nan_to_num().int()


class SplineLine(nn.Module):
    """A cubic spline S(w) with nodes at ``(first + k) · step``, constant far outside them."""

    def __init__(self, coefficients: Float[Tensor, " nodes"], first: int, step: float):
        super().__init__()
        self.nodes, self.first, self.step = len(coefficients), first, step
        ends = coefficients[:1].expand(MARGIN), coefficients[-1:].expand(MARGIN)
        self.register_buffer("taps", torch.cat([ends[0], coefficients, ends[1]]).unfold(0, 4, 1).contiguous())

    def coefficients(self) -> Float[Tensor, " nodes"]:
        """What the spline was made from."""
        return self.taps[MARGIN : MARGIN + self.nodes, 0]

    def forward(self, w: Float[Tensor, " edges"]) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        """S and its derivative, in the precision of the spline."""
        x = clamped(w / self.step - self.first, self.nodes)
        cell = x.floor()
        taps = self.taps.index_select(0, whole(cell) + (MARGIN - 1)).T
        value, slope = (combine(taps, weights) for weights in basis((x - cell).to(taps.dtype), 2))
        return value, slope / self.step


class SplineTable(nn.Module):
    """A spline S(u, α, β) with nodes at ``u = (first + i) · step`` and ``angles`` nodes around each full turn.

    In memory each row holds the 4 x 4 coefficients around a cell of the angles: sixteen times the coefficients, and
    one cache line where single numbers would lie in four.
    """

    def __init__(self, coefficients: Float[Tensor, "nodes angles angles"], first: int, step: float):
        super().__init__()
        self.nodes, self.angles, _ = coefficients.shape
        self.first, self.step = first, step
        ends = coefficients[:1].expand(MARGIN, -1, -1), coefficients[-1:].expand(MARGIN, -1, -1)
        taps = torch.cat([ends[0], coefficients, ends[1]])
        for axis in (1, 2):  # the first of the four coefficients lies one before the cell
            wrapped = torch.arange(-1, self.angles + 2, device=taps.device) % self.angles
            taps = taps.index_select(axis, wrapped)
        self.register_buffer("taps", taps.unfold(1, 4, 1).unfold(2, 4, 1).reshape(-1, 16).contiguous())

    def coefficients(self) -> Float[Tensor, "nodes angles angles"]:
        """What the table was made from."""
        taps = self.taps.view(-1, self.angles, self.angles, 4, 4)
        return taps[MARGIN : MARGIN + self.nodes, :, :, 1, 1].contiguous()

    def forward(
        self, u: Float[Tensor, " edges"], alpha: Float[Tensor, " edges"], beta: Float[Tensor, " edges"], orders: int
    ) -> dict[tuple[int, int, int], Float[Tensor, " edges"]]:
        """The derivatives of total order below ``orders``, by how often S is differentiated in u, α and β.

        They are computed, and returned, in the precision of the table; cells are found in that of the arguments.
        """
        turn = 2.0 * math.pi / self.angles
        x = torch.stack([clamped(u / self.step - self.first, self.nodes), alpha / turn, beta / turn])
        cell = x.floor()
        weights = basis((x - cell).to(self.taps.dtype), orders)
        taps = self._along_u(self._rows(cell), [weight[0] for order in weights for weight in order], orders)
        found = {}
        for a in range(orders):
            along_a = combine(taps[: orders - a].unbind(1), [weight[1] for weight in weights[a]])
            for b in range(orders - a):
                along_b = combine(along_a[: orders - a - b].unbind(1), [weight[2] for weight in weights[b]])
                for k, part in enumerate(along_b):
                    found[k, a, b] = part / (self.step**k * turn ** (a + b)) if k + a + b else part
        return found

    def _rows(self, cell: Float[Tensor, "3 edges"]) -> Int[Tensor, "edges 4"]:
        """The four rows of each cell, one for each of its nodes in u."""
        angles = cell[1:]
        turned = angles - self.angles * (angles / self.angles).floor()  # remainders are slow
        place = whole(turned).clamp(0, self.angles - 1)
        first = ((whole(cell[0]) + (MARGIN - 1)) * self.angles + place[0]) * self.angles + place[1]
        steps = torch.arange(4, dtype=torch.int32, device=cell.device) * self.angles**2
        return first[:, None] + steps

    def _along_u(
        self, rows: Int[Tensor, "edges 4"], weights: list[Float[Tensor, " edges"]], orders: int
    ) -> Float[Tensor, "orders 4 4 edges"]:
        """The coefficients in the angles, for each derivative in u: one pass over memory."""
        count = len(rows)
        rows = rows[:, None].expand(-1, orders, -1).reshape(-1, 4)
        shares = torch.stack(weights, -1).view(-1, 4)
        sums = embedding_bag(rows, self.taps, per_sample_weights=shares, mode="sum")
        return sums.view(count, -1).T.contiguous().view(orders, 4, 4, count)
