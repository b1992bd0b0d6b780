"""The cloth that Blender simulates: clock, presets, random starts, acceptance; bpy only in processes of its own."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

import drape
from drape.blender import plan as plans
from drape.blender.choice import choose
from drape.blender.initial_state import random_state
from drape.blender.presets import fabric_settings, read_preset
from drape.blender.sequence import make_sequence
from drape.blender.sheet_sequence import DrawnSheet, reason_to_reject
from drape.data.stored_part import StoredSequence
from drape.errors import DrapeError
from drape.geometry.grid import square_grid

SOURCE = Path(drape.__file__).parents[1]
CONF = SOURCE.parent / "conf"
DATA = yaml.safe_load((CONF / "data" / "cloth.yaml").read_text(encoding="utf-8"))
SILK = yaml.safe_load((CONF / "material" / "silk.yaml").read_text(encoding="utf-8"))
needs_blender = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")

PULLED = """
import json, sys
import numpy as np
from drape.blender.cloth import simulate
from drape.blender.presets import read_preset
from drape.geometry.grid import square_grid
mesh, settings = square_grid(1.0, 4), read_preset("Cotton") | {"air_damping": 0.0}
pull = np.zeros((12, 3)); pull[:, 2] = -9.81; pull[:5] += (4.0, 0.0, 1.0)
def accelerations(fps, pins):
    x = simulate(mesh.rest_positions, mesh.faces, np.array(pins, int), settings, mesh.rest_positions, pull, fps)
    return x, (np.diff(x.astype(float), n=2, axis=0) * fps**2)
found = {fps: accelerations(fps, [])[1].mean(axis=1).tolist() for fps in (24, 30, 60)}
held = accelerations(30, [0, 3])[0]
ends = mesh.rest_positions[mesh.edges]
rest = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
def strain(x):
    ends = x[mesh.edges].astype(float)
    return float(np.abs(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1) / rest - 1).max())
wide = simulate(mesh.rest_positions, mesh.faces, np.array([], int), settings, 1.1 * mesh.rest_positions, 0 * pull, 30)
bend = mesh.rest_positions.copy(); bend[:, 2] = 0.3 * bend[:, 0] ** 2
leather = read_preset("Leather") | {"air_damping": 0.0}
flat = simulate(mesh.rest_positions, mesh.faces, np.array([], int), leather, bend, 0 * pull, 30)
json.dump({"free": found, "held": float(np.abs(held[:, [0, 3]] - held[0, [0, 3]]).max()),
           "moved": float(np.abs(held[-1] - held[0]).max()),
           "strain": [strain(x) for x in wide], "height": [float(np.ptp(x[:, 2])) for x in flat],
           "torch": "torch" in sys.modules}, sys.stdout)
