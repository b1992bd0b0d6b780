"""What the analytic terms cost, in time of the processor, which a busy machine does not change: printed with ``-s``."""

from __future__ import annotations

import time

import pytest
import torch

from drape.energy.terms.bending import Bending
from drape.energy.terms.stvk import StVK
from drape.geometry.grid import square_grid
from drape.geometry.nearest_faces import NearestFaces
from drape.simulators.solver.term_costs import search_seconds
from tests.terms import make_step


def test_the_search_that_is_timed_is_made(monkeypatch):
    """Also for a step that has been told its nearest faces."""
    step, _ = make_step(square_grid(1.0, 5))
    step = step.with_near(step.near)
    searches, find = [], NearestFaces.find
    monkeypatch.setattr(NearestFaces, "find", lambda *args: searches.append(0) or find(*args))
    assert search_seconds(step) > 0.0
    assert len(searches) == 1


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_cost_of_the_physical_law(dtype):
    """StVK and bending of 7921 vertices; a loop over faces or a graph would take seconds."""
    step, x_next = make_step(square_grid(1.0, 89), dtype=dtype)
    total = 0.0
    for term in (StVK(), Bending()):
        for work in (term.energy_and_gradient, term.stencils):
            seconds = []
            for _ in range(10):
                start = time.process_time()
                work(x_next, step)
                seconds.append(time.process_time() - start)
            cost = 1e3 * min(seconds)
            print(f"{term.name} {work.__name__}: {cost:.2f} ms ({dtype}, {torch.get_num_threads()} threads)")
            total += cost if work.__name__ == "energy_and_gradient" else 0.0
    assert 0.0 < total < 1000.0
