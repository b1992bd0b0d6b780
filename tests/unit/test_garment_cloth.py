"""A garment that Blender simulates: clock, pins, rest shape, contact; and the quality control of what comes out."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import drape
from drape.blender.garment_quality import MEASURES, inside_body, measure_quality, reason_to_refuse
from drape.geometry.mesh import ClothMesh

SOURCE = Path(drape.__file__).parents[1]
BOUNDS = {"inside": 0.002, "self_intersection": 0.005, "stretch": 1.4, "speed": 15.0, "attempts": 5}
needs_blender = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")

TUBES = """
import json, sys
import numpy as np, trimesh
from drape.blender.crossing_faces import crossing_faces
from drape.blender.dressed_body import DressedBody
from drape.blender.garment_cloth import simulate_garment
from drape.blender.presets import read_preset
around, down = 30, 8
angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, around, endpoint=False), np.linspace(0.1, -0.25, down))
tube = np.stack([0.23 * np.cos(angle), 0.23 * np.sin(angle), height], -1).reshape(-1, 3)
a = (np.arange(down - 1)[:, None] * around + np.arange(around)).reshape(-1)
b = (np.arange(down - 1)[:, None] * around + (np.arange(around) + 1) % around).reshape(-1)
faces = np.concatenate([np.stack([a, b + around, b], 1), np.stack([a, a + around, b + around], 1)])
ball = trimesh.creation.icosphere(3, 0.2)
sphere, sphere_faces = np.asarray(ball.vertices), np.asarray(ball.faces, np.int64)
loop, none = np.arange(around), np.zeros(0, np.int64)
cotton = read_preset("Cotton") | {"quality": 10}
still_air = cotton | {"air_damping": 0.0}
contact = dict(thickness=0.004, distance=0.004, self_distance=0.004, friction=0.02, damping=0.1, quality=3)
def run(pinned, path, start=tube, settings=cotton, gravity=9.81, fps=30.0, away=0.0, body=None):
    led, ball = path[:, None], (path if body is None else body)[:, None]
    dressed = DressedBody(tube, faces, pinned, tube[pinned] + led, sphere_faces, sphere + ball + [0, 0, away])
    return simulate_garment(dressed, start, settings, contact, np.array([0, 0, -gravity]), fps)
still = np.zeros((14, 3))
fall = {fps: (np.diff(run(none, still, settings=still_air, fps=fps, away=-50.0).astype(float), n=2, axis=0)
              * fps**2).mean(1).tolist() for fps in (24.0, 30.0)}
t = np.arange(40) / 30
path = np.stack([0.15 * np.sin(2 * np.pi * t), 0 * t, 0.1 * np.sin(4 * np.pi * t)], 1)
moved = run(loop, path)
swaying = np.stack([0.1 * np.sin(2 * np.pi * t), 0 * t, 0 * t], 1)
bumped = run(loop, 0 * swaying, body=swaying)
beside = tube + np.array([1e-3, 0.0, 0.0])
shifted = run(loop, path, start=beside)
wide = tube * [1.1, 1.1, 1.0]
pinned_wide = wide.copy(); pinned_wide[loop] = tube[loop]
radius = lambda x: np.linalg.norm(x[..., :2], axis=-1)
free, held = (run(pins, still, start=start, settings=still_air, gravity=0.0, away=-50.0)
              for pins, start in ((none, wide), (loop, pinned_wide)))
cross = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [0.3, 0.3, 0.5], [5, 0, 0], [6, 0, 0],
                  [5, 1, 0]], float)
json.dump({"fall": fall,
           "led": float(np.abs(moved[:, loop] - tube[loop] - path[:, None]).max()),
           "shifted": float(np.abs(shifted[:, loop] - beside[loop] - path[:, None]).max()),
           "reach": float(np.abs(path).max()),
           "clearance": float((np.linalg.norm(bumped - swaying[:, None], axis=-1) - 0.2)[:, around:].min()),
           "pushed": float(np.abs(bumped - tube).max()),
           "same": bool(np.array_equal(moved, run(loop, path))),
           "free": radius(free).mean(1).tolist(), "held": radius(held[:, 60:]).mean(1).tolist(),
           "crossing": crossing_faces(cross, np.array([[0, 1, 2], [3, 4, 5], [6, 7, 8]])).tolist(),
           "tube": bool(crossing_faces(tube, faces).any()),
           "torch": "torch" in sys.modules}, sys.stdout)
