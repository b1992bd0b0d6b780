"""Two cubic splines of two coordinates on the same nodes, constant beyond them."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.cubic_spline import MARGIN, basis, clamped, coefficients, whole


class SplinePlane(nn.Module):
    """S(u, v) with nodes at ``(first_u + i) step_u`` and ``(first_v + j) step_v``; C², constant far outside.

    In memory each row holds the 4 x 4 coefficients around a cell, of the first spline, then of the second.
    """

    def __init__(
        self, values: Float[np.ndarray, "2 nodes_u nodes_v"], first: tuple[int, int], step: tuple[float, float]
    ):
        super().__init__()
        self.first, self.step = tuple(first), tuple(step)
        self.nodes = values.shape[1:]
        self.values = values
        each = np.stack([coefficients(one) for one in values])
        padded = np.pad(each, ((0, 0), (MARGIN, MARGIN), (MARGIN, MARGIN)), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (4, 4), axis=(1, 2))
        taps = np.ascontiguousarray(windows.transpose(1, 2, 0, 3, 4).reshape(-1, 32))
        self.register_buffer("taps", torch.from_numpy(taps))

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
        weights = [torch.stack(basis(part, 1)[0], -1) for part in (x - cell_x, y - cell_y)]
        return torch.einsum("epij,ei,ej->pe", taps, *weights).unbind(0)
