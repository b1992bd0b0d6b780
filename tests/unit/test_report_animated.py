"""What is said at the end of an animation: from the file alone, and true."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from drape.data.animation_hdf5 import AnimationHeader
from drape.data.animation_writer import AnimationWriter
from drape.energy.terms.ipc import Barrier
from drape.geometry.grid import square_grid
from drape.report.animated import animated, spans
from drape.scene.material import Material
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.rollout import COLUMNS, roll_out
from drape.simulators.simulator import Outcome, StepResult
from drape.simulators.solver.balance import HANGING, mean_weight
from tests.unit.test_ipc import dented, ipc

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
MESH = square_grid(1.0, 4)
REST = MESH.rest_positions.astype(np.float64)
CONVERGED, ITERATIONS, NOT_FINITE = Outcome.CONVERGED, Outcome.ITERATIONS, Outcome.NOT_FINITE
OK = (CONVERGED, 5e-4)


def scene_of(frames: int, **changes: object) -> Scene:
    parts = {"gravity": np.array([0.0, 0.0, -9.81]), "mass": np.full(16, 0.02)} | changes
    return Scene("told", MESH, State.at_rest(REST), SILK, dt=1 / 30, frames=frames, **parts)


class Told:
    """Ends its frames as it is told: outcome and residual in weights; stops after so many."""

    def __init__(self, scene: Scene, frames: list[tuple[Outcome, float]], barrier: Barrier | None = None):
        self.weight, self.frames, self.barrier = mean_weight(scene), frames, barrier

    def step(self, state: State, frame: int) -> StepResult:
        outcome, missed = self.frames[frame]
        return StepResult(state, outcome, 7, missed * self.weight)


def said(
    folder: Path,
    scene: Scene,
    frames: list[tuple[Outcome, float]],
    stop: int | None = None,
    barrier: Barrier | None = None,
) -> str:
    """The words at the end; with ``stop``, of an animation that was interrupted there and continued."""
    path = folder / "animation.h5"
    if stop is not None:
        with pytest.raises(IndexError), AnimationWriter(path, AnimationHeader.of_scene(scene, COLUMNS, "{}")) as writer:
            roll_out(Told(scene, frames[:stop], barrier), scene, writer)
    with AnimationWriter(path, AnimationHeader.of_scene(scene, COLUMNS, "{}")) as writer:
        roll_out(Told(scene, frames, barrier), scene, writer)
    return animated(path, scene, [path], barrier)


def test_all_frames_of_the_file_are_counted_and_named(tmp_path):
    """Also those that an earlier call has made."""
    frames = [OK, (ITERATIONS, 0.01), (ITERATIONS, 0.03), (ITERATIONS, 0.02), OK, (ITERATIONS, 0.01)]
    words = said(tmp_path, scene_of(6), frames, stop=4)
    assert "told: 6 frames of 16 vertices, silk" in words
    assert "4 of 6 frames (2-4, 6) stopped at the maximum of iterations" in words


@pytest.mark.parametrize("missed", [0.002, 0.9 * HANGING])
def test_frames_near_balance_are_usable(tmp_path, missed):
    words = said(tmp_path, scene_of(2), [OK, (ITERATIONS, missed)])
    assert f"usable: forces balance to within {missed:.2g} weights" in words
    assert "hangs in the air" not in words


def test_frames_far_from_balance_hang_in_the_air(tmp_path):
    frames = [OK, (ITERATIONS, 0.01), (ITERATIONS, 1.1 * HANGING), (Outcome.PRECISION, 3.2)]
    words = said(tmp_path, scene_of(4), frames)
    assert "2 of 4 frames (3-4) leave cloth unbalanced by up to 3.2 times its weight: it hangs in the air" in words
    assert "raise simulator.iterations" in words
    assert "usable" not in words


def test_a_tolerance_that_lets_cloth_hang_is_named(tmp_path):
    words = said(tmp_path, scene_of(1), [(CONVERGED, 1.0)])
    assert "hangs in the air" in words
    assert "simulator.tolerance is too large" in words


def test_nothing_is_said_of_frames_that_converged(tmp_path):
    words = said(tmp_path, scene_of(2), [OK, OK])
    assert not any(word in words for word in ("usable", "hangs", "moved out", "of 2 frames"))


@pytest.mark.parametrize("missed", [math.nan, math.inf])
def test_what_is_not_a_number_is_not_usable_and_stops_nothing(tmp_path, missed):
    for number, frames in enumerate(([(NOT_FINITE, missed)] * 2, [OK, (ITERATIONS, missed)])):
        words = said(tmp_path / str(number), scene_of(2), frames)
        assert "usable" not in words
        assert "animation.h5" in words


@pytest.mark.parametrize(
    ("changes", "weight"),
    [
        ({}, 0.02 * 9.81),
        ({"gravity": np.array([0.0, 1.62, 0.0])}, 0.02 * 1.62),
        ({"gravity": np.zeros(3)}, 0.02 * 9.81),
        ({"mass": np.r_[8.0, np.full(15, 0.02)], "pins": Pins.fixed([0], REST)}, 0.02 * 9.81),
    ],
)
def test_forces_are_told_in_weights_of_a_free_vertex(tmp_path, changes, weight):
    scene = scene_of(1, **changes)
    assert mean_weight(scene) == pytest.approx(weight)
    assert "mean unbalanced force 0.05 times the weight of a vertex" in said(tmp_path, scene, [(ITERATIONS, 0.05)])


def test_vertices_that_started_inside_the_body_are_told_also_when_continued(tmp_path):
    """A sphere of 0.3 m below the middle of the sheet: so many vertices in it, moved to 2 mm outside."""
    ball = trimesh.creation.icosphere(4, 0.3)
    scene = scene_of(3, obstacle=Obstacle(ball.faces, (ball.vertices + [0.0, 0.0, -0.05])[None]))
    inside = np.linalg.norm(REST + [0.0, 0.0, 0.05], axis=1)
    depths = 1e3 * (0.302 - inside[inside < 0.299])
    straight, continued = said(tmp_path / "a", scene, [OK] * 3), said(tmp_path / "b", scene, [OK] * 3, stop=2)
    for words in (straight, continued):
        line = next(line for line in words.splitlines() if "inside the body at the start" in line)
        count, mean, most = (float(part) for part in line.replace(",", "").split() if part[0].isdigit())
        assert count == len(depths) > 0
        assert (mean, most) == pytest.approx((depths.mean(), depths.max()), abs=1.5)


def test_what_crossed_at_the_start_and_after_is_told_also_when_continued(tmp_path):
    """Untangled where it can be; frames that end as the first one are checked, and so is one that does not."""
    scene = dented(frames=3)
    straight, continued = (
        said(tmp_path / str(stop), scene, [OK] * 3, stop, ipc().beside(scene)[0][0]) for stop in (None, 2)
    )
    assert straight.splitlines()[1:3] == continued.splitlines()[1:3]
    assert re.search(
        r"\n(\d+) pairs of faces cross at the start, the first near \(.*\); \1 untangled, the cloth moved by at most "
        r"[\d.]+ mm\nno faces cross at the end of any of the 3 frames\n", straight
    )  # fmt: skip
    assert "inside the body at the start" not in straight
    assert "faces cross" not in said(tmp_path / "without", scene, [OK] * 3)


def test_crossings_that_stay_are_told(tmp_path):
    """Of pinned cloth."""
    scene = dented(frames=2)
    scene = replace(scene, pins=Pins.fixed(np.arange(1, len(scene.initial.x)), scene.initial.x))
    words = said(tmp_path, scene, [OK] * 2, barrier=ipc().beside(scene)[0][0])
    assert re.search(r"\n(\d+) pairs of faces cross at the start, .*; 0 untangled, .* 0 mm; \1 remain, and stay", words)
    assert "2 of 2 frames (1-2) end with crossing faces" in words


def test_cloth_moved_out_of_a_body_is_told_apart_from_cloth_untangled(tmp_path):
    """The sheet is cut in two by a sphere: the vertices in it are moved out, what then crosses is untangled."""
    ball = trimesh.creation.icosphere(2, 0.3)
    scene = scene_of(1, obstacle=Obstacle(ball.faces, (ball.vertices + [0.02, 0.0, -0.1])[None]))
    plain = said(tmp_path / "plain", scene, [OK])
    words = said(tmp_path / "ipc", scene, [OK], barrier=ipc().beside(scene)[0][0])
    line = next(line for line in plain.splitlines() if "inside the body at the start" in line)
    assert line in words
    assert "no faces cross at the end of any of the 1 frames" in words


@pytest.mark.parametrize(
    ("frames", "words"), [([3], "3"), ([3, 4], "3-4"), ([12, 13, 14, 18, 40, 41], "12-14, 18, 40-41")]
)
def test_frames_in_words(frames, words):
    assert spans(np.array(frames)) == words
