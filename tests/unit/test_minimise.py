"""Parts of the minimiser by numbers that can be told beforehand."""

from __future__ import annotations

from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from drape.energy.incremental_potential import Evaluation
from drape.geometry.grid import square_grid
from drape.simulators.solver.minimise import SUFFICIENT, Minimiser, _Place, _shorter
from tests.terms import make_step


def bare(**attributes: object) -> Minimiser:
    """A minimiser of nothing, with some of its parts."""
    made = Minimiser.__new__(Minimiser)
    vars(made).update(attributes)
    return made


def test_the_residual_is_the_mean_norm_over_free_vertices():
    place = _Place(torch.zeros(3, 3), None, np.array([3.0, 4.0, 0.0, 0.0, 0.0, 1.0]))
    assert place.residual == pytest.approx(3.0)


@pytest.mark.parametrize(("gained", "share"), [(0.5, 1 / 3), (0.0, 0.5), (99.0, 0.1), (np.inf, 0.1), (-2.0, 0.5)])
def test_a_step_is_shortened_to_the_minimum_of_the_parabola(gained, share):
    """``g(s) = -s + (gained + 1) s²`` is least at ``1 / (2 (gained + 1))``; never below a tenth or above a half."""
    assert _shorter(gained, -1.0) == pytest.approx(share)


@pytest.mark.parametrize(("free", "share"), [(1.0, 1.0), (0.5, 0.45), (0.0, 0.0)])
def test_a_way_that_a_barrier_stops_ends_short_of_it(free, share):
    barrier = SimpleNamespace(free_share=lambda *_: free)
    step, x = make_step(square_grid(1.0, 3))
    assert bare(potential=SimpleNamespace(barrier=barrier))._free_share(x, x, step) == pytest.approx(share)
    assert bare(potential=SimpleNamespace(barrier=None))._free_share(x, x, step) == 1.0


def test_directions_fulfil_the_secant_equation():
    """The metric maps the last turn of the gradient to the change of positions that brought it about."""
    rng = np.random.default_rng(0)
    minimiser = bare(_factors=SimpleNamespace(solve=lambda wanted: 0.3 * wanted))
    pairs: deque = deque()
    for _ in range(3):
        change = rng.normal(size=6)
        turn = change * rng.uniform(1.0, 3.0, 6)
        pairs.append((change, turn, change @ turn))
    np.testing.assert_allclose(minimiser._direction(pairs[-1][1], pairs), -pairs[-1][0], atol=1e-12)
    np.testing.assert_allclose(minimiser._direction(np.ones(6), deque()), -0.3)
    one, other = rng.normal(size=(2, 6))
    symmetric = one @ minimiser._direction(other, deque(pairs)), other @ minimiser._direction(one, deque(pairs))
    assert symmetric[0] == pytest.approx(symmetric[1])


def test_a_step_that_gains_less_than_its_share_is_shortened():
    """``E = -s + c s²``: the whole way brings half of what it must bring, half of the way enough."""
    curvature = 1.0 - 0.5 * SUFFICIENT

    def evaluate(x: torch.Tensor, step: object) -> Evaluation:
        s = x[0, 0]
        gradient = torch.tensor([[-1.0 + 2.0 * curvature * s, 0.0, 0.0]], dtype=torch.float64)
        return Evaluation(float(-s + curvature * s**2), gradient, {}, 0.0, 0.0)

    potential = SimpleNamespace(evaluate=evaluate, barrier=None)
    minimiser = bare(potential=potential, free=torch.ones(1, dtype=torch.bool), _slots=np.arange(3))
    step, _ = make_step(square_grid(1.0, 3))
    here = minimiser._at(torch.zeros(1, 3, dtype=torch.float64), step)
    there, tried = minimiser._search(here, np.array([1.0, 0.0, 0.0]), step, 10)
    assert tried == 2
    assert there.x[0].tolist() == [0.5, 0.0, 0.0]
