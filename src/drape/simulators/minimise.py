"""Minimise an incremental potential: quasi-Newton steps in the metric of a factorised Hessian."""

from __future__ import annotations

from collections import deque

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy import sparse
from torch import Tensor

from drape.energy.incremental_potential import Evaluation, IncrementalPotential
from drape.energy.step import Step
from drape.simulators.factorisation import Factorisation
from drape.simulators.simulator import Outcome

MEMORY = 8
"""Pairs of positions and gradients that correct the metric between two factorisations (L-BFGS)."""
REFRESH = 4
"""Iterations after which the Hessian is factorised anew, unless they have brought the residual down to ``SLOW``."""
EARLY = 2
"""The same for the first factors, which are those of a start: there contacts come and go."""
SLOW = 0.1
"""Share of the residual that they leave where the factors are good enough."""
PATIENCE = 45
"""Evaluations of a call after which the rough Hessian is given up for the good one until :meth:`Minimiser.begin`."""
STALLED = 12
"""Evaluations without a gain beyond rounding, and without half the residual, after which nothing more is expected."""
SHRINK = (0.1, 0.5)
"""Bounds of the factor by which the line search shortens a step; between them a parabola decides."""
SHORT_OF = 0.9
"""Share of the free part of a way that a line search may go before what a barrier keeps apart would cross."""
SUFFICIENT = 1e-4
"""Share of the predicted decrease that a step must bring (Armijo)."""


