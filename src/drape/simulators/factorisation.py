"""Sparse factorisation of symmetric positive definite matrices, by a library."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

try:  # pip install "drape[fast]": several times faster, for x86 processors
    from pypardiso import PyPardisoSolver
except ImportError:
    PyPardisoSolver = None


class Factorisation:
    """``A = L Lᵀ`` once, ``A z = b`` many times; PARDISO where it is installed, else SciPy's SuperLU.

    Raises:
        ArithmeticError: the matrix is singular or not finite.
    """

    def __init__(self, matrix: sparse.csr_array):
        if not np.isfinite(matrix.data).all():
            raise ArithmeticError("the matrix is not finite")
        self.library = "SuperLU" if PyPardisoSolver is None else "PARDISO"
        if PyPardisoSolver is None:
            options = {"SymmetricMode": True}
            try:
                factors = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
            except RuntimeError as error:
                raise ArithmeticError(str(error)) from error
            self.solve = factors.solve
            return
        upper = sparse.csr_matrix(sparse.triu(matrix, format="csr"))
        upper.sort_indices()
        solver = PyPardisoSolver(mtype=2)
        try:
            solver.factorize(upper)
        except Exception as error:
            raise ArithmeticError(str(error)) from error
        self.solve = lambda b: solver.solve(upper, b)
        self._release = solver.free_memory

    def close(self) -> None:
        """Free memory that Python does not manage."""
        if hasattr(self, "_release"):
            self._release(everything=True)
