"""The lines at the end of a training."""

from __future__ import annotations

from drape.metrics.record import MaterialRecord, RunRecord, SimulatorRecord
from drape.report.summary import summary


def test_a_line_for_each_fabric_with_its_numbers(tmp_path):
    """Learned and known stiffness, residual and bars, energy error; no line for the mean over fabrics."""
    values = {
        "stretch_stiffness_N_per_m": 17000.0,
        "blender_stiffness_N_per_m": 17360.0,
        "force_residual_N": 0.125,
        "inertial_force_N": 1.5,
        "spring_hinge_residual_N": 0.2,
        "energy_error_J2": 0.75,
    }
    metrics = {f"{name}/silk": value for name, value in values.items()} | {"inertial_force_N/overall": 3.0}
    setting = {"data": "cloth", "scale": "smoke", "width": 16, "steps": 20}
    known = ("command", "data", "train_sequences", "test_sequences", "seconds", "versions")
    record = RunRecord("eunet", "no_dissipation", 3, {}, setting, metrics, dict.fromkeys(known, ""))
    lines = summary(record.save(tmp_path)).splitlines()
    assert len(lines) == 2
    assert "eunet no_dissipation" in lines[0]
    assert all(number in lines[1] for number in ("1.7e+04", "1.74e+04", "0.125", "1.5", "0.2", "0.75"))


def test_what_a_simulator_has_learned(tmp_path):
    told = {"row": "hood", "ablation": "no_estimation", "seed": 1, "iterations": 7, "seconds": 61.2}
    watched = {"error_mm": 12.34, "inside_percent": 0.5, "ms_per_frame": 20.0}
    text = summary(SimulatorRecord(told, watched).save(tmp_path))
    for words in ("hood no_estimation", "seed 1, 7 iterations, 61 s", "error 12.3 mm", "0.50 %", "20 ms per frame"):
        assert words in text


def test_materials_that_stand_for_fabrics(tmp_path):
    record = MaterialRecord(
        {"silk": {"shear_modulus": 2.5e4}, "denim": {"shear_modulus": 3e4}},
        {"silk": {"nothing": 1.2, "estimated": 0.9}},
        {"seed": 0, "frames": 5, "steps": 2},
    )
    lines = summary(record.save(tmp_path)).splitlines()
    assert "2.5e+04" in lines[1]
    assert "nothing 1.200, estimated 0.900" in lines[1]
    assert "no frame to judge" in lines[2]


def test_a_trial_run_leaves_nothing(tmp_path):
    assert "a trial run" in summary(tmp_path / "metrics.json")
