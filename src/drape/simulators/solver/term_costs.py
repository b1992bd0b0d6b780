"""The energies that a scene requires, the reason for each, and its cost."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.step import Step
from drape.energy.term import EnergyTerm

REPEATS = 5


class TermCost(NamedTuple):
    """One term of an incremental potential."""

    name: str
    reason: str
    """Reason for which the scene requires it."""
    seconds: float
    """Of one energy with its gradient."""
    hessian_seconds: float
    """Of its part of the Hessian."""


def term_costs(potential: IncrementalPotential, step: Step) -> list[TermCost]:
    """Medians for each term of ``potential`` at the start of ``step``, without the search for nearest faces."""

    def cost(term: EnergyTerm) -> TermCost:
        seconds = _median(lambda: term.energy_and_gradient(step.x, step))
        hessian = _median(lambda: term.rough_hessian(step.x, step))
        return TermCost(term.name, potential.reasons.get(term.name, ""), seconds, hessian)

    return [cost(term) for term in potential.terms]


def search_seconds(step: Step) -> float | None:
    """Cost of finding the nearest faces of a body, once a step; None without a body: nothing is searched."""
    if step.obstacle is None:
        return None
    began = time.perf_counter()
    _ = replace(step).near  # that of the step is there already
    return time.perf_counter() - began


def _median(call: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS + 1):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return sorted(times[1:])[REPEATS // 2]
