"""Factors solve, and give their memory back when nobody needs them."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from scipy import sparse

from drape.linalg.factorisation import Factorisation


def chain(stiffness: float, count: int = 30) -> sparse.csr_array:
    """Springs in a row, each end held by a soft spring."""
    return sparse.csr_array(sparse.diags([-1.0, 2.0 + 1.0 / stiffness, -1.0], [-1, 0, 1], (count, count)) * stiffness)


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("stiffness", [2.0, 1e4, 1e12, 1e-12, 1e200])
def test_one_matrix_after_the_other(stiffness, single):
    """The same places with other values, then other places; from well to badly conditioned, over many orders."""
    factors = Factorisation(single=single)
    for matrix in (chain(1.0), chain(stiffness), 3.0 * chain(stiffness), chain(stiffness, 41)):
        factors.factorise(sparse.triu(matrix, format="csr"))
        right = np.linspace(-1.0, 2.0, matrix.shape[0])
        missed = np.linalg.norm(matrix @ factors.solve(right) - right)
        assert missed < (2e-3 if single else 1e-9) * np.linalg.norm(right)


def test_what_cannot_be_factorised_is_said():
    factors = Factorisation()
    with pytest.raises(ArithmeticError, match="not positive definite"):
        factors.factorise(sparse.triu(chain(1.0) - 9.0 * sparse.eye_array(30), format="csr"))
    with pytest.raises(ArithmeticError, match="not finite"):
        factors.factorise(chain(np.nan))
    factors.factorise(sparse.triu(chain(1.0), format="csr"))
    np.testing.assert_allclose(chain(1.0) @ factors.solve(np.ones(30)), np.ones(30), atol=1e-4)


def test_factors_are_freed_with_their_owner():
    factors = Factorisation()
    factors.factorise(sparse.triu(chain(1.0), format="csr"))
    close = factors.close
    assert close.alive
    del factors
    gc.collect()
    assert not close.alive


@pytest.mark.skipif(Factorisation().library != "PARDISO", reason="SuperLU keeps the factors of the last good matrix")
def test_there_is_no_solution_without_factors():
    factors = Factorisation()
    factors.factorise(sparse.triu(chain(1.0), format="csr"))
    with pytest.raises(ArithmeticError):
        factors.factorise(sparse.triu(chain(1.0) - 9.0 * sparse.eye_array(30), format="csr"))
    with pytest.raises(ArithmeticError, match="there are no factors"):
        factors.solve(np.ones(30))
