"""Frames: each follows from the one before it alone, and is cut into time steps as it is said."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drape
from drape.data.animation_hdf5 import AnimationFile, AnimationHeader
from drape.data.animation_writer import AnimationWriter
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.law.baked.file import read_baked
from drape.energy.terms.hinge_elastic import Damping, HingeElastic
from drape.geometry.nearest_faces import NearestFaces
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.rollout import COLUMNS, first_frame, frames, roll_out
from drape.simulators.simulator import Outcome, StepResult
from drape.simulators.solver import minimise
from drape.simulators.solver.implicit import ImplicitSolver
from tests.unit.test_implicit import NO_ATTRIBUTES, ground, run, scene_of, solver_of


def halved(positions: np.ndarray) -> np.ndarray:
    """With a frame between every two, in the middle."""
    both = np.stack([positions[:-1], (positions[:-1] + positions[1:]) / 2], axis=1)
    return np.concatenate([both.reshape(-1, *positions.shape[1:]), positions[-1:]])


def moving_scene(frames: int = 6) -> Scene:
    """A sheet, led by two corners, over ground that rises below it; with friction."""
    ramp = np.arange(frames + 1)[:, None, None]
    base = scene_of(frames=frames)
    path = base.initial.x[[0, 7]] + ramp * [0.004, 0.0, 0.002]
    body = ground(2.0, -0.02)
    moving = Obstacle(body.faces, body.positions + ramp * [0.006, 0.0, 0.004])
    return replace(base, pins=Pins(np.array([0, 7]), path), obstacle=moving, friction=0.5)


def test_steps_in_a_frame_are_those_of_a_scene_with_more_frames():
    """With a body and pins that move; a frame says the evaluations of all its steps and the worst residual."""
    scene = moving_scene()
    finer = replace(
        scene, dt=scene.dt / 2, frames=2 * scene.frames,
        pins=Pins(scene.pins.vertices, halved(scene.pins.targets)),
        obstacle=Obstacle(scene.obstacle.faces, halved(scene.obstacle.positions)),
    )  # fmt: skip
    cut, whole = run(scene, 4, steps=2, iterations=20), run(finer, 8, iterations=20)
    for frame, result in enumerate(cut):
        pair = whole[2 * frame : 2 * frame + 2]
        np.testing.assert_allclose(result.state.x, pair[1].state.x, atol=1e-9)
        assert result.iterations == sum(each.iterations for each in pair)
        assert result.residual == pytest.approx(max(each.residual for each in pair), rel=1e-3)
        assert result.outcome is max(pair, key=lambda each: each.residual).outcome


def test_a_step_that_starts_where_the_one_before_ended_searches_once(monkeypatch):
    """Nearest faces at its end; those at its start are known. Another start is searched for."""
    searches, find = [], NearestFaces.find
    monkeypatch.setattr(NearestFaces, "find", lambda *args: searches.append(0) or find(*args))
    scene = moving_scene()
    solver, state, taken = solver_of(scene), scene.initial, []
    for frame in range(5):
        before = len(searches)
        state = solver.step(state, frame).state
        taken.append(len(searches) - before)
    assert taken == [2, 1, 1, 1, 1]
    solver.step(State(state.x + 1e-3, state.v), 5)
    assert len(searches) == 6 + 2


class Still:
    """Cloth that stays where it is."""

    def step(self, state: State, frame: int) -> StepResult:
        return StepResult(state, Outcome.CONVERGED, 1, 0.0)


def test_a_frame_says_what_of_the_cloth_is_in_the_body_of_its_own_time(tmp_path):
    """A sheet through which a floor rises and sinks again: none of it below, all of it, none of it."""
    heights = np.array([-0.1, 0.1, -0.1])[:, None, None] * [0.0, 0.0, 1.0]
    floor = ground(2.0, 0.0)
    scene = scene_of(frames=2, obstacle=Obstacle(floor.faces, floor.positions + heights))
    with AnimationWriter(tmp_path / "still.h5", AnimationHeader.of_scene(scene, COLUMNS, "{}")) as writer:
        roll_out(Still(), scene, writer)
    with AnimationFile(tmp_path / "still.h5") as file:
        np.testing.assert_allclose(file.numbers()["inside"], [np.nan, 1.0, 0.0], atol=1e-12)


def test_only_vertices_that_are_moved_out_of_the_body_are_stopped():
    """A sheet whose one half is below a slope through its middle."""
    scene, floor = scene_of(), ground(2.0, 0.0)
    moving, middle = State(scene.initial.x, np.tile([0.1, 0.2, 0.3], (64, 1))), scene.initial.x.mean(0)
    rising = floor.positions + 0.1 * floor.positions[..., :1] * [0.0, 0.0, 1.0]
    slope = Obstacle(floor.faces, rising + middle)
    start = first_frame(replace(scene, initial=moving, obstacle=slope))
    inside = scene.initial.x[:, 0] > middle[0]
    np.testing.assert_array_equal(start.v, np.where(inside[:, None], 0.0, moving.v))
    np.testing.assert_array_equal((start.x != scene.initial.x).any(1), inside)


TABLE = Path(drape.__file__).parent / "checkpoints" / "eunet_hinge_silk.npz"
CASES = {
    "exact": {"iterations": 80, "tolerance": 1e-7},
    "few evaluations": {"iterations": 6},
    "two steps a frame": {"iterations": 12, "steps": 2},
    "single precision": {"precision": "float32", "factors": "float32"},
}


@pytest.mark.parametrize("settings", CASES.values(), ids=CASES)
def test_interrupted_after_every_frame_is_as_never_interrupted(tmp_path, monkeypatch, settings):
    """To the last bit: each frame by another solver, from the state that the file has.

    Body, friction and pins; a learned law, and every call soon gives up its rough Hessian.
    """
    monkeypatch.setattr(minimise, "PATIENCE", 8)
    scene, law = moving_scene(4), read_baked(TABLE).double()
    header = AnimationHeader.of_scene(scene, COLUMNS, "{}")

    def solver() -> ImplicitSolver:
        terms = [HingeElastic(law, transfer=True), Damping(law, transfer=True)]
        potential = IncrementalPotential.for_scene(scene, copy.deepcopy(terms))
        return ImplicitSolver(potential, scene, NO_ATTRIBUTES, **settings)

    with AnimationWriter(tmp_path / "straight.h5", header) as writer:
        roll_out(solver(), scene, writer)
    for _ in range(scene.frames):
        with AnimationWriter(tmp_path / "interrupted.h5", header) as writer:
            next(frames(solver(), scene, writer))
    with AnimationFile(tmp_path / "straight.h5") as one, AnimationFile(tmp_path / "interrupted.h5") as other:
        for name in ("x", "v"):
            found, expected = (getattr(file.trajectory(), name) for file in (other, one))
            assert np.array_equal(found, expected)
        for name in ("iterations", "residual", "outcome"):
            assert np.array_equal(other.numbers()[name], one.numbers()[name], equal_nan=True)