"""


@pytest.fixture(scope="module")
def tubes() -> dict:
    """A tube of cloth around a ball, in several experiments."""
    run = subprocess.run(
        [sys.executable, "-c", TUBES], capture_output=True, text=True, env={"PYTHONPATH": str(SOURCE)}, timeout=800
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.strip().splitlines()[-1])


@needs_blender
@pytest.mark.blender
@pytest.mark.parametrize("fps", ["24.0", "30.0"])
def test_a_garment_falls_freely_with_the_stated_gravity(tubes: dict, fps: str) -> None:
    found = np.array(tubes["fall"][fps])
    np.testing.assert_allclose(found, np.tile([0.0, 0.0, -9.81], (len(found), 1)), atol=5e-3)


@needs_blender
@pytest.mark.blender
def test_a_pinned_loop_is_where_it_is_led_also_from_a_start_beside(tubes: dict) -> None:
    assert tubes["led"] < 1e-6
    assert tubes["shifted"] < 1e-6
    assert tubes["reach"] > 0.1


@needs_blender
@pytest.mark.blender
def test_the_rest_shape_is_the_garment_whatever_the_start(tubes: dict) -> None:
    """Without gravity a tube that starts 10 % too wide shrinks to its rest radius, pinned or not."""
    for name in ("free", "held"):
        assert tubes[name][0] == pytest.approx(1.1 * 0.23, abs=1e-5)
        assert tubes[name][-1] == pytest.approx(0.23, abs=2e-3)


@needs_blender
@pytest.mark.blender
def test_a_moving_body_is_not_entered_and_all_is_repeatable(tubes: dict) -> None:
    assert tubes["pushed"] > 0.05
    assert 0.002 < tubes["clearance"] < 0.015
    assert tubes["same"] is True
    assert tubes["torch"] is False


@needs_blender
@pytest.mark.blender
def test_faces_that_pass_through_others_are_found(tubes: dict) -> None:
    assert tubes["crossing"] == [True, True, False]
    assert tubes["tube"] is False


def ball(radius: float, centre: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    made = trimesh.creation.icosphere(3, radius)
    return np.asarray(made.vertices) + [centre, 0.0, 0.0], np.asarray(made.faces, np.int64)


def test_inside_is_right_where_the_body_passes_through_itself() -> None:
    """Two balls that overlap: a point in both is inside, one between their far ends and the air is not."""
    (one, faces), (other, _) = ball(0.2), ball(0.2, 0.25)
    body, both = np.concatenate([one, other]), np.concatenate([faces, faces + len(one)])
    points = np.array([[0.125, 0.0, 0.0], [-0.15, 0.0, 0.0], [0.125, 0.19, 0.0], [-0.21, 0.0, 0.0], [0.5, 0.5, 0.5]])
    assert inside_body(points, body, both).tolist() == [True, True, False, False, False]


def measured(positions: np.ndarray, crossing=lambda x, faces: np.zeros(len(faces), bool)) -> dict[str, float]:
    rest, faces = ball(0.25)
    body, body_faces = ball(0.2)
    mesh = ClothMesh.from_faces(rest, faces)
    return measure_quality(positions, mesh, np.repeat(body[None], len(positions), 0), body_faces, 1 / 30, crossing)


def still(frames: int = 5) -> np.ndarray:
    return np.repeat(ball(0.25)[0][None], frames, axis=0)


def test_a_garment_that_stays_is_accepted() -> None:
    found = measured(still())
    assert set(found) == set(MEASURES)
    assert reason_to_refuse(found, BOUNDS) == ""
    assert found["stretch_mean"] == pytest.approx(1.0)
    assert (found["inside_worst"], found["speed"]) == (0.0, 0.0)


def test_each_fault_is_measured_and_refused() -> None:
    entered, stretched, kicked, broken = (still() for _ in range(4))
    entered[2, :10] *= 0.15 / 0.25
    stretched *= 1.5
    kicked[3:, :, 0] += 0.6
    broken[1, 3, 2] = np.nan
    found = measured(entered)
    assert found["inside_worst"] == pytest.approx(10 / 642)
    assert found["inside_mean"] == pytest.approx(2 / 642)
    assert found["depth"] == pytest.approx(0.05, abs=1e-3)
    assert "inside_worst 0.01558 of the vertices inside the body (bound 0.002)" in reason_to_refuse(found, BOUNDS)
    assert "stretch_99 1.5 times" in reason_to_refuse(measured(stretched), BOUNDS)
    assert "speed 18 m/s" in reason_to_refuse(measured(kicked), BOUNDS)
    assert "not finite" in reason_to_refuse(measured(broken), BOUNDS)
    crossed = measured(still(), lambda x, faces: np.arange(len(faces)) < 13)
    assert "self_intersection_mean 0.01016 of the faces" in reason_to_refuse(crossed, BOUNDS)
