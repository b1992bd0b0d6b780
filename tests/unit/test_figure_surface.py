"""The body: its implicit surface, its mesh, and the distance to it."""

from __future__ import annotations

import gpytoolbox
import numpy as np
import pytest
import trimesh

from drape.errors import DrapeError
from drape.figure.body_surface import body_field
from drape.figure.figure import HIGH, LOW, Figure, make_figure
from drape.figure.implicit import Loft, ellipse_distance, ellipsoid, round_cone, smooth_union
from drape.figure.level_set import level_surface, sample_mirrored
from drape.figure.shape import RANGES, FigureShape
from drape.figure.skeleton import JOINTS, PARENTS, REFERENCE_HEIGHT, rest_joints
from tests.figures import usual_figure

EXTREMES = {
    "small": FigureShape(1.45, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85),
    "large": FigureShape(2.05, 1.3, 1.2, 1.25, 1.35, 1.6, 1.2),
    "belly": FigureShape(1.6, 0.85, 0.85, 1.25, 0.85, 1.6, 1.2),
    "shoulders": FigureShape(1.9, 1.3, 1.2, 0.85, 1.35, 0.85, 0.85),
}


@pytest.fixture(scope="module")
def figure() -> Figure:
    return usual_figure()


def closed(figure: Figure) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(figure.rest_positions, figure.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert mesh.body_count == 1
    assert mesh.volume > 0
    return mesh


def test_the_mesh_is_closed_even_and_of_the_right_size(figure):
    mesh = closed(figure)
    low, high = mesh.bounds
    assert low[2] == pytest.approx(0.0, abs=0.003)
    assert high[2] == pytest.approx(1.72, abs=0.005)
    assert 0.05 < mesh.volume < 0.08
    lengths = mesh.edges_unique_length
    assert lengths.mean() == pytest.approx(0.03, rel=0.1)
    assert lengths.min() > 0.4 * lengths.mean()
    assert lengths.max() < 1.8 * lengths.mean()
    assert (mesh.area_faces > 1e-5).all()


def test_usual_edges_give_a_few_thousand_vertices():
    mesh = closed(make_figure(FigureShape()))
    assert 4000 < len(mesh.vertices) < 7000


@pytest.mark.parametrize("name", EXTREMES)
def test_extreme_measures_give_one_closed_surface(name):
    values, corner = sample_mirrored(lambda points: body_field(points, EXTREMES[name]), LOW, HIGH, 0.012)
    positions, faces = level_surface(values, corner, 0.012)
    mesh = trimesh.Trimesh(positions, faces, process=False)
    assert (mesh.is_watertight, mesh.euler_number, mesh.body_count) == (True, 2, 1)
    assert np.ptp(positions[:, 2]) == pytest.approx(REFERENCE_HEIGHT, abs=0.01)
    assert (positions > LOW + 0.02).all()
    assert (positions < HIGH - 0.02).all()


def test_the_same_shape_gives_the_same_body(figure):
    again = make_figure(FigureShape(), edge=0.03)
    np.testing.assert_array_equal(again.rest_positions, figure.rest_positions)
    np.testing.assert_array_equal(again.faces, figure.faces)
    np.testing.assert_array_equal(again.weights, figure.weights)


def extent(shape: FigureShape, start: list[float], along: list[float]) -> float:
    """Length of the part of a line from ``start`` that lies in the body at the reference height."""
    part = np.linspace(0, 0.4, 401)[:, None]
    return float((body_field(np.array(start) + part * np.array(along), shape) < 0).sum())


@pytest.mark.parametrize("part", ["hip", "belly", "chest", "limb", "girth", "shoulder"])
def test_measures_do_what_they_say(part):
    """Each factor enlarges the part that it is named after, and leaves the skull alone."""
    shapes = FigureShape(), FigureShape(**{part: 1.15})
    lines = {
        "hip": ([0.0, 0.0, 0.94], [1, 0, 0]),
        "belly": ([0.0, 0.0, 1.06], [0, -1, 0]),
        "chest": ([0.07, 0.0, 1.28], [0, -1, 0]),
        "girth": ([0.0, 0.0, 1.15], [1, 0, 0]),
        "limb": ([0.145, 0.2, 0.35], [0, -1, 0]),
        "shoulder": ([0.0, 0.014, 1.40], [1, 0, 0]),
    }
    usual, grown = (extent(shape, *lines[part]) for shape in shapes)
    assert grown > 1.04 * usual
    usual, grown = (extent(shape, [0.0, 0.0, 1.65], [1, 0, 0]) for shape in shapes)
    assert grown == usual


def test_a_body_faces_minus_y_with_its_left_at_plus_x(figure):
    joints = dict(zip(JOINTS, figure.joints, strict=True))
    assert joints["left_hand"][0] > 0.3
    np.testing.assert_allclose(joints["right_hand"], joints["left_hand"] * [-1, 1, 1])
    toes = figure.rest_positions[figure.rest_positions[:, 2] < 0.03]
    assert toes[:, 1].min() < -0.1
    assert (figure.signed_distance(figure.joints) < 0).all()


def test_parents_stand_before_their_children():
    assert len(JOINTS) == len(PARENTS) == len(set(JOINTS)) == 19
    assert all(parent < joint for joint, parent in enumerate(PARENTS))
    np.testing.assert_allclose(rest_joints(FigureShape(height=1.6)) * 1.8 / 1.6, rest_joints(FigureShape(height=1.8)))


def test_signed_distance_is_close_to_the_exact_one(figure, rng):
    """Against the distance to the dense surface, within 10 cm of it."""
    surface = figure.surface
    start = surface.positions[rng.integers(len(surface.positions), size=4000)]
    points = start + rng.normal(scale=0.04, size=start.shape)
    square, _, _ = gpytoolbox.squared_distance(
        points, surface.positions, F=surface.faces.astype(np.int32), use_cpp=True
    )
    distance = figure.signed_distance(points)
    error = np.abs(np.abs(distance) - np.sqrt(square))
    assert error.mean() < 2e-4
    assert error.max() < 2.5e-3
    inside = trimesh.Trimesh(surface.positions, surface.faces, process=False)
    deep = np.abs(distance) > 0.01
    winding = gpytoolbox.fast_winding_number(points[deep], inside.vertices, inside.faces)
    np.testing.assert_array_equal(distance[deep] < 0, winding > 0.5)


def test_the_mesh_lies_on_the_surface(figure):
    assert np.abs(figure.signed_distance(figure.rest_positions)).max() < 0.004


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize("measure", RANGES)
@pytest.mark.parametrize("value", [0.0, -1.0, 5.0, float("nan")])
def test_measures_out_of_range_are_refused(measure, value):
    with pytest.raises(DrapeError, match=rf"figure\.{measure}: found .*; expected .* to "):
        FigureShape(**{measure: value})


def test_edges_out_of_range_are_refused():
    with pytest.raises(DrapeError, match="figure: edge 0.1 m; expected 0.01 to 0.04 m"):
        make_figure(FigureShape(), edge=0.1)


def test_a_round_cone_is_exact(rng):
    """Against the nearest of many balls between the two."""
    start, end = np.array([0.1, 0.0, 0.2]), np.array([0.4, 0.3, 0.1])
    points = rng.uniform(-0.6, 0.9, size=(500, 3))
    part = np.linspace(0, 1, 20001)
    along = start + part[:, None] * (end - start)
    balls = np.stack([np.linalg.norm(points - a, axis=1) for a in along[::20]], 1) - (0.12 - 0.07 * part[::20])
    np.testing.assert_allclose(round_cone(points, start, end, 0.12, 0.05), balls.min(axis=1), atol=1e-4)


def test_ellipses_and_ellipsoids_of_equal_axes_are_exact(rng):
    points = rng.normal(size=(100, 3))
    centre = np.array([0.1, 0.2, 0.3])
    exact = np.linalg.norm(points - centre, axis=1) - 0.5
    np.testing.assert_allclose(ellipsoid(points, centre, np.full(3, 0.5)), exact)
    exact = np.hypot(points[:, 0], points[:, 1]) - 0.3
    np.testing.assert_allclose(ellipse_distance(points[:, 0], points[:, 1], 0.3, 0.3), exact)


def test_a_loft_of_equal_circles_is_a_cylinder(rng):
    ones = np.ones(4)
    axis = np.array([0.0, 0.0, 1.0])
    cylinder = Loft(np.zeros(3), axis, np.eye(3)[0], np.linspace(0, 1, 4), 0.2 * ones, 0.2 * ones, 0 * ones, 0 * ones)
    points = rng.uniform(-1, 2, size=(500, 3))
    radial, beyond = np.hypot(*points.T[:2]) - 0.2, np.maximum(-points[:, 2], points[:, 2] - 1)
    exact = np.minimum(np.maximum(radial, beyond), 0) + np.hypot(np.maximum(radial, 0), np.maximum(beyond, 0))
    np.testing.assert_allclose(cylinder(points), exact, atol=1e-9)


def test_a_smooth_union_is_a_minimum_away_from_the_seam():
    first, second = np.array([0.1, 0.5, 0.2]), np.array([0.4, 0.1, 0.2])
    np.testing.assert_allclose(smooth_union(first, second, 0.1), [0.1, 0.1, 0.2 - 0.1 / 4])


def test_a_sampled_ball_has_its_volume():
    def ball(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points, axis=1) - 0.5

    values, corner = sample_mirrored(ball, np.full(3, -0.6), np.full(3, 0.6), 0.02)
    positions, faces = level_surface(values, corner, 0.02)
    mesh = trimesh.Trimesh(positions, faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.5**3, rel=5e-3)
    np.testing.assert_allclose(np.linalg.norm(positions, axis=1), 0.5, atol=1e-3)
