"""Sparse factorisation of symmetric positive definite matrices, by a library."""

from __future__ import annotations

import ctypes
import os
import sys
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import splu

for library in sorted(Path(sys.prefix, "lib").glob("libmkl_rt*")):  # else pypardiso searches all folders for it
    os.environ.setdefault("PYPARDISO_MKL_RT", str(library))
try:  # there is none for other processors than x86; several times faster
    from pypardiso import PyPardisoSolver
    from pypardiso.pardiso_wrapper import PyPardisoError
except ImportError:
    PyPardisoSolver = None

SHIFTS = (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0)
"""Shares of the diagonal that are added to it, one after the other, until the matrix is positive definite."""
OPTIONS = {1: 1, 8: 0, 10: 13, 18: 0, 19: 0}
"""Of PARDISO, by its numbers: not the defaults; no refinement of solutions, which takes twice as long as they do;
pivots below 1e-13 count as perturbed; no counts of entries and operations. Number 2 is the order, 28 the precision."""
MANY = 10_000
"""Rows from which on METIS finds a better order of the unknowns than minimum degree does."""
Solve = Callable[[Float[np.ndarray, " rows"]], Float[np.ndarray, " rows"]]


class Factorisation:
    """``A = L Lᵀ`` once, ``A z = b`` many times; PARDISO where it is installed, else SciPy's SuperLU.

    Matrices come one after the other: :meth:`factorise` forgets the one before, and keeps what can be known from the
    places of the entries alone where these are the same.

    Pieces that are a sum of squares add up to something indefinite where they span more orders of magnitude than the
    floating-point numbers, as at needles. Rounding is relative to the diagonal, so a share of that mends it.

    Args:
        single: factors in single precision where the library can and they are good enough: half the time. What a step
            of a solver misses by that, the next one finds; but steps that are exact otherwise end seven digits in.
    """

    def __init__(self, *, single: bool = False) -> None:
        self.library = "SuperLU" if PyPardisoSolver is None else "PARDISO"
        self._kept = _SuperLU() if PyPardisoSolver is None else _Pardiso(single=single)
        self.close = weakref.finalize(self, self._kept.close)  # at the latest when nobody needs the factors any more

    def factorise(self, upper: sparse.csr_array) -> None:
        """Take the symmetric ``matrix`` of which the upper triangle is given, the diagonal in it.

        Raises:
            ArithmeticError: the matrix is not finite, or indefinite beyond rounding.
        """
        if not np.isfinite(upper.data).all():
            raise ArithmeticError("the matrix is not finite")
        for shift in SHIFTS:
            shifted = upper + shift * sparse.diags_array(upper.diagonal(), format="csr") if shift else upper
            if self._kept.factorise(shifted):
                return
        raise ArithmeticError("the matrix is not positive definite")

    def solve(self, right: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        """``A⁻¹ right`` of the last matrix."""
        return self._kept.solve(right)


class _SuperLU:
    solve: Solve

    def factorise(self, upper: sparse.csr_array) -> bool:
        """False where the matrix is not positive definite."""
        matrix = upper + sparse.triu(upper, 1).T
        options = {"SymmetricMode": True}
        try:
            factors = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        except RuntimeError:  # singular
            return False
        self.solve = factors.solve
        return bool((factors.U.diagonal() > 0).all())

    def close(self) -> None:
        """There is no memory that Python does not manage."""


class _Entries(NamedTuple):
    """Entries of a matrix for PARDISO, which counts rows and columns from 1."""

    data: np.ndarray
    indptr: np.ndarray
    indices: np.ndarray
    from_one: tuple[np.ndarray, np.ndarray]
    """The two before, counted from 1."""

    @classmethod
    def of(cls, upper: sparse.csr_array, kind: type, before: _Entries | None) -> _Entries:
        """With what is the same as ``before`` taken from there."""
        with np.errstate(over="ignore"):
            data = upper.data.astype(kind, copy=False)
        places = upper.indptr, upper.indices
        if before is not None and all(map(_same, places, (before.indptr, before.indices))):
            return before._replace(data=data)
        first, second = (each.astype(np.int32) + 1 for each in places)
        return cls(data, *places, (first, second))


class _Pardiso:
    ENOUGH = 1e-3
    """Largest ``|A z - b| / |b|`` of a random b with which factors in single precision are taken."""
    ANALYSE, FACTORISE, SOLVE = 11, 22, 33
    """Phases of PARDISO: order the unknowns by the places of the entries, factorise, solve."""

    def __init__(self, *, single: bool) -> None:
        self._kinds = (np.float32, np.float64) if single else (np.float64,)
        self._solver = PyPardisoSolver(mtype=2)  # real, symmetric, positive definite
        os.environ.setdefault("PYPARDISO_MKL_RT", self._solver.libmkl._name)  # or all others search the disk for it
        self._entries: _Entries | None = None

    def factorise(self, upper: sparse.csr_array) -> bool:
        """False where the matrix is not positive definite."""
        upper.sort_indices()
        return any(self._factorise(upper, kind) and self._is_enough(upper, kind) for kind in self._kinds)

    def _factorise(self, upper: sparse.csr_array, kind: type) -> bool:
        before, entries = self._entries, _Entries.of(upper, kind, self._entries)
        if kind is not np.float64 and not np.isfinite(entries.data).all():
            return False
        self._entries = entries
        known = before is not None and before.from_one is entries.from_one and before.data.dtype == kind
        try:
            if not known:  # the unknowns need another order
                self._solver.free_memory(everything=True)
                for number, value in {**OPTIONS, 2: 2 * (upper.shape[0] >= MANY), 28: int(kind is np.float32)}.items():
                    self._solver.set_iparm(number, value)
                self._call(self.ANALYSE, np.zeros(upper.shape[0]))
            self._call(self.FACTORISE, np.zeros(upper.shape[0]))
        except PyPardisoError:
            self.close()
            return False
        return True

    def _is_enough(self, upper: sparse.csr_array, kind: type) -> bool:
        if kind is np.float64:
            return True
        right = np.random.default_rng(0).standard_normal(upper.shape[0])
        found = self.solve(right)
        missed = np.linalg.norm(upper @ found + found @ upper - upper.diagonal() * found - right)
        return bool(missed <= self.ENOUGH * np.linalg.norm(right))

    def _call(self, phase: int, right: np.ndarray) -> np.ndarray:
        """Call PARDISO. The wrapper's way copies all entries in each call, and knows double precision only.

        Raises:
            PyPardisoError: what PARDISO says is wrong, by its number.
            ArithmeticError: there are no factors.
        """
        if self._entries is None:
            raise ArithmeticError("there are no factors: no matrix, or the last one was not positive definite")
        data, solver = self._entries.data, self._solver
        right = np.ascontiguousarray(right, data.dtype)
        found, error = np.empty_like(right), ctypes.c_int32(0)
        numbers = 1, 1, solver.mtype, phase, len(right), 1, 0  # of factors, which, of what, what to do, rows, columns
        many, which, kind, step, rows, columns, silent = (ctypes.byref(ctypes.c_int32(each)) for each in numbers)
        places = [_pointer(each, ctypes.c_int32) for each in (*self._entries.from_one, solver.perm)]
        values = [_pointer(each, ctypes.c_double) for each in (data, right, found)]
        handle, settings = _pointer(solver.pt, solver._pt_type[0]), _pointer(solver.iparm, ctypes.c_int32)
        call = handle, many, which, kind, step, rows, values[0], *places, columns, settings, silent, *values[1:]
        # Two threads gain nothing on small matrices, and wait for each other, spinning, where a core has other work.
        threads = solver.libmkl.MKL_Set_Num_Threads_Local(int(len(right) < MANY))
        try:
            solver.libmkl.pardiso(*call, ctypes.byref(error))
        finally:
            solver.libmkl.MKL_Set_Num_Threads_Local(threads)
        if error.value:
            raise PyPardisoError(error.value)
        return found

    def solve(self, right: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        return self._call(self.SOLVE, right).astype(np.float64)

    def close(self) -> None:
        """Free the factors."""
        self._solver.free_memory(everything=True)
        self._entries = None


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return one is other or np.array_equal(one, other)


def _pointer(values: np.ndarray, kind: type) -> Any:
    """As the library declares its arguments, which may be in single precision all the same."""
    return values.ctypes.data_as(ctypes.POINTER(kind))
