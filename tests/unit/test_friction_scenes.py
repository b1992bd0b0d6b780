"""Friction in whole scenes: a sheet on slopes, pushed and turned, beside a block; in our solver and in Blender."""

from __future__ import annotations

import importlib.util
import math
from functools import partial

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from drape.benchmark.composed import Composed
from drape.benchmark.friction import Friction
from drape.benchmark.sheet_on_plate import SheetOnPlate, slides_from
from drape.blender.cloth_on_body import ClothOnBody, check_comparable
from drape.blender.presets import read_preset
from drape.config import check_config, instantiate
from drape.config.entry_point import CONF
from drape.errors import DrapeError
from drape.scene.scene import Scene
from tests.unit.test_benchmark import hanging_scene

needs_blender = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")
G, MU = 9.81, 0.3


def block(scene: Scene, friction: float = 1.0) -> np.ndarray:
    """Positions of a rigid sheet with ``friction`` times Coulomb's of the scene, on a plate that lies in its plane."""
    x, v, frames = scene.initial.x, np.zeros(3), [scene.initial.x]
    normal = -scene.gravity[2]
    for frame in range(scene.frames):
        before, after = scene.obstacle.at(frame), scene.obstacle.at(frame + 1)
        to_plane, _, rank, _ = np.linalg.lstsq(before - before.mean(0), after - after.mean(0), rcond=None)
        assert rank == 2
        centre = x.mean(0) * [1, 1, 0]
        carried = ((centre - before.mean(0)) @ to_plane + after.mean(0) - centre) / scene.dt
        free = v + scene.dt * scene.gravity * [1, 1, 0]
        slip = free - carried * [1, 1, 0]
        most = friction * scene.friction * normal * scene.dt
        speed = np.linalg.norm(slip)
        v = free - slip * min(1.0, most / max(speed, 1e-12))
        x = x + scene.dt * v
        frames.append(x)
    return np.stack(frames)


@pytest.fixture(scope="module")
def config():
    with initialize_config_dir(str(CONF), version_base=None):
        found = compose("benchmark", ["measure=friction"])
    check_config(found, contents="benchmark")
    return found


@pytest.fixture(scope="module")
def sheet(config) -> SheetOnPlate:
    smaller = {"size": 0.05, "resolution": 3, "frames": 12, "settle": 6}
    return SheetOnPlate(instantiate(config.fabric), **{**config.measure.sheet, **smaller})


@pytest.fixture(scope="module")
def measure(config) -> Friction:
    return instantiate(config.measure)


@pytest.fixture(scope="module")
def solver(config, measure):
    return measure._solver(Composed(config), "phys")


@pytest.fixture(scope="module")
def blender(config):
    settings = read_preset("Cotton") | {"air_damping": 0.0, "quality": 10}
    simulate = ClothOnBody(settings, config.measure.blender)
    yield simulate
    simulate.close()


def sliding(tangent: float, coefficient: float = MU) -> float:
    angle = math.atan(tangent)
    return G * (math.sin(angle) - coefficient * math.cos(angle))


@pytest.mark.parametrize("friction", [1.0, 0.8])
def test_a_block_is_measured_as_what_it_is(sheet, friction):
    """Also one with less friction than it is told, so that the numbers are those of the motion."""
    simulate = partial(block, friction=friction)
    assert slides_from(sheet, simulate, MU, 2e-3, 12) == pytest.approx(friction * MU, abs=2e-4)
    assert sheet.slope(simulate, MU, 0.6).acceleration == pytest.approx(sliding(0.6, friction * MU), rel=1e-6)
    assert sheet.slope(simulate, MU, 0.15).speed == pytest.approx(0.0, abs=1e-9)
    assert sheet.pushed(simulate, MU, 2 * MU * G) == pytest.approx(0.5 * friction, rel=1e-6)
    assert sheet.pushed(simulate, MU, 0.5 * friction * MU * G) == pytest.approx(1.0, rel=1e-6)
    assert sheet.turned(simulate, MU, 1.0, 0.3) == pytest.approx(1.0, abs=1e-4)
    assert sheet.turned(partial(block, friction=0.01), MU, 1.0, 0.3) < 0.5


