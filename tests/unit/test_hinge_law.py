"""What of a recording's damping is a fabric's own."""

from __future__ import annotations

import pytest

from drape.energy.law.hinge_law import fabrics_damper


@pytest.mark.parametrize("steps", [4, 5, 15])
def test_what_a_recorders_steps_damp_is_not_the_fabrics(steps):
    assert fabrics_damper(1000.0 / 30 / steps**2, stiffness=1000.0, dt=1 / 30) == 0.0


def test_a_damper_that_steps_do_not_explain_is():
    assert fabrics_damper(20.0, stiffness=1000.0, dt=1 / 30) == 20.0
    assert fabrics_damper(-20.0, stiffness=0.0, dt=1 / 30) == 0.0
