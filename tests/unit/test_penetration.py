"""What is inside a body is told and moved out, by a cube whose faces lie at known places."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from drape.contact.penetration import distances, push_out
from drape.scene.obstacle import Obstacle

CUBE = trimesh.creation.box((2.0, 2.0, 2.0))
BODY = Obstacle(np.array(CUBE.faces), np.array(CUBE.vertices)[None])
POINTS = np.array([[0.1, 0.2, 0.9], [0.1, 0.2, 1.5], [-0.7, 0.1, 0.2]])
"""A tenth inside the top, half above it, 0.3 inside a side."""


def test_distances_are_negative_inside():
    assert distances(POINTS, BODY, 0).tolist() == pytest.approx([-0.1, 0.5, -0.3])


def test_what_is_inside_is_pushed_out_and_the_rest_stays():
    moved = push_out(POINTS, BODY, 0.01)
    np.testing.assert_allclose(moved, [[0.1, 0.2, 1.01], [0.1, 0.2, 1.5], [-1.01, 0.1, 0.2]], atol=1e-9)