class Minimiser:
    """Preconditioned L-BFGS with a line search, for one sparsity pattern.

    Each direction is that of Newton's method with the last factorised positive definite Hessian, corrected by the
    L-BFGS two-loop recursion (Liu, Bouaziz and Kavan 2017, with the whole Hessian in the place of a fixed Laplacian).
    The factorisation is that of the first point which is not a minimum after :meth:`begin`, is kept over iterations
    and calls, and renewed where iterations bring too little, as when contacts come and go, and after a call that has
    used up its iterations. The Hessian is the rough one, sparser and cheaper to factorise, until a call takes more than
    ``PATIENCE`` evaluations. The energy never rises, up to its own rounding.

    After :meth:`begin` nothing of earlier calls is left but the order of the unknowns, which follows from the places of
    the entries alone: what is found then depends on the arguments only, to the last bit.

    Args:
        potential: what is minimised.
        free: vertices that may move.
        single: factors in single precision, where the library can: they take half the time.
    """

    def __init__(self, potential: IncrementalPotential, free: Bool[Tensor, " vertices"], *, single: bool = False):
        self.potential = potential
        self.free = free
        self._slots = np.flatnonzero(np.repeat(free.cpu().numpy(), 3))
        self._factors = Factorisation(single=single)
        self._places: tuple[np.ndarray, np.ndarray] | None = None
        self._of_those: sparse.csr_array | None = None
        self.factorisations = 0
        self.standing: Evaluation | None = None
        """The first of the starts of the last call, evaluated."""
        self.begin()

    def begin(self) -> None:
        """Forget the steps before: the next call factorises the Hessian at its own start."""
        self._rough = True
        self._is_stale = True

    def minimise(
        self, starts: list[Float[Tensor, "vertices 3"]], step: Step, tolerance: float, iterations: int
    ) -> tuple[Float[Tensor, "vertices 3"], Evaluation, Outcome, int, float]:
        """From the best of ``starts`` to a minimum: positions, their evaluation, outcome, evaluations, residual [N].

        Stops when the mean norm of the gradient over the free vertices is below ``tolerance`` [N].
        """
        found = self._descend(starts, step, tolerance, iterations)
        self._is_stale |= found[2] is Outcome.ITERATIONS
        return found

    def _descend(
        self, starts: list[Float[Tensor, "vertices 3"]], step: Step, tolerance: float, iterations: int
    ) -> tuple[Float[Tensor, "vertices 3"], Evaluation, Outcome, int, float]:
        x, best = self._best(starts, step)
        used = len(starts)
        if best is None:
            return starts[0], self.potential.evaluate(starts[0], step), Outcome.NOT_FINITE, used, float("nan")
        pairs: deque[tuple[Tensor, Tensor]] = deque(maxlen=MEMORY)
        fresh, since, (lasting, before) = False, 0, (0, 0.0) if self._is_stale else (REFRESH, float("inf"))
        gained_at, gained_from = used, float("inf")
        while True:
            residual = self.residual(best.gradient)
            if residual <= tolerance:
                return x, best, Outcome.CONVERGED, used, residual
            if residual < 0.5 * gained_from:
                gained_at, gained_from = used, residual
            if used - gained_at >= STALLED:
                return x, best, Outcome.PRECISION, used, residual
            if used >= iterations:
                return x, best, Outcome.ITERATIONS, used, residual
            if self._rough and used > PATIENCE:
                self._rough, since, before = False, REFRESH, 0.0
            if since >= lasting:
                if residual > SLOW * before:
                    self._factorise(x, step)
                    pairs.clear()
                    lasting, fresh = REFRESH if fresh else EARLY, True
                since, before = 0, residual
            direction = self._direction(best.gradient, pairs)
            found, tried = self._search(x, best, direction, step, iterations - used)
            used, since = used + tried, since + 1
            if found is None:
                if fresh and not pairs and used < iterations:
                    return x, best, Outcome.PRECISION, used, residual
                since, before = REFRESH, 0.0
                continue
            moved, evaluation = found
            if best.energy - evaluation.energy > best.rounding:
                gained_at = used
            self._remember(pairs, moved - x, evaluation.gradient - best.gradient)
            x, best = moved, evaluation

    def _best(self, starts: list[Tensor], step: Step) -> tuple[Tensor, Evaluation | None]:
        tried = [(x, self.potential.evaluate(x, step)) for x in starts]
        self.standing = tried[0][1]
        finite = [(x, e) for x, e in tried if np.isfinite(e.energy) and bool(e.gradient[self.free].isfinite().all())]
        if not finite:
            return starts[0], None
        return min(finite, key=lambda pair: pair[1].energy)

    def residual(self, gradient: Float[Tensor, "vertices 3"]) -> float:
        """Mean norm over the free vertices [N]."""
        free = gradient[self.free]
        return float(free.norm(dim=-1).mean()) if len(free) else 0.0

    def _factorise(self, x: Tensor, step: Step) -> None:
        matrix = self._of_free(self.potential.hessian(x, step, rough=self._rough))
        self._factors.factorise(matrix)
        self._is_stale = False
        self.factorisations += 1

    def _of_free(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """Rows and columns of what may move; where they stand is found anew only when entries stand elsewhere."""
        if len(self._slots) == matrix.shape[0]:
            return matrix
        places = matrix.indices, matrix.indptr
        if self._places is None or not all(map(np.array_equal, places, self._places)):
            numbered = sparse.csr_array((np.arange(matrix.nnz), *places), matrix.shape)
            self._places, self._of_those = places, numbered[self._slots][:, self._slots]
        kept = self._of_those
        return sparse.csr_array((matrix.data[kept.data], kept.indices, kept.indptr), kept.shape)

    def _free_share(self, x_from: Tensor, x_to: Tensor, step: Step) -> float:
        """How much of the way a barrier leaves free, short of what it runs into."""
        barrier = self.potential.barrier
        share = 1.0 if barrier is None else barrier.free_share(x_from, x_to, step)
        return 1.0 if share == 1.0 else SHORT_OF * share

    def _solve(self, gradient: Tensor) -> Tensor:
        right = gradient.reshape(-1)[self._slots].double().cpu().numpy()
        solution = np.zeros(3 * len(self.free))
        solution[self._slots] = self._factors.solve(right)
        return torch.from_numpy(solution).to(gradient).reshape(-1, 3)

    def _direction(self, gradient: Tensor, pairs: deque[tuple[Tensor, Tensor]]) -> Tensor:
        wanted, scales = gradient * self.free[:, None], []
        for change, turn in reversed(pairs):
            scales.append((change * wanted).sum() / (change * turn).sum())
            wanted = wanted - scales[-1] * turn
        direction = self._solve(wanted)
        for (change, turn), scale in zip(pairs, reversed(scales), strict=True):
            direction = direction + (scale - (turn * direction).sum() / (change * turn).sum()) * change
        return -direction

    def _remember(self, pairs: deque, change: Tensor, turn: Tensor) -> None:
        turn = turn * self.free[:, None]
        curvature = (change * turn).sum()
        if curvature > 1e-12 * change.norm() * turn.norm():
            pairs.append((change, turn))

    def _search(
        self, x: Tensor, here: Evaluation, direction: Tensor, step: Step, budget: int
    ) -> tuple[tuple[Tensor, Evaluation] | None, int]:
        """Backtrack until the energy falls enough, or, where its rounding hides that, until the slope says so."""
        slope = float((here.gradient * direction).sum())
        if not slope < 0:
            return None, 0
        share = self._free_share(x, x + direction, step)
        for tried in range(1, max(2, min(budget, 40)) + 1):
            moved = x + share * direction
            if torch.equal(moved, x):
                return None, tried - 1
            there = self.potential.evaluate(moved, step)
            gained = there.energy - here.energy
            if gained <= SUFFICIENT * share * slope and bool(there.gradient.isfinite().all()):
                return (moved, there), tried
            if abs(gained) <= here.rounding:
                along = float((there.gradient * direction).sum())
                flatter = (2 * SUFFICIENT - 1) * slope >= along >= 0.9 * slope
                if flatter and self.residual(there.gradient) < self.residual(here.gradient):
                    return (moved, there), tried
            share *= _shorter(gained, share * slope)
        return None, tried


def _shorter(gained: float, predicted: float) -> float:
    """Where the parabola through a step that gained this much has its minimum, as a share of the step."""
    if not np.isfinite(gained):
        return SHRINK[0]
    best = -0.5 * predicted / (gained - predicted) if gained > predicted else SHRINK[1]
    return min(max(best, SHRINK[0]), SHRINK[1])
