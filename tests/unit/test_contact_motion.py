"""A body in motion never gets into the cloth, however fast; what begins inside comes out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from drape.contact.penetration import Penetration, push_out
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.terms.bending import Bending
from drape.energy.terms.stvk import StVK
from drape.errors import DrapeError
from drape.scene.built_in.sphere import sphere
from drape.scene.material import Material
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.simulators.rollout import first_frame
from drape.simulators.solver.implicit import ImplicitSolver

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)


def falling(**changes: object):
    settings = {
        "size": 0.8, "resolution": 13, "pattern": "alternating", "radius": 0.2, "subdivisions": 2, "gap": 0.01,
        "sway": [0.2, 0.0, 0.1], "period": 1.0, "friction": 0.3, "material": SILK, "mass": {"areal_density": 0.3},
        "gravity": [0.0, 0.0, -9.81], "fps": 30.0, "frames": 8,
    }
    return sphere(**(settings | changes))


@pytest.mark.parametrize("motion", [{}, {"sway": [0.6, 0.0, 0.3], "period": 0.4}], ids=["slow", "20 cm a frame"])
def test_no_vertex_ends_inside_a_moving_sphere(motion):
    scene = falling(**motion)
    potential = IncrementalPotential.for_scene(scene, [StVK(), Bending()])
    solver = ImplicitSolver(potential, scene, torch.zeros(5, dtype=torch.float64))
    state, inside, penetration = first_frame(scene), [], Penetration(scene.mesh, scene.obstacle)
    for frame in range(scene.frames):
        state = solver.step(state, frame).state
        inside.append(penetration.inside(state.x, frame + 1))
    assert np.isfinite(state.x).all()
    assert max(inside) <= 0.005


def test_the_first_frame_is_moved_out_of_the_body():
    scene = falling()
    sunk = replace(scene.initial, x=scene.initial.x - [0.0, 0.0, 0.04], v=scene.initial.v + 1.0)
    lowered = replace(scene, initial=sunk)
    penetration = Penetration(lowered.mesh, lowered.obstacle)
    assert penetration.inside(lowered.initial.x, 0) > 0.03
    start = first_frame(lowered)
    vertices = slice(lowered.mesh.num_vertices)
    assert (penetration.depth(start.x, 0)[vertices] == 0.0).all()
    moved = (start.x != lowered.initial.x).any(axis=1)
    assert (start.v[moved] == 0).all()
    assert (start.v[~moved] == 1).all()


def test_pinned_vertices_inside_the_body_stay_where_they_are_held():
    scene = falling()
    x = scene.initial.x - [0.0, 0.0, 0.04]
    held = np.argsort(np.linalg.norm(x[:, :2], axis=1))[:3]
    pinned = replace(scene, initial=replace(scene.initial, x=x), pins=Pins.fixed(held, x))
    start = first_frame(pinned)
    assert (start.x[held] == x[held]).all()
    assert (start.x != x).any(axis=1).sum() > 3, "the others moved out"


def test_cloth_deep_in_the_body_is_refused_and_not_moved_far():
    """0.05 m below the top of a ball of 0.4 m, of flat faces."""
    scene = falling()
    sunk = replace(scene.initial, x=scene.initial.x - [0.0, 0.0, 0.06])
    with pytest.raises(DrapeError, match=r"found 9 vertices inside the body .* vertex 84 by 0\.0492 m; expected at"):
        first_frame(replace(scene, initial=sunk))


def test_pushed_out_to_the_clearance_and_no_further():
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    x = np.array([[0.1, 0.2, -0.05], [0.3, 0.1, 0.02], [0.5, 0.5, -3.0]])
    moved = push_out(x, Obstacle(faces, corners[None]), clearance=0.002)
    np.testing.assert_allclose(moved, [[0.1, 0.2, 0.002], [0.3, 0.1, 0.02], [0.5, 0.5, -3.0]], atol=1e-12)