"""


def python(code: str) -> str:
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={"PYTHONPATH": str(SOURCE)}, timeout=800
    )
    assert run.returncode == 0, run.stderr
    return run.stdout.strip().splitlines()[-1]


@pytest.fixture(scope="module")
def pulled() -> dict:
    """Second differences [m/s²] of a sheet that is pulled aside for five steps and falls freely afterwards."""
    return json.loads(python(PULLED))


@needs_blender
@pytest.mark.blender
@pytest.mark.parametrize("fps", ["24", "30", "60"])
def test_a_free_sheet_falls_with_the_stated_gravity(pulled: dict, fps: str) -> None:
    np.testing.assert_allclose(pulled["free"][fps][5:], np.tile([0.0, 0.0, -9.81], (6, 1)), atol=2e-3)


@needs_blender
@pytest.mark.blender
def test_the_extra_acceleration_acts_in_its_steps_only(pulled: dict) -> None:
    found = np.array(pulled["free"]["30"])
    np.testing.assert_allclose(found[:4], np.tile([4.0, 0.0, -8.81], (4, 1)), atol=2e-3)
    np.testing.assert_allclose(found[5:, 0], 0.0, atol=2e-3)


@needs_blender
@pytest.mark.blender
def test_the_rest_shape_is_the_flat_sheet_not_the_start(pulled: dict) -> None:
    """Without gravity a sheet that starts 10 % too large shrinks at once, and one that starts bent unbends."""
    assert pulled["strain"][0] == pytest.approx(0.1, abs=1e-5)
    assert min(pulled["strain"]) < 0.02
    assert min(pulled["height"]) < 0.5 * pulled["height"][0]


@needs_blender
@pytest.mark.blender
def test_pinned_vertices_stay_and_torch_does_not_come_along(pulled: dict) -> None:
    assert pulled["held"] == 0.0 < pulled["moved"]
    assert pulled["torch"] is False


def test_neither_worker_nor_generator_load_torch() -> None:
    modules = "drape.blender.worker, drape.blender.generation, drape.report.contact_sheet, drape.report.dataset_card"
    code = f"import sys, {modules}, generate; print([m for m in ('torch', 'lightning', 'bpy') if m in sys.modules])"
    assert python(code) == "[]"


@needs_blender
@pytest.mark.blender
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("Silk", (5, 0.15, 5, 0.05, 0)),
        ("Leather", (15, 0.4, 80, 150, 25)),
        ("Denim", (12, 1, 40, 10, 25)),
        ("Cotton", (5, 0.3, 15, 0.5, 5)),
    ],
)
def test_presets_are_those_of_blender_5(name: str, values: tuple[float, ...]) -> None:
    preset = read_preset(name)
    quality, mass, tension, bending, damping = values
    assert (preset["quality"], preset["mass"], preset["air_damping"]) == (quality, mass, 1)
    assert {preset[f"{kind}_stiffness"] for kind in ("tension", "compression", "shear")} == {tension}
    assert {preset[f"{kind}_damping"] for kind in ("tension", "compression", "shear")} == {damping}
    assert preset["bending_stiffness"] == bending


@needs_blender
@pytest.mark.blender
def test_the_papers_silk_bends_ten_times_harder_than_blenders() -> None:
    settings = fabric_settings("silk", SILK["silk"]["preset"], SILK["silk"]["overrides"])
    assert (settings["bending_stiffness"], settings["bending_damping"], settings["mass"]) == (0.5, 0.0, 0.15)
    with pytest.raises(DrapeError, match=r"silk.overrides.bending_stifness: .*did you mean 'bending_stiffness'"):
        fabric_settings("silk", "Silk", {"bending_stifness": 1.0})
    with pytest.raises(DrapeError, match=r"overrides.mass: found 'heavy'; expected a value like 0.15"):
        fabric_settings("silk", "Silk", {"mass": "heavy"})


def test_preset_files_are_read_not_run(tmp_path: Path) -> None:
    (tmp_path / "Odd.py").write_text("import bpy\nbpy.context.cloth.settings.mass = __import__('os').getpid()\n")
    with pytest.raises(DrapeError, match=r"Odd.py, line 2: found .*; expected bpy.context.cloth.settings.<name> = "):
        read_preset("Odd", tmp_path)
    with pytest.raises(DrapeError, match="no file Wool.py in .*; Blender ships Odd"):
        read_preset("Wool", tmp_path)


@pytest.mark.parametrize("curvature", [0.5, 10.0])
@pytest.mark.parametrize("number", range(10))
def test_a_random_start_is_an_unstrained_sheet_that_cannot_meet_itself(number: int, curvature: float) -> None:
    mesh, pins = square_grid(2.0, 15), np.array([0, 14])
    wild = DATA["start"] | {"turning": 170.0, "curvature": curvature, "swing": [-180.0, 180.0]}
    state = random_state(mesh.rest_positions, pins, wild, 0.5, np.random.default_rng(number))
    x = state.positions
    strain = np.linalg.norm(x[mesh.edges[:, 1]] - x[mesh.edges[:, 0]], axis=1) / mesh.rest_lengths - 1.0
    assert -0.05 < strain.min() <= strain.max() < 1e-3  # chords of arcs
    np.testing.assert_allclose(x[pins][:, 1:], 0.0, atol=1e-12)
    assert 0 < x[pins[1], 0] - x[pins[0], 0] <= 2.0 + 1e-6
    corners = x[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert (normals @ normals.T).min() > np.cos(np.radians(170.0))  # the whole sheet turns by no more than the bound
    hinge = np.arccos(np.clip((normals[mesh.edge_faces[:, 0]] * normals[mesh.edge_faces[:, 1]]).sum(1), -1, 1))
    assert hinge.max() < curvature / 2.0 * np.hypot(2.0 / 14, 2.0 / 14)  # curvature / size times the diagonal of a quad
    assert np.linalg.norm(state.push) <= wild["push"]
    assert wild["preroll"][0] <= state.preroll <= wild["preroll"][1]


def test_a_start_hangs_down_at_swing_zero_and_stiff_cloth_bends_less() -> None:
    mesh, pins = square_grid(1.0, 9), np.array([0, 8])
    still = DATA["start"] | {"swing": [0.0, 0.0], "turning": 0.0}
    x = random_state(mesh.rest_positions, pins, still, 0.5, np.random.default_rng(1)).positions
    np.testing.assert_allclose(x[-9:, 2], -1.0, atol=1e-6)
    down = DATA["start"] | {"swing": [0.0, 0.0]}
    states = [random_state(mesh.rest_positions, pins, down, b, np.random.default_rng(1)) for b in (0.5, 150.0, 1e6)]
    soft, stiff, stiffest = (np.ptp(state.positions[:, 1]) for state in states)
    assert soft > stiff > stiffest


def _still(mesh, frames: int = 6) -> np.ndarray:
    return np.repeat(mesh.rest_positions[None], frames, axis=0)


def test_sequences_are_rejected_by_the_stated_rule() -> None:
    mesh, gravity, bounds = square_grid(1.0, 4), np.array([0.0, 0.0, -9.81]), DATA["reject"]
    assert reason_to_reject(_still(mesh), mesh, 1 / 30, gravity, bounds) == ""
    broken, stretched, kicked = (_still(mesh) for _ in range(3))
    broken[3, 2, 1] = np.nan
    stretched[2] *= 1.0 + 1.1 * bounds["strain"]
    kicked[3:, :, 0] += 1.1 * np.sqrt(2 * bounds["energy"]) / 30  # one frame at a speed v with v²/2 above the bound
    assert "not finite" in reason_to_reject(broken, mesh, 1 / 30, gravity, bounds)
    assert "edge strain of 0.275" in reason_to_reject(stretched, mesh, 1 / 30, gravity, bounds)
    assert "energy change of 4.84" in reason_to_reject(kicked, mesh, 1 / 30, gravity, bounds)


def _small_plan() -> dict:
    request = plans.make_request(DATA | {"resolution": 4, "frames": 4}, SILK)
    return request | {"settings": {"silk": {"bending_stiffness": 0.5, "quality": 5, "mass": 0.15}}}


def _made(index: int, simulate: Callable[..., np.ndarray]) -> StoredSequence:
    return make_sequence(index, _small_plan(), partial(DrawnSheet, simulate=simulate)).sequence


def test_an_attempt_depends_on_seed_sequence_and_attempt_only() -> None:
    calls = []

    def simulate(rest, faces, pinned, settings, start, acceleration, fps):
        calls.append((start, acceleration))
        frames = np.repeat(np.asarray(rest, np.float32)[None], len(acceleration) + 1, axis=0)
        return frames * (np.nan if len(calls) in (1, 2) else 1.0)

    made = _made(5, simulate)
    assert (made.attempts, made.name, made.fabric, made.split) == (3, "000005", "silk", "train")
    assert made.mass_per_vertex == 0.15
    assert made.positions.shape == (4, 16, 3)
    again = _made(5, simulate)
    assert again.attempts == 1
    np.testing.assert_array_equal(calls[3][0], calls[0][0])
    assert not np.array_equal(calls[0][0], calls[1][0])
    pulled = calls[2][1]
    np.testing.assert_array_equal(pulled[-3:], np.tile([0.0, 0.0, -9.81], (3, 1)))  # the recorded steps
    assert not np.array_equal(pulled[0], pulled[-1])
    np.testing.assert_array_equal(again.positions, made.positions)


def test_a_sequence_that_is_always_rejected_says_so() -> None:
    def simulate(rest, faces, pinned, settings, start, acceleration, fps):
        return np.full((len(acceleration) + 1, len(rest), 3), np.nan, np.float32)

    with pytest.raises(DrapeError, match="refused 20 times, at last for a position that is not finite; widen"):
        _made(0, simulate)


def test_fabrics_come_in_equal_parts_in_both_splits() -> None:
    fabrics = ("silk", "leather", "denim", "cotton")
    plan = {"data": DATA, "material": dict.fromkeys(fabrics)}
    rows = [(choice.split, choice.fabric) for choice in (choose(index, plan) for index in range(1000))]
    assert {key: rows.count(key) for key in set(rows)} == {
        (split, fabric): count for split, count in (("train", 200), ("test", 50)) for fabric in fabrics
    }


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"szie": 1.0}, r"data.szie: no such key; did you mean data.size\?"),
        ({"size": "big"}, "data.size: found 'big'; expected a number from 0.001 on"),
        ({"frames": 2}, "data.frames: found 2; expected a whole number from 3 on"),
        ({"resolution": 8.5}, "data.resolution: found 8.5; expected a whole number from 3 on"),
        ({"pattern": "random"}, "data.pattern: found 'random'; expected one of uniform, alternating"),
        ({"counts": {"train": 0, "test": 0}}, "data.counts: no sequences"),
        ({"counts": {"train": 8}}, "data.counts.test: missing"),
        ({"start": DATA["start"] | {"turning": 200}}, "data.start.turning: found 200; expected a number from 0 to 179"),
        ({"start": DATA["start"] | {"swing": [3, 1]}}, r"data.start.swing: found \[3, 1\]; expected the lower number"),
        ({"start": DATA["start"] | {"preroll": 3}}, r"data.start.preroll: found 3; expected \[lowest, highest\]"),
        ({"seed": True}, "data.seed: found True; expected a whole number"),
    ],
)
def test_a_data_node_with_a_mistake_is_refused(change: dict, sentence: str) -> None:
    with pytest.raises(DrapeError, match=sentence):
        plans.make_request(DATA | change, SILK)


def test_a_material_node_with_a_mistake_is_refused() -> None:
    with pytest.raises(DrapeError, match="material: no fabric"):
        plans.make_request(DATA, {})
    with pytest.raises(DrapeError, match="material.silk: found .*; expected the keys preset and overrides only"):
        plans.make_request(DATA, {"silk": {"preset": "Silk", "override": {}}})


def test_a_missing_blender_names_python_and_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DrapeError, match=r'bpy 5.0.1, which needs Python 3.11 .*pip install -e "\.\[blender\]"'):
        plans.make_plan(plans.make_request(DATA, SILK))
