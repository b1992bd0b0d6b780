"""Minimise an incremental potential: quasi-Newton steps in the metric of a factorised Hessian."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy import sparse
from torch import Tensor

from drape.energy.incremental_potential import Evaluation, IncrementalPotential
from drape.energy.step import Step
from drape.energy.term import array
from drape.linalg.factorisation import Factorisation
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


class _Place(NamedTuple):
    """Positions, and the incremental potential there."""

    x: Float[Tensor, "vertices 3"]
    found: Evaluation
    gradient: Float[np.ndarray, " unknowns"]
    """Of the unknowns, the coordinates of what may move [N]."""

    @property
    def residual(self) -> float:
        """Mean norm of the unbalanced force over the free vertices [N]."""
        norms = np.sqrt(np.square(self.gradient.reshape(-1, 3)).sum(1))
        return float(norms.mean()) if len(norms) else 0.0

    @property
    def is_finite(self) -> bool:
        return bool(np.isfinite(self.found.energy)) and bool(np.isfinite(self.gradient).all())


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

    def response(self, force: Float[Tensor, "vertices 3"]) -> Float[Tensor, "vertices 3"]:
        """``H⁻¹ f`` [m] of what may move, by the last factors: where a small force would bring the cloth."""
        answer = np.zeros(3 * len(self.free))
        answer[self._slots] = self._factors.solve(self._unknowns(force))
        return torch.from_numpy(answer.reshape(-1, 3)).to(force)

    def _descend(
        self, starts: list[Float[Tensor, "vertices 3"]], step: Step, tolerance: float, iterations: int
    ) -> tuple[Float[Tensor, "vertices 3"], Evaluation, Outcome, int, float]:
        places = [self._at(x, step) for x in starts]
        self.standing = places[0].found
        here = min((place for place in places if place.is_finite), key=lambda place: place.found.energy, default=None)
        used = len(starts)
        if here is None:
            return starts[0], self.standing, Outcome.NOT_FINITE, used, float("nan")
        pairs: deque[tuple[np.ndarray, np.ndarray, float]] = deque(maxlen=MEMORY)
        fresh, since, (lasting, before) = False, 0, (0, 0.0) if self._is_stale else (REFRESH, float("inf"))
        gained_at, gained_from = used, float("inf")
        while True:
            residual = here.residual
            if residual < 0.5 * gained_from:
                gained_at, gained_from = used, residual
            outcome = _ended(residual <= tolerance, used - gained_at >= STALLED, used >= iterations)
            if outcome is not None:
                return here.x, here.found, outcome, used, residual
            if self._rough and used > PATIENCE:
                self._rough, since, before = False, REFRESH, 0.0
            if since >= lasting:
                if residual > SLOW * before:
                    self._factorise(here.x, step)
                    pairs.clear()
                    lasting, fresh = REFRESH if fresh else EARLY, True
                since, before = 0, residual
            there, tried = self._search(here, self._direction(here.gradient, pairs), step, iterations - used)
            used, since = used + tried, since + 1
            if there is None:
                if fresh and not pairs and used < iterations:
                    return here.x, here.found, Outcome.PRECISION, used, residual
                since, before = REFRESH, 0.0
                continue
            if here.found.energy - there.found.energy > here.found.rounding:
                gained_at = used
            self._remember(pairs, here, there)
            here = there

    def _at(self, x: Float[Tensor, "vertices 3"], step: Step) -> _Place:
        found = self.potential.evaluate(x, step)
        return _Place(x, found, self._unknowns(found.gradient))

    def _unknowns(self, values: Float[Tensor, "vertices 3"]) -> Float[np.ndarray, " unknowns"]:
        """Of values of all vertices those of what may move."""
        return array(values).reshape(-1)[self._slots]

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
        kept = self._of_those
        if kept is None or self._places is None or not all(map(np.array_equal, places, self._places)):
            numbered = sparse.csr_array((np.arange(matrix.nnz), *places), matrix.shape)
            kept = numbered[self._slots][:, self._slots]
            self._places, self._of_those = places, kept
        return sparse.csr_array((matrix.data[kept.data], kept.indices, kept.indptr), kept.shape)

    def _free_share(self, x_from: Tensor, x_to: Tensor, step: Step) -> float:
        """Share of the way that a barrier leaves free, short of what it runs into."""
        barrier = self.potential.barrier
        share = 1.0 if barrier is None else barrier.free_share(x_from, x_to, step)
        return 1.0 if share == 1.0 else SHORT_OF * share

    def _direction(self, gradient: np.ndarray, pairs: deque) -> Float[np.ndarray, " unknowns"]:
        wanted, scales = gradient, []
        for change, turn, curvature in reversed(pairs):
            scales.append(change @ wanted / curvature)
            wanted = wanted - scales[-1] * turn
        direction = self._factors.solve(wanted)
        for (change, turn, curvature), scale in zip(pairs, reversed(scales), strict=True):
            direction += (scale - turn @ direction / curvature) * change
        return -direction

    def _remember(self, pairs: deque, here: _Place, there: _Place) -> None:
        """Keep the turn of the gradient on a way, where it is that of something convex."""
        change, turn = self._unknowns(there.x - here.x), there.gradient - here.gradient
        curvature = change @ turn
        if curvature > 1e-12 * np.linalg.norm(change) * np.linalg.norm(turn):
            pairs.append((change, turn, curvature))

    def _search(
        self, here: _Place, direction: Float[np.ndarray, " unknowns"], step: Step, budget: int
    ) -> tuple[_Place | None, int]:
        """Backtrack until the energy falls enough, or, where its rounding hides that, until the slope says so."""
        slope = float(here.gradient @ direction)
        if not slope < 0:
            return None, 0
        moves = np.zeros(3 * len(self.free))
        moves[self._slots] = direction
        way = torch.from_numpy(moves.reshape(-1, 3)).to(here.x)
        share = self._free_share(here.x, here.x + way, step)
        for tried in range(1, max(2, min(budget, 40)) + 1):
            moved = here.x + share * way
            if torch.equal(moved, here.x):
                return None, tried - 1
            there = self._at(moved, step)
            gained = there.found.energy - here.found.energy
            if gained <= SUFFICIENT * share * slope and there.is_finite:
                return there, tried
            if abs(gained) <= here.found.rounding:
                along = float(there.gradient @ direction)
                flatter = (2 * SUFFICIENT - 1) * slope >= along >= 0.9 * slope
                if flatter and there.residual < here.residual:
                    return there, tried
            share *= _shorter(gained, share * slope)
        return None, tried


def _ended(is_balanced: bool, is_stalled: bool, is_used_up: bool) -> Outcome | None:
    """Outcome of a minimisation; None: not yet."""
    if is_balanced:
        return Outcome.CONVERGED
    if is_stalled:
        return Outcome.PRECISION
    return Outcome.ITERATIONS if is_used_up else None


def _shorter(gained: float, predicted: float) -> float:
    """Minimum of the parabola through a step that gained this much, as a share of the step."""
    if not np.isfinite(gained):
        return SHRINK[0]
    best = -0.5 * predicted / (gained - predicted) if gained > predicted else SHRINK[1]
    return min(max(best, SHRINK[0]), SHRINK[1])