def test_our_solver_rests_below_the_limit_and_slides_above(sheet, solver):
    below, above = (sheet.slope(solver, MU, share * MU) for share in (0.95, 1.05))
    assert abs(below.acceleration) < 2e-3
    assert below.speed < 1e-3  # it creeps
    assert above.acceleration == pytest.approx(sliding(1.05 * MU), rel=0.03)


@pytest.mark.parametrize("coefficient", [0.02, 0.3])
def test_our_solver_slides_as_a_block(sheet, solver, coefficient):
    found = sheet.slope(solver, coefficient, 2 * coefficient).acceleration
    assert found == pytest.approx(sliding(2 * coefficient, coefficient), rel=0.02)


def test_a_plate_that_is_pushed_aside_takes_the_cloth_of_our_solver_along(sheet, solver):
    assert sheet.pushed(solver, MU, 2 * MU * G) == pytest.approx(0.5, rel=0.02)
    assert sheet.pushed(solver, MU, 0.5 * MU * G) == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize(("coefficient", "share"), [(MU, 1.0), (0.02, 0.283)])
def test_a_plate_that_turns_takes_the_cloth_of_our_solver_along(sheet, solver, coefficient, share):
    """Within the limit of μ all the way, else as the block."""
    assert sheet.turned(block, coefficient, 1.0, 0.3) == pytest.approx(share, rel=0.02)
    assert sheet.turned(solver, coefficient, 1.0, 0.3) == pytest.approx(share, rel=0.02)


@needs_blender
@pytest.mark.blender
def test_the_sheet_of_blender_slides_as_a_block_of_the_coefficient(sheet, blender):
    for coefficient in (0.02, 0.3, 0.8):
        found = sheet.slope(blender, coefficient, 2 * coefficient).acceleration
        assert found == pytest.approx(sliding(2 * coefficient, coefficient), abs=0.002 * G)
    assert slides_from(sheet, blender, MU, 2e-3, 6) == pytest.approx(MU, rel=0.02)


@needs_blender
@pytest.mark.blender
def test_a_plate_takes_the_cloth_of_blender_along(sheet, blender):
    assert sheet.pushed(blender, MU, 2 * MU * G) == pytest.approx(0.5, rel=0.02)
    assert sheet.pushed(blender, MU, 0.5 * MU * G) == pytest.approx(1.0, rel=0.01)
    assert sheet.turned(blender, MU, 1.0, 0.3) == pytest.approx(1.0, rel=0.02)


def test_what_blender_cannot_do_the_same_is_refused():
    with pytest.raises(DrapeError, match="scene test: found no body; expected a cloth of equal masses .* change"):
        check_comparable(hanging_scene())


@pytest.mark.parametrize("values", [[], [0.3, 0.9], [0.0]])
def test_coefficients_that_blender_cannot_have_are_refused(config, values):
    with pytest.raises(DrapeError, match=r"measure.coefficients: found .*; expected numbers above 0 up to 0.8"):
        instantiate(config.measure, coefficients=values)


@needs_blender
@pytest.mark.blender
def test_the_table_has_a_row_for_each_coefficient_and_simulator(config, measure, monkeypatch):
    class Stub:
        def __init__(self, settings, contact):
            assert (settings["air_damping"], settings["quality"]) == (0.0, 10)

        def __call__(self, scene: Scene) -> np.ndarray:
            return block(scene, 0.8)

        def close(self) -> None:
            pass

    monkeypatch.setattr("drape.benchmark.friction.ClothOnBody", Stub)
    monkeypatch.setattr(Friction, "_solver", lambda self, composed, name: block)
    rows = measure.measure(config).rows
    assert [(row["coefficient"], row["simulator"]) for row in rows] == [
        (value, name) for value in (0.02, 0.1, 0.3, 0.8) for name in ("Blender", "phys")
    ]
    for row in rows:
        off = -20.0 if row["simulator"] == "Blender" else 0.0
        assert row["off_percent"] == pytest.approx(off, abs=1.5)
        assert row["turned_percent"] == pytest.approx(100.0, abs=1.0)
        assert row["pushed_percent"] == pytest.approx(0.5 * (100.0 + off))
