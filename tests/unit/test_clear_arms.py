"""Arms that keep away from the trunk."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from drape.figure.clear_arms import ROOM, clear_arms
from drape.figure.figure import Figure, make_figure
from drape.figure.motions import make_motion
from drape.figure.shape import FigureShape
from drape.figure.skeleton import JOINTS
from drape.figure.skinning import pose_vertices


@pytest.fixture(scope="module")
def figure() -> Figure:
    return make_figure(FigureShape(girth=1.1, hip=1.1), 0.04)


def gaps(figure: Figure, transforms: np.ndarray) -> np.ndarray:
    """Distance between forearms or hands and trunk or thighs, by frame [m]."""
    strongest = figure.bones[np.arange(len(figure.bones)), figure.weights.argmax(axis=1)]
    names = np.array(JOINTS)[strongest]
    lower_arm = np.array([name.endswith(("forearm", "hand")) for name in names])
    rest = np.array([name.endswith(("pelvis", "spine", "chest", "thigh")) for name in names])
    posed = pose_vertices(figure.rest_positions, figure.bones, figure.weights, transforms)
    return np.array([cKDTree(frame[rest]).query(frame[lower_arm])[0].min() for frame in posed])


@pytest.mark.parametrize("name", ["walk", "squat"])
def test_cloth_fits_between_arms_and_trunk(figure: Figure, name: str) -> None:
    motion = make_motion(name, figure, 30, 30.0, np.random.default_rng(1))
    assert gaps(figure, clear_arms(motion, figure, 30.0)).min() > 0.9 * ROOM


def test_arms_that_are_far_stay_and_nothing_else_moves(figure: Figure) -> None:
    still = np.tile(np.eye(4), (4, len(JOINTS), 1, 1))  # the rest pose
    np.testing.assert_allclose(clear_arms(still, figure, 30.0), still, atol=1e-12)
    motion = make_motion("walk", figure, 10, 30.0, np.random.default_rng(1))
    moved = np.abs(clear_arms(motion, figure, 30.0, room=0.1) - motion).max(axis=(0, 2, 3))
    arms = np.array([name.endswith(("upper_arm", "forearm", "hand")) for name in JOINTS])
    assert moved[~arms].max() < 1e-9
    assert moved[arms].min() > 1e-3
