"""Factors solve, and give their memory back when nobody needs them."""

from __future__ import annotations

import gc

import numpy as np
from scipy import sparse

from drape.simulators.factorisation import Factorisation


def test_factors_solve_and_are_freed_with_their_owner():
    matrix = sparse.csr_array(sparse.diags([-1.0, 2.5, -1.0], [-1, 0, 1], (30, 30)))
    factors, right = Factorisation(matrix), np.arange(30.0)
    np.testing.assert_allclose(matrix @ factors.solve(right), right, atol=1e-12)
    close = factors.close
    assert close.alive
    del factors
    gc.collect()
    assert not close.alive
