"""Two cubic splines of two coordinates on the same nodes, constant beyond them."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.ndimage import spline_filter1d
from torch import Tensor, nn

MARGIN = 3
"""Number of repetitions of the outermost coefficients: beyond, the spline is constant, and C² on the way there."""


class SplinePlane(nn.Module):
    """S(u, v) >= 0 with nodes at ``(first_u + i) step_u`` and ``(first_v + j) step_v``; C², constant far outside.

    In memory each row holds the 4 x 4 coefficients around a cell, of the first spline, then of the second.
    """

    taps: Float[Tensor, "cells 32"]

    def __init__(
        self, values: Float[np.ndarray, "2 nodes_u nodes_v"], first: tuple[int, int], step: tuple[float, float]
    ):
        super().__init__()
        self.first, self.step = first, step
        self.nodes = values.shape[1], values.shape[2]
        self.values = values
        each = np.stack([coefficients(one) for one in values]).clip(min=0.0)  # so that no spline is negative anywhere
        padded = np.pad(each, ((0, 0), (MARGIN, MARGIN), (MARGIN, MARGIN)), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (4, 4), axis=(1, 2))  # type: ignore[call-overload]
        taps = np.ascontiguousarray(windows.transpose(1, 2, 0, 3, 4).reshape(-1, 32))
        self.register_buffer("taps", torch.from_numpy(taps))

    @property
    def places(self) -> tuple[Float[np.ndarray, " nodes_u"], Float[np.ndarray, " nodes_v"]]:
        """Coordinates of the nodes."""
        u, v = (h * (first + np.arange(n)) for n, first, h in zip(self.nodes, self.first, self.step, strict=True))
        return u, v

    def forward(
        self, u: Float[Tensor, " edges"], v: Float[Tensor, " edges"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        """Both splines, twice differentiable."""
        x = clamped(u / self.step[0] - self.first[0], self.nodes[0])
        y = clamped(v / self.step[1] - self.first[1], self.nodes[1])
        cell_x, cell_y = x.detach().floor(), y.detach().floor()
        columns = self.nodes[1] + 2 * MARGIN - 3
        rows = (whole(cell_x) + (MARGIN - 1)) * columns + whole(cell_y) + (MARGIN - 1)
        taps = self.taps[rows].to(u.dtype).view(-1, 2, 4, 4)
        weights = [basis(part) for part in (x - cell_x, y - cell_y)]
        first, second = torch.einsum("epij,ei,ej->pe", taps, *weights).unbind(0)
        return first, second


def coefficients(values: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Coefficients of the tensor-product spline through ``values`` at unit distance.

    Its ends have slope zero; what that costs fades within eight nodes.
    """
    for axis in range(values.ndim):
        values = spline_filter1d(values, 3, axis, mode="mirror")
    return values


def basis(f: Float[Tensor, " edges"]) -> Float[Tensor, "edges 4"]:
    """The weights of the four coefficients around the place ``f`` in [0, 1] of a cell of unit length."""
    g = 1.0 - f
    low, high = (0.5 * f - 1.0) * f * f + 2.0 / 3.0, (0.5 * g - 1.0) * g * g + 2.0 / 3.0
    return torch.stack([g**3 / 6.0, low, high, f**3 / 6.0], -1)


def clamped(x: Float[Tensor, " edges"], nodes: int) -> Float[Tensor, " edges"]:
    """``x``, counted in nodes from the first, with everything outside moved to where the spline is constant."""
    return x.clamp(1 - MARGIN, nodes + MARGIN - 2.001)


def whole(cell: Float[Tensor, "*edges"]) -> Int[Tensor, "*edges"]:
    """The number of a cell; 0 for what is not a number, so that it cannot be looked up anywhere else."""
    return cell.nan_to_num().int()
