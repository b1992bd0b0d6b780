"""The cost of a training step: phases add up, and the networks are asked what the step asked them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate, chain, repeat
from types import SimpleNamespace

import pytest

from drape.loss.energy_balance import EnergyBalance
from drape.loss.force_residual import ForceResidual
from drape.training.step_cost import WARM_UP, StepCost
from tests.energies import make_energy, make_window


def clock() -> Iterator[float]:
    """Each look is later by 1, 2, 4, 8 s within a step, then by 16 s, and by 32 s for the networks; 100 times at first.

    The last of three steps that count takes 10 times as long: the median is not changed by that.
    """
    row = (16.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
    return accumulate(times * part for times in chain(WARM_UP * (100.0,), (1.0, 1.0, 10.0)) for part in row)


@pytest.mark.parametrize("loss", [{"balance": EnergyBalance(1.0)}, {"force": ForceResidual(1.0, 1.0)}])
def test_phases_add_up_and_units_are_left_as_they_were(loss, cloth_batch, monkeypatch):
    """By a clock of its own, slow at first; medians of what is counted; nothing stays wrapped around the units."""
    monkeypatch.setattr("drape.training.step_cost.time", SimpleNamespace(perf_counter=clock().__next__))
    energy = make_energy("hinge", "damping", timed=True)
    before = [unit.energies for unit in energy.units.values()]
    cost = StepCost(energy, loss, repeat(make_window(cloth_batch)))
    expected = {"data": 1.0, "forward": 2.0, "backward": 4.0, "optimizer": 8.0, "step": 15.0, "networks": 32.0}
    assert cost.measure(repeats=3) == pytest.approx(expected)
    assert [unit.energies for unit in energy.units.values()] == before


def test_energies_are_recorded_with_what_needs_slopes(cloth_batch):
    """The step evaluates potential and dissipation at t+1, with slopes, and the potential at t, without."""
    energy = make_energy("mlp", "speed")
    cost = StepCost(energy, {"balance": EnergyBalance(1.0)}, repeat(make_window(cloth_batch)))
    cost.measure(repeats=1)
    assert sorted(inputs.requires_grad for _, inputs, _ in cost.calls) == [False, True, True]
