"""The metric of a quasi-Newton method: a factorised Hessian, corrected by what gradients have told since."""

from __future__ import annotations

from collections import deque

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy import sparse
from torch import Tensor

from drape.energy.hessian import StencilSum
from drape.energy.term import Stencils
from drape.simulators.factorisation import Factorisation

MEMORY = 20
"""Pairs of positions and gradients that correct the metric between two factorisations (L-BFGS)."""
CONJUGATE = 40
"""Conjugate gradients, at most."""


class Metric:
    """``B ≈ ∂²E/∂x²`` of the terms that couple vertices: their Hessian A at one point, corrected by L-BFGS.

    What is factorised is ``A + C``, with the Hessian C of the local terms.
    """

    def __init__(self, free: Bool[Tensor, " vertices"]):
        self.free = free
        self.solves = 0
        """Uses of the factors."""
        self._slots = np.flatnonzero(np.repeat(free.cpu().numpy(), 3))
        self._factors = Factorisation()
        self._pairs: deque[tuple[Tensor, Tensor, Tensor]] = deque(maxlen=MEMORY)
        self._images: list[Tensor] = []

    @property
    def is_uncorrected(self) -> bool:
        """No pairs are remembered."""
        return not self._pairs

    def factorise(self, upper: sparse.csr_array, local: list[Stencils]) -> None:
        """Take the Hessian of which the upper triangle is given, and the ``local`` one with it."""
        self.forget()
        self._upper = upper[self._slots][:, self._slots]
        self._diagonal = self._upper.diagonal()
        self.factorise_again(local)

    def factorise_again(self, local: list[Stencils]) -> None:
        """With another ``local`` Hessian."""
        self._local, self.solves, added = local, 0, 0
        if local:
            added = StencilSum().upper(local, len(self.free))[self._slots][:, self._slots]
        self._factors.factorise(self._upper + added)
        pairs = [(change, turn, turn + self._local_times(local, change)) for change, turn, _ in self._pairs]
        self._pairs = deque(pairs, maxlen=MEMORY)

    def forget(self) -> None:
        """The corrections."""
        self._pairs.clear()
        self._images = []

    def remember(self, change: Float[Tensor, "vertices 3"], turn: Float[Tensor, "vertices 3"]) -> None:
        """Positions have changed, and the gradient of the terms that couple vertices with them."""
        turn = turn * self.free[:, None]
        if not (change * turn).sum() > 1e-12 * change.norm() * turn.norm():
            return
        if len(self._pairs) == MEMORY:
            self._images = []
        self._pairs.append((change, turn, turn + self._local_times(self._local, change)))

    def solve(self, right: Float[Tensor, "vertices 3"]) -> Float[Tensor, "vertices 3"]:
        """``(B + C)⁻¹ right``: exact without local terms, else nearly."""
        self.solves += 1
        wanted, scales = right * self.free[:, None], []
        for change, _, turn in reversed(self._pairs):
            scales.append((change * wanted).sum() / (change * turn).sum())
            wanted = wanted - scales[-1] * turn
        direction = self._spread(self._factors.solve(self._gathered(wanted)), right)
        for (change, _, turn), scale in zip(self._pairs, reversed(scales), strict=True):
            direction = direction + (scale - (turn * direction).sum() / (change * turn).sum()) * change
        return direction

    def solve_with(
        self, local: list[Stencils], right: Float[Tensor, "vertices 3"], tolerance: float
    ) -> tuple[Float[Tensor, "vertices 3"], Float[Tensor, "vertices 3"]]:
        """``p = (B + local)⁻¹ right`` by conjugate gradients, up to a ``tolerance`` in its norm, and ``B p``."""
        p, image, left = torch.zeros_like(right), torch.zeros_like(right), right
        direction = step = self.solve(left)
        size = first = (left * step).sum()
        for _ in range(CONJUGATE):
            turn = self._times(direction)
            total = turn + self._local_times(local, direction)
            share = size / (direction * total).sum()
            if not share.isfinite():
                break
            p, image, left = p + share * direction, image + share * turn, left - share * total
            step = self.solve(left)
            before, size = size, (left * step).sum()
            if not size > tolerance**2 * first:
                break
            direction = step + size / before * direction
        return p, image

    def _times(self, p: Tensor) -> Tensor:
        """``B p``."""
        for change, _, _ in list(self._pairs)[len(self._images) :]:
            self._images.append(self._times_remembered(change))
        return self._times_remembered(p)

    def _times_remembered(self, p: Tensor) -> Tensor:
        flat = self._gathered(p)
        total = self._spread(self._upper @ flat + self._upper.T @ flat - self._diagonal * flat, p)
        for image, (change, turn, _) in zip(self._images, self._pairs, strict=False):
            total = total + turn * ((turn * p).sum() / (turn * change).sum())
            total = total - image * ((image * p).sum() / (image * change).sum())
        return total

    def _local_times(self, local: list[Stencils], p: Tensor) -> Tensor:
        total = torch.zeros_like(p)
        for vertices, blocks in local:
            there = vertices[:, 0]
            total.index_add_(0, there, (blocks[:, 0, :, 0] @ p[there, :, None])[..., 0])
        return total * self.free[:, None]

    def _gathered(self, p: Tensor) -> np.ndarray:
        return p.reshape(-1)[self._slots].double().cpu().numpy()

    def _spread(self, values: np.ndarray, like: Tensor) -> Tensor:
        full = np.zeros(like.numel())
        full[self._slots] = values
        return torch.from_numpy(full).to(like).reshape(-1, 3)
