"""Motions: on the ground, smooth, as fast as people are."""

from __future__ import annotations

import numpy as np
import pytest

from drape.errors import DrapeError
from drape.figure.figure import Figure
from drape.figure.kinematics import joint_positions
from drape.figure.motions import MOTIONS, bend_of, make_motion
from drape.figure.skeleton import JOINTS, SHIN, THIGH
from drape.figure.skinning import pose_vertices
from tests.figures import usual_figure

FPS = 30.0


@pytest.fixture(scope="module")
def figure() -> Figure:
    return usual_figure()


def posed(figure: Figure, transforms: np.ndarray) -> np.ndarray:
    return pose_vertices(figure.rest_positions, figure.bones, figure.weights, transforms)


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_is_rigid_smooth_and_stands_on_the_ground(figure, name):
    transforms = make_motion(name, figure, 80, FPS, np.random.default_rng(3))
    assert transforms.shape == (80, len(JOINTS), 4, 4)
    turns = transforms[..., :3, :3]
    np.testing.assert_allclose(turns @ np.swapaxes(turns, -1, -2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-9)
    positions = posed(figure, transforms)
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=2) * FPS
    assert 0.3 < speeds.max() < 4.6
    assert speeds[0].max() < 0.1  # from standing still
    jerks = np.linalg.norm(np.diff(positions, 2, axis=0), axis=2) * FPS
    assert jerks.max() < 2.5  # change of velocity from one frame to the next [m/s]
    lowest = positions[:, :, 2].min(axis=1)
    assert lowest.min() > -0.01
    assert np.median(lowest) < (0.2 if name == "jump" else 0.005)
    assert np.quantile(lowest, 0.2) < 0.005


@pytest.mark.parametrize("name", MOTIONS)
def test_more_frames_a_second_show_the_same_motion(figure, name):
    slow = make_motion(name, figure, 20, FPS, np.random.default_rng(5))
    fast = make_motion(name, figure, 40, 2 * FPS, np.random.default_rng(5))
    places = joint_positions(figure.joints, slow), joint_positions(figure.joints, fast[::2])
    np.testing.assert_allclose(places[0], places[1], atol=0.02)
    assert np.abs(places[0] - places[0][0]).max() > 0.01


@pytest.mark.parametrize("name", MOTIONS)
def test_random_numbers_decide(figure, name):
    first, again, other = (make_motion(name, figure, 10, FPS, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.01


def test_who_walks_gets_ahead_without_sliding(figure):
    transforms = make_motion("walk", figure, 80, FPS, np.random.default_rng(0))
    positions = posed(figure, transforms)
    path = positions[:, :, :2].mean(axis=1)
    assert -3.5 < path[-1, 1] - path[0, 1] < -1.2  # facing -y
    assert np.abs(path[-1, 0] - path[0, 0]) < 0.2
    below = positions[:-1, :, 2] < 0.008
    slides = np.linalg.norm(np.diff(positions[:, :, :2], axis=0), axis=2) * FPS
    assert np.mean([np.median(slide[low]) for slide, low in zip(slides, below, strict=True) if low.any()]) < 0.25


def test_who_jumps_flies_freely(figure):
    transforms = make_motion("jump", figure, 160, 60.0, np.random.default_rng(0))
    lowest = posed(figure, transforms)[:, :, 2].min(axis=1)
    assert lowest.max() > 0.05
    pelvis = joint_positions(figure.joints, transforms)[:, 0, 2]
    fall = np.diff(pelvis, 2)[lowest[1:-1] > 0.8 * lowest.max()] * 60.0**2
    assert fall.mean() == pytest.approx(-9.81, rel=0.15)


def test_who_turns_turns(figure):
    turns = make_motion("turn", figure, 80, FPS, np.random.default_rng(0))[:, 0, :3, :3]
    heading = np.unwrap(np.arctan2(turns[:, 1, 0], turns[:, 0, 0]))
    assert np.abs(heading[-1] - heading[0]) > np.pi


def test_who_squats_comes_down(figure):
    transforms = make_motion("squat", figure, 90, FPS, np.random.default_rng(0))
    places = joint_positions(figure.joints, transforms)
    assert np.ptp(places[:, 0, 2]) > 0.2
    foot = places[:, JOINTS.index("left_foot")]
    assert np.ptp(foot, axis=0).max() < 0.08



def test_bent_legs_are_as_short_as_asked():
    drop = np.array([0.0, 0.05, 0.2, 0.35])
    knee, thigh = bend_of(drop)
    height = THIGH * np.cos(thigh) + SHIN * np.cos(knee - thigh)
    np.testing.assert_allclose(THIGH + SHIN - height, drop, atol=1e-4)


def test_unknown_motions_are_refused(figure):
    with pytest.raises(DrapeError, match="there is no 'squads'; expected one of walk, .* did you mean 'squat'"):
        make_motion("squads", figure, 10, FPS, np.random.default_rng(0))
    with pytest.raises(DrapeError, match="there is no 'xyz'; .* choose one of walk"):
        make_motion("xyz", figure, 10, FPS, np.random.default_rng(0))


@pytest.mark.parametrize(("frames", "fps"), [(0, 30.0), (10, 0.0), (10, float("nan"))])
def test_motions_without_frames_are_refused(figure, frames, fps):
    with pytest.raises(DrapeError, match="expected 1 or more and a rate above 0"):
        make_motion("walk", figure, frames, fps, np.random.default_rng(0))
