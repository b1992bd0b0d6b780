"""People of anny are figures: closed, in the rest pose, with weights, and motions turn them as they turn figures."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
import trimesh

from drape.errors import DrapeError
from drape.figure.anny_figure import at_rest
from drape.figure.anny_model import check_anny
from drape.figure.kinematics import joint_positions
from drape.figure.measures import shape_of
from drape.figure.motions import MOTIONS, make_motion
from drape.figure.phenotype import Phenotype
from drape.figure.shape import FigureShape
from drape.figure.skeleton import JOINTS, PARENTS
from drape.figure.skinning import pose_vertices
from drape.garment.anatomy import measure_anatomy
from drape.garment.figure_like import FigureLike
from tests.figures import usual_figure
from tests.people import needs_anny, usual_body, usual_person

LIMBS = [name for name in JOINTS if name.endswith(("forearm", "hand", "shin", "foot"))]
"""Joints at which a limb ends."""


@needs_anny
def test_a_person_is_a_closed_figure_at_rest():
    person = usual_person()
    assert isinstance(person, FigureLike)
    mesh = trimesh.Trimesh(person.rest_positions, person.faces, process=False)
    assert (mesh.is_watertight, mesh.is_winding_consistent, mesh.body_count) == (True, True, 1)
    assert 0.04 < mesh.volume < 0.10  # m3
    x = person.rest_positions
    assert abs(x[:, 2].min()) < 0.005
    assert np.ptp(x[:, 2]) == pytest.approx(person.stature, abs=0.01)
    assert 1.5 < person.stature < 1.8
    assert person.joints[JOINTS.index("left_hand"), 0] > 0.4, "its left is at +x"
    assert measure_anatomy(person).front == -1.0
    mirrored = person.joints * [-1.0, 1.0, 1.0]
    right = [JOINTS.index(name.replace("left", "right")) for name in JOINTS if name.startswith("left")]
    left = [number for number, name in enumerate(JOINTS) if name.startswith("left")]
    np.testing.assert_allclose(person.joints[right], mirrored[left], atol=2e-3)


@needs_anny
def test_distance_and_weights_of_a_person():
    person = usual_person()
    assert np.abs(person.signed_distance(person.rest_positions)).max() < 0.012
    inside, outside = person.joints[:3], np.array([[0.0, -0.5, 1.0], [0.0, 0.0, 0.3]])
    assert person.signed_distance(inside).max() < -0.02
    assert person.signed_distance(outside).min() > 0.03
    np.testing.assert_allclose(person.weights.sum(axis=1), 1.0)
    bones, weights = person.skin_weights(person.joints)
    for number, name in enumerate(JOINTS):
        near = {number, PARENTS[number], *(k for k, parent in enumerate(PARENTS) if parent == number)}
        assert near & set(bones[number][weights[number] > 0.05]), name


@needs_anny
def test_limbs_at_rest_point_where_those_of_a_figure_point():
    joints, figure = at_rest(usual_body())[1], usual_figure()
    for name in LIMBS:
        number = JOINTS.index(name)
        above = PARENTS[number]
        along = joints[number] - joints[above]
        along /= np.linalg.norm(along)
        np.testing.assert_allclose(along, figure.directions[JOINTS[above]], atol=2e-3, err_msg=name)


@needs_anny
@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_takes_limbs_where_it_takes_those_of_a_figure(name):
    """Every limb points the same way in every frame; and the person stands on the ground."""
    person, figure = usual_person(), usual_figure()
    moves = [make_motion(name, body, 30, 30.0, np.random.default_rng(3)) for body in (person, figure)]
    places = [joint_positions(body.joints, move) for body, move in zip((person, figure), moves, strict=True)]
    for limb in LIMBS:
        number = JOINTS.index(limb)
        along = [place[:, number] - place[:, PARENTS[number]] for place in places]
        cosine = [np.einsum("fc,fc->f", *along) / np.prod(np.linalg.norm(along, axis=2), axis=0)]
        assert np.min(cosine) > np.cos(np.radians(1.0)), limb
    lowest = pose_vertices(person.rest_positions, person.bones, person.weights, moves[0])[..., 2].min(axis=1)
    assert lowest.min() > -0.015
    assert np.quantile(lowest, 0.2) < 0.005


def test_measures_say_which_body_they_are_of():
    assert shape_of({"height": 1.8}, "scene.figure") == FigureShape(height=1.8)
    assert shape_of({"gender": 1.0, "height": 0.5}, "scene.figure") == Phenotype(gender=1.0, height=0.5)
    with pytest.raises(DrapeError, match=r"scene\.figure: found 'girth'; expected measures out of gender, age"):
        shape_of({"gender": 1.0, "girth": 1.0}, "scene.figure")


@pytest.mark.parametrize(
    ("measures", "sentence"),
    [
        ({"age": 0.1}, r"figure\.age: found 0\.1; expected 0\.3 to 1\.0 on anny's scale; choose"),
        ({"height": 1.72}, r"figure\.height: found 1\.72; expected 0\.2 to 0\.7"),
        ({"weight": float("nan")}, r"figure\.weight: found nan"),
    ],
)
def test_a_measure_out_of_range_is_refused(measures, sentence):
    with pytest.raises(DrapeError, match=sentence):
        Phenotype(**measures)


def test_missing_anny_is_a_sentence(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "anny" else find(name))
    with pytest.raises(DrapeError, match=r'found no anny, .* pip install "\.\[people\]", or choose the figure'):
        check_anny()
