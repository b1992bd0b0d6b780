"""The lines at the end of a training."""

from __future__ import annotations

from drape.metrics.record import RunRecord
from drape.report.summary import summary


def test_a_line_for_each_fabric_with_its_numbers():
    """Learned and known stiffness, residual and bars, energy error; no line for the mean over fabrics."""
    values = {
        "stretch_stiffness_N_per_m": 17000.0,
        "blender_stiffness_N_per_m": 17360.0,
        "force_residual_N": 0.125,
        "inertial_force_N": 1.5,
        "mass_spring_residual_N": 0.2,
        "energy_error_J2": 0.75,
    }
    metrics = {f"{name}/silk": value for name, value in values.items()} | {"inertial_force_N/overall": 3.0}
    lines = summary(RunRecord("eunet", "no_dissipation", 3, {}, {"steps": 20}, metrics, {})).splitlines()
    assert len(lines) == 2
    assert "eunet no_dissipation" in lines[0]
    assert all(number in lines[1] for number in ("1.7e+04", "1.74e+04", "0.125", "1.5", "0.2", "0.75"))
