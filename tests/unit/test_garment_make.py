"""Whole garments on a figure: what every kind must be, and what style and figure change."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from drape.errors import DrapeError
from drape.figure.figure import make_figure
from drape.figure.shape import FigureShape
from drape.figure.skeleton import JOINTS
from drape.figure.skinning import pose_vertices
from drape.garment.boundary import boundary_loops
from drape.garment.clearance import outward, push_out
from drape.garment.edges import edges_of
from drape.garment.garment import Garment, make_garment
from drape.garment.kinds import LOOPS
from drape.garment.quality import check_quality, measure_quality
from drape.garment.style import KINDS, GarmentStyle, random_style
from drape.geometry.mesh import ClothMesh
from drape.geometry.normals import vertex_normals

EDGE = 0.04


@pytest.fixture(scope="module")
def figure():
    return make_figure(FigureShape(), edge=0.035)


@pytest.fixture(scope="module")
def made(figure):
    """Makes each garment once."""
    kept: dict[tuple, Garment] = {}

    def make(kind: str, **style: float) -> Garment:
        key = (kind, *sorted(style.items()))
        if key not in kept:
            kept[key] = make_garment(kind, figure, GarmentStyle(**style), EDGE)
        return kept[key]

    return make


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_fit_for_simulation(kind, made, figure):
    garment = made(kind)
    mesh = ClothMesh.from_faces(garment.rest_positions, garment.faces, kind)  # manifold, wound consistently
    quality = measure_quality(garment.rest_positions, garment.faces, figure)
    assert quality == garment.quality
    assert (quality.components, quality.loops, quality.euler) == (1, LOOPS[kind], 2 - LOOPS[kind])
    assert quality.edge_mean == pytest.approx(EDGE, rel=0.05)
    assert quality.edge_cv < 0.14
    assert quality.triangle_min > 0.3
    assert quality.triangle_mean > 0.96
    assert figure.signed_distance(garment.rest_positions).min() >= 0.006
    assert figure.signed_distance(garment.rest_positions[garment.faces].mean(1)).min() >= 0.004
    assert 300 < mesh.num_vertices < 1500


@pytest.mark.parametrize("kind", KINDS)
def test_faces_point_away_from_the_body(kind, made, figure):
    garment = made(kind)
    normals = vertex_normals(garment.rest_positions, garment.faces)
    near = figure.signed_distance(garment.rest_positions) < 0.03
    along = (normals * outward(figure, garment.rest_positions)).sum(1)[near]
    assert np.mean(along > 0.0) > 0.98
    assert np.median(along) > 0.9


@pytest.mark.parametrize("kind", KINDS)
def test_edges_of_the_cloth_are_clean_curves(kind, made):
    """No saw-teeth: every side of a loop is about as long as the others, and no corner is sharp."""
    garment = made(kind)
    for loop in boundary_loops(garment.faces):
        sides = garment.rest_positions[np.roll(loop, -1)] - garment.rest_positions[loop]
        lengths = np.linalg.norm(sides, axis=1)
        unit = sides / lengths[:, None]
        assert 0.7 * EDGE < lengths.min() <= lengths.max() < 1.3 * EDGE
        assert (unit * np.roll(unit, 1, axis=0)).sum(1).min() > np.cos(np.radians(75.0))


@pytest.mark.parametrize("kind", KINDS)
def test_waistbands_are_pinned(kind, made):
    garment = made(kind)
    if kind not in ("skirt", "trousers"):
        assert garment.pinned.shape == (0,)
        return
    assert garment.pinned.tolist() in [sorted(loop.tolist()) for loop in boundary_loops(garment.faces)]
    heights = garment.rest_positions[:, 2]
    assert heights[garment.pinned].min() > heights.max() - 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_skinning_weights_are_weights(kind, made):
    garment = made(kind)
    assert garment.bones.shape == garment.weights.shape == (len(garment.rest_positions), 4)
    assert garment.weights.min() >= 0.0
    np.testing.assert_allclose(garment.weights.sum(1), 1.0)
    assert 0 <= garment.bones.min() <= garment.bones.max() < len(JOINTS)
    still = np.tile(np.eye(4), (1, len(JOINTS), 1, 1))
    posed = pose_vertices(garment.rest_positions, garment.bones, garment.weights, still)[0]
    np.testing.assert_allclose(posed, garment.rest_positions, atol=1e-6)


def legs_apart(figure, angle: float) -> np.ndarray:
    """Skinning transforms of a step: the left leg forwards, the right one backwards by ``angle`` [rad]."""
    transforms = np.tile(np.eye(4), (1, len(JOINTS), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        c, s = np.cos(sign * angle), np.sin(sign * angle)
        turn = np.eye(4)
        turn[1:3, 1:3] = [[c, -s], [s, c]]
        hip = figure.joints[JOINTS.index(f"{side}_thigh")]
        turn[:3, 3] = hip - turn[:3, :3] @ hip
        for part in ("thigh", "shin", "foot"):
            transforms[0, JOINTS.index(f"{side}_{part}")] = turn
    return transforms


@pytest.mark.parametrize("kind", ["dress", "skirt"])
def test_skirts_do_not_tear_between_the_legs(kind, made, figure):
    garment = made(kind)
    posed = pose_vertices(garment.rest_positions, garment.bones, garment.weights, legs_apart(figure, 0.5))[0]
    edges, _ = edges_of(garment.faces)
    before, after = (np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1) for x in (garment.rest_positions, posed))
    assert np.abs(posed - garment.rest_positions).max() > 0.1
    assert (after / before).max() < 1.8
    middle = (np.abs(garment.rest_positions[:, 0]) < 0.02) & (garment.rest_positions[:, 2] < 0.6)
    left = [JOINTS.index(name) for name in ("left_thigh", "left_shin", "left_foot")]
    share = (garment.weights * np.isin(garment.bones, left)).sum(1)[middle]
    assert share == pytest.approx(0.5, abs=0.12)


def test_straps_are_wide_enough_to_stay(made):
    garment = made("top", collar=0.8, strap=0.06)
    loops = sorted(boundary_loops(garment.faces), key=lambda loop: garment.rest_positions[loop, 2].mean())
    hem, *holes, collar = (garment.rest_positions[loop] for loop in loops)
    assert len(hem) > len(collar)
    gaps = [np.linalg.norm(hole[:, None] - collar, axis=2).min() for hole in holes]
    assert 0.05 < min(gaps) <= max(gaps) < 0.12


def test_style_changes_what_it_says(made):
    usual, other = made("skirt"), made("skirt", length=0.9, flare=0.4)
    assert other.rest_positions[:, 2].min() < usual.rest_positions[:, 2].min() - 0.15
    assert np.abs(other.rest_positions).max(0)[0] > np.abs(usual.rest_positions).max(0)[0] + 0.05
    usual, other = made("tshirt"), made("tshirt", sleeve=0.6, ease=0.025)
    assert np.abs(other.rest_positions).max(0)[0] > np.abs(usual.rest_positions).max(0)[0] + 0.08
    assert other.quality.clearance > usual.quality.clearance + 0.008


def test_the_same_call_gives_the_same_garment(made, figure):
    before = figure.rest_positions.copy()
    again = make_garment("top", figure, GarmentStyle(), EDGE)
    for name in ("rest_positions", "faces", "pinned", "bones", "weights"):
        np.testing.assert_array_equal(getattr(again, name), getattr(made("top"), name))
    np.testing.assert_array_equal(figure.rest_positions, before)


def test_what_lies_inside_is_pushed_out(made, figure):
    garment = made("skirt")
    gaps = figure.signed_distance(garment.rest_positions)[:, None]
    inside = garment.rest_positions - (gaps + 0.003) * outward(figure, garment.rest_positions) * (gaps < 0.02)
    assert figure.signed_distance(inside).min() < 0.0
    pushed = push_out(inside, garment.faces, figure)
    assert figure.signed_distance(pushed).min() >= 0.006
    assert figure.signed_distance(pushed[garment.faces].mean(1)).min() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "kinds"),
    [({"height": 1.55, "girth": 0.9, "hip": 1.2}, KINDS[::2]), ({"height": 1.92, "girth": 1.25}, KINDS[1::2])],
)
def test_other_figures_can_wear_random_styles(shape, kinds):
    figure = make_figure(FigureShape(**shape), edge=0.035)
    for number, kind in enumerate(kinds):
        make_garment(kind, figure, random_style(kind, np.random.default_rng(number)), 0.03)


def test_unfit_meshes_are_refused(made):
    quality = made("skirt").quality
    check_quality(quality, "skirt", 2)
    with pytest.raises(DrapeError, match="garment skirt: found 2 boundary loops; expected 3"):
        check_quality(quality, "skirt", 3)
    with pytest.raises(DrapeError, match=r"a triangle of quality 0\.10; expected above 0\.3; choose another"):
        check_quality(replace(quality, triangle_min=0.1), "skirt", 2)
    with pytest.raises(DrapeError, match=r"a vertex 2\.0 mm from the body; expected 6 mm"):
        check_quality(replace(quality, clearance=0.002), "skirt", 2)
    with pytest.raises(DrapeError, match="3 separate pieces; expected 1"):
        check_quality(replace(quality, components=3), "skirt", 2)


def test_mistakes_are_sentences(figure):
    with pytest.raises(DrapeError, match="garment kind: found 'cape'; expected one of tshirt, top"):
        make_garment("cape", figure, GarmentStyle(), EDGE)
    with pytest.raises(DrapeError, match=r"garment dress: edge is 0\.5 m; expected 0\.008 to 0\.06 m"):
        make_garment("dress", figure, GarmentStyle(), 0.5)


def test_neither_torch_nor_blender_is_loaded():
    code = "import sys, drape.garment.garment; sys.exit(bool({'torch', 'bpy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
