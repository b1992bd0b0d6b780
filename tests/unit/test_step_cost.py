"""The cost of a training step: phases add up, and the networks are asked what the step asked them."""

from __future__ import annotations

from itertools import repeat

import pytest

from drape.loss.energy_balance import EnergyBalance
from drape.loss.force_residual import ForceResidual
from drape.training.step_cost import StepCost
from tests.energies import make_energy, make_window


@pytest.mark.parametrize("loss", [{"balance": EnergyBalance(1.0)}, {"force": ForceResidual(1.0, 1.0)}])
def test_phases_add_up_and_units_are_left_as_they_were(loss, cloth_batch):
    """Positive times; the step is about the sum of its phases; nothing stays wrapped around the units."""
    energy = make_energy("hinge", "damping", timed=True)
    before = [unit.energies for unit in energy.units.values()]
    cost = StepCost(energy, loss, repeat(make_window(cloth_batch)))
    seconds = cost.measure(repeats=3)
    assert all(value > 0 for value in seconds.values())
    phases = sum(seconds[name] for name in ("data", "forward", "backward", "optimizer"))
    assert seconds["step"] == pytest.approx(phases, rel=0.5)
    assert [unit.energies for unit in energy.units.values()] == before


def test_energies_are_recorded_with_what_needs_slopes(cloth_batch):
    """The step evaluates potential and dissipation at t+1, with slopes, and the potential at t, without."""
    energy = make_energy("mlp", "speed")
    cost = StepCost(energy, {"balance": EnergyBalance(1.0)}, repeat(make_window(cloth_batch)))
    cost.measure(repeats=1)
    assert sorted(inputs.requires_grad for _, inputs, _ in cost.calls) == [False, True, True]
