"""Sparse factorisation of symmetric positive definite matrices, by a library."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import splu

try:  # pip install "drape[fast]": several times faster, for x86 processors
    from pypardiso import PyPardisoSolver
    from pypardiso.pardiso_wrapper import PyPardisoError
except ImportError:
    PyPardisoSolver = None

SHIFTS = (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0)
"""Shares of the diagonal that are added to it, one after the other, until the matrix is positive definite."""


class Factorisation:
    """``A = L Lᵀ`` once, ``A z = b`` many times; PARDISO where it is installed, else SciPy's SuperLU.

    Pieces that are a sum of squares add up to something indefinite where they span more orders of magnitude than the
    floating-point numbers, as at needles. Rounding is relative to the diagonal, so a share of that mends it.

    Raises:
        ArithmeticError: the matrix is not finite, or indefinite beyond rounding.
    """

    def __init__(self, matrix: sparse.csr_array):
        if not np.isfinite(matrix.data).all():
            raise ArithmeticError("the matrix is not finite")
        self.library = "SuperLU" if PyPardisoSolver is None else "PARDISO"
        factorised = _superlu if PyPardisoSolver is None else _pardiso
        diagonal = sparse.diags_array(matrix.diagonal(), format="csr")
        for shift in SHIFTS:
            found = factorised(matrix + shift * diagonal if shift else matrix)
            if found is not None:
                self.solve, close = found
                self.close = weakref.finalize(self, close)  # at the latest when nobody needs the factors any more
                return
        raise ArithmeticError("the matrix is not positive definite")


Solve = Callable[[Float[np.ndarray, " rows"]], Float[np.ndarray, " rows"]]
Close = Callable[[], None]
"""Frees memory that Python does not manage."""


def _superlu(matrix: sparse.csr_array) -> tuple[Solve, Close] | None:
    """Solve and close; None where the matrix is not positive definite."""
    options = {"SymmetricMode": True}
    try:
        factors = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:  # singular
        return None
    return (factors.solve, lambda: None) if (factors.U.diagonal() > 0).all() else None


def _pardiso(matrix: sparse.csr_array) -> tuple[Solve, Close] | None:
    upper = sparse.csr_matrix(sparse.triu(matrix, format="csr"))
    upper.sort_indices()
    solver = PyPardisoSolver(mtype=2)
    os.environ.setdefault("PYPARDISO_MKL_RT", solver.libmkl._name)  # or every solver searches the disk for it
    try:
        solver.factorize(upper)
    except PyPardisoError:
        solver.free_memory(everything=True)
        return None
    solver._is_already_factorized = lambda _: True  # it would compare all entries in each solve
    return lambda b: solver.solve(upper, b), lambda: solver.free_memory(everything=True)
