"""A figure person in garments: they start outside of the body and of each other, and are led where they are pinned."""

from __future__ import annotations

import functools
import importlib.util

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra

from drape.config import instantiate
from drape.config.entry_point import CONF
from drape.contact.collisions import Collisions
from drape.contact.penetration import Penetration
from drape.errors import DrapeError
from drape.figure.figure import make_figure
from drape.figure.shape import FigureShape
from drape.garment.clip import component_labels
from drape.garment.garment import make_garment
from drape.garment.layer import Layer
from drape.garment.outfit import make_outfit
from drape.scene.scene import Scene

COARSE = ("scene.edge=0.05", "scene.body_edge=0.04", "scene.settle=4", "scene.frames=8")


@pytest.fixture(scope="module", autouse=True)
def _hydra():
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base=None), pytest.MonkeyPatch.context() as patched:
        patched.setattr("drape.garment.outfit.make_figure", functools.cache(make_figure))  # most of the time
        yield


def made(*overrides: str) -> Scene:
    return instantiate(compose("animate", ["scene=person", *COARSE, *overrides]).scene)


built = functools.cache(made)


@pytest.mark.parametrize("garments", ["[tshirt]", "[tshirt,skirt]", "[skirt,tshirt]"])
def test_it_starts_at_rest_outside_of_the_body_and_of_itself(garments):
    scene = built(f"scene.garments={garments}")
    x = scene.initial.x
    assert (scene.name, scene.frames, scene.friction) == ("person", 8, 0.3)
    assert (scene.initial.v == 0).all()
    np.testing.assert_array_equal(x, scene.mesh.rest_positions)
    assert Penetration(scene.mesh, scene.obstacle).depth(x, 0).max() == 0.0
    body, faces = scene.obstacle.at(0), scene.obstacle.faces
    search = Collisions(
        x, scene.mesh.faces, self_distance=5e-3, self_stiffness=1.0, body=body, body_faces=faces, body_distance=2e-3
    )
    assert len(search.crossings(x, body).pairs) == 0
    assert search.energy_and_gradient(x, body)[0] == 0.0, "nothing is nearer than barriers begin"
    corners = x[scene.mesh.faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert scene.mass.sum() == pytest.approx(0.08 * area), "silk, as it is worn"


def test_the_body_goes_from_its_rest_pose_into_the_motion():
    body = built("scene.garments=[tshirt]").obstacle
    assert body.num_frames == 9
    moved = np.linalg.norm(np.diff(body.positions, axis=0), axis=2).max(axis=1)
    assert moved[0] > 0.01
    assert moved[3:].max() > 1e-3
    short = built("scene.garments=[tshirt]", "scene.frames=2")
    np.testing.assert_allclose(short.obstacle.positions[:3], body.positions[:3], atol=1e-5)  # arms look ahead


def test_waistbands_are_led_by_the_skeleton():
    assert built("scene.garments=[tshirt]").pins is None
    scene = built("scene.garments=[tshirt,skirt]")
    pins, x = scene.pins, scene.initial.x
    np.testing.assert_allclose(pins.at(0), x[pins.vertices], atol=1e-12)
    assert pins.num_frames == 9
    assert np.ptp(x[pins.vertices, 2]) < 0.01
    first_of_skirt = scene.mesh.num_vertices - len(np.unique(scene.mesh.faces[_component(scene)]))
    assert pins.vertices.min() >= first_of_skirt
    body = scene.obstacle.positions
    nearest = np.linalg.norm(x[pins.vertices][:, None] - body[0], axis=-1).argmin(axis=1)
    moved, below = pins.targets[8] - pins.targets[0], body[8, nearest] - body[0, nearest]
    assert np.linalg.norm(moved, axis=1).min() > 0.005
    assert np.linalg.norm(moved - below, axis=1).max() < 0.5 * np.linalg.norm(below, axis=1).max()


def _component(scene: Scene) -> np.ndarray:
    """Faces of the last garment."""
    labels = component_labels(scene.mesh.faces, scene.mesh.num_vertices)[1]
    return labels[scene.mesh.faces[:, 0]] == labels[-1]


def test_the_seed_decides():
    first, again = built("scene.garments=[tshirt]"), made("scene.garments=[tshirt]")
    np.testing.assert_array_equal(first.initial.x, again.initial.x)
    np.testing.assert_array_equal(first.obstacle.positions, again.obstacle.positions)
    other = built("scene.garments=[tshirt]", "scene.seed=1")
    assert other.initial.x.shape != first.initial.x.shape or not np.array_equal(other.initial.x, first.initial.x)
    np.testing.assert_array_equal(other.obstacle.at(0), first.obstacle.at(0))
    assert not np.array_equal(other.obstacle.at(8), first.obstacle.at(8))


def test_an_outer_garment_is_outside_of_the_inner_one():
    """Nowhere is the inner one farther out, seen from the body: it lies inside the solid of the outer one."""
    outfit = make_outfit(
        FigureShape(), ["skirt", "tshirt"], "walk", edge=0.05, body_edge=0.04, settle=1, frames=1, fps=30.0, seed=0
    )
    skirt, shirt = outfit.garments
    assert shirt.worn.inner is skirt.worn
    assert shirt.quality.clearance >= 0.006
    assert skirt.worn.signed_distance(shirt.rest_positions).min() >= 0.006
    assert np.abs(skirt.worn.signed_distance(skirt.rest_positions)).max() < 0.012, "its cloth is the surface"
    alone = make_garment("tshirt", outfit.figure, shirt.style, 0.05)
    assert Layer(outfit.figure, alone.worn.pattern).signed_distance(skirt.rest_positions).min() < 0.0
    assert skirt.worn.signed_distance(alone.rest_positions).min() < 0.0, "without it, they would cross"


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("scene.garments=[shirt]", r"garment kind: found 'shirt'; expected one of tshirt, top, .*, trousers"),
        ("scene.garments=[]", r"scene\.garments: found \[\]; expected a list of tshirt, .* the innermost first"),
        ("scene.motion=walks", "motion: there is no 'walks'; expected one of walk, .* did you mean 'walk'"),
        ("+scene.figure.heigth=1.8", r"scene\.figure: found 'heigth'; expected measures out of height, girth"),
        ("scene.figure.height=3.0", r"figure\.height: found 3\.0; expected 1\.45 to 2\.05 m"),
        ("scene.settle=0", r"scene\.settle: found 0; expected 1 frame or more"),
        ("scene.frames=0", r"scene\.frames: found 0; expected at least 1"),
        ("scene.edge=0.2", r"edge is 0\.2 m; expected 0\.008 to 0\.06 m"),
        ("scene.body_edge=0.1", r"figure: edge 0\.1 m; expected 0\.01 to 0\.04 m"),
        ("scene.fps=0.0", r"scene\.fps: found 0\.0"),
    ],
)
def test_mistakes_are_sentences(override, sentence):
    with pytest.raises(DrapeError, match=sentence):
        made(override)


def test_a_weight_must_be_given():
    with pytest.raises(DrapeError, match=r"scene\.mass: found .* expected exactly one of per_vertex"):
        made("scene.mass.areal_density=null")


def test_missing_packages_are_named(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "skimage" else find(name))
    with pytest.raises(DrapeError, match="found no scikit-image, .* pip install scikit-image"):
        made()
