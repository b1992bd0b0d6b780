"""Steps of making a garment on shapes whose answer is known: cutting, boundary loops, even meshes, lofts, styles."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from drape.errors import DrapeError
from drape.garment.blending import smooth_maximum, smooth_minimum
from drape.garment.boundary import boundary_loops, resample_boundary, without_collapsed
from drape.garment.clip import clip, largest_component
from drape.garment.cloth_field import Grid, body_distance, zero_level
from drape.garment.edges import boundary_edges, edges_of
from drape.garment.loft import measure
from drape.garment.polish import flip_edges, polish
from drape.garment.quality import triangle_quality
from drape.garment.remeshing import remesh
from drape.garment.style import KINDS, LIMITS, RANGES, GarmentStyle, random_style
from drape.geometry.normals import vertex_normals


@pytest.fixture(scope="module")
def sphere():
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)


@pytest.fixture(scope="module")
def bowl(sphere):
    """The lower part of the sphere, cut at z = 0.1."""
    vertices, faces = sphere
    return clip(vertices, faces, 0.1 - vertices[:, 2])


def area(vertices, faces):
    corners = vertices[faces]
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()


def test_a_cut_lies_on_the_level_and_takes_the_right_area(bowl):
    vertices, faces = bowl
    rim = np.unique(boundary_edges(faces))
    np.testing.assert_allclose(vertices[rim, 2], 0.1, atol=1e-12)
    assert vertices[:, 2].max() <= 0.1 + 1e-12
    assert area(*bowl) == pytest.approx(2 * np.pi * 0.3 * 0.4, rel=5e-3)  # of a cap: 2 π r h
    edges, count = edges_of(faces)
    assert len(vertices) - len(edges) + len(faces) == 1
    assert count.max() == 2


def test_a_cut_keeps_the_winding(bowl):
    vertices, faces = bowl
    outwards = (vertex_normals(vertices, faces) * vertices).sum(1)
    assert outwards.min() > 0.0


def test_a_cut_through_vertices_leaves_no_pieces():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    kept, faces = clip(vertices, np.array([[0, 1, 2], [0, 2, 3]]), vertices[:, 0] - vertices[:, 1])
    assert area(kept, faces) == pytest.approx(0.5, abs=1e-5)


def test_the_largest_part_stays(sphere):
    vertices, faces = sphere
    small = clip(vertices, faces, vertices[:, 2] - 0.2)
    both = np.concatenate([small[0] + 5.0, vertices]), np.concatenate([small[1], faces + len(small[0])])
    assert len(largest_component(*both)[0]) == len(vertices)


def test_loops_are_in_order_along_the_faces(bowl):
    faces = bowl[1]
    (loop,) = boundary_loops(faces)
    sides = {tuple(side) for side in boundary_edges(faces).tolist()}
    assert {(int(a), int(b)) for a, b in zip(loop, np.roll(loop, -1), strict=True)} == sides
    assert boundary_loops(trimesh.creation.box().faces) == []


def test_a_resampled_rim_is_even_and_stays_on_its_curve(bowl):
    vertices, faces = resample_boundary(*bowl, 0.05)
    (loop,) = boundary_loops(faces)
    steps = np.linalg.norm(vertices[loop] - vertices[np.roll(loop, -1)], axis=1)
    radius = np.sqrt(0.3**2 - 0.1**2)
    assert len(loop) == round(2 * np.pi * radius / 0.05)
    assert np.ptp(steps) < 0.002
    np.testing.assert_allclose(np.linalg.norm(vertices[loop, :2], axis=1), radius, atol=1e-3)
    assert edges_of(faces)[1].max() == 2


def test_faces_that_collapse_leave_in_pairs():
    faces = np.array([[0, 1, 1], [0, 1, 2], [2, 1, 0], [3, 4, 5]])
    np.testing.assert_array_equal(without_collapsed(faces), [[3, 4, 5]])


def test_a_remeshed_bowl_is_even(bowl):
    vertices, faces = remesh(*bowl, 0.04)
    edges, count = edges_of(faces)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    assert lengths.mean() == pytest.approx(0.04, rel=0.05)
    assert lengths.std() / lengths.mean() < 0.14
    assert triangle_quality(vertices, faces).min() > 0.5
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 0.3, atol=3e-3)
    assert count.max() == 2
    assert len(boundary_loops(faces)) == 1


def test_a_bad_diagonal_is_flipped():
    vertices = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 0.3, 0], [0, -0.3, 0]])
    flipped = flip_edges(vertices, np.array([[0, 1, 2], [1, 0, 3]]))
    assert all({2, 3} <= set(face) for face in flipped.tolist())
    assert triangle_quality(vertices, flipped).min() > 0.7
    assert vertex_normals(vertices, flipped)[:, 2].min() > 0.99


def test_polishing_repairs_a_shaken_plane():
    side = np.arange(12.0)
    x, y = np.meshgrid(side, side * np.sqrt(0.75))
    x = x + 0.5 * (np.arange(12) % 2)[:, None]
    corner = np.add.outer(12 * np.arange(11), np.arange(11)).reshape(-1)
    faces = np.concatenate(
        [np.stack(t, 1) for t in ((corner, corner + 1, corner + 13), (corner, corner + 13, corner + 12))]
    )
    vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    inner = ((x > 1) & (x < 10) & (y > 0.5) & (y < 9)).ravel()
    shaken = vertices + inner[:, None] * np.random.default_rng(0).normal(0, 0.2, vertices.shape) * [1, 1, 0]
    better, new = polish(shaken, faces)
    assert triangle_quality(better, new).mean() > triangle_quality(shaken, faces).mean() + 0.1
    np.testing.assert_array_equal(
        better[~inner & np.isin(np.arange(144), boundary_edges(new))],
        shaken[~inner & np.isin(np.arange(144), boundary_edges(new))],
    )


def test_smooth_unions_are_exact_apart_from_the_corner():
    a, b = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 5.0])
    np.testing.assert_allclose(smooth_minimum(a, b, 0.1), [0.0, -0.025, -1.0])
    np.testing.assert_allclose(smooth_maximum(a, b, 0.1), [1.0, 0.025, 5.0])


class Ball:
    """A body of radius 0.2 m that counts how often it is asked."""

    asked = 0

    def signed_distance(self, points):
        self.asked += len(points)
        return np.linalg.norm(points, axis=1) - 0.2


def test_the_distance_is_asked_only_near_the_body():
    ball, grid = Ball(), Grid.covering(np.full(3, -0.5), np.full(3, 0.5), 0.02)
    distance = body_distance(ball, grid)
    exact = np.linalg.norm(grid.points(), axis=-1) - 0.2
    near = np.abs(exact) < 0.04
    assert np.abs(distance - exact)[near].max() < 1e-3
    assert ball.asked < 0.5 * grid.points(2)[..., 0].size + grid.points(8)[..., 0].size
    vertices, faces = zero_level(distance - 0.02, grid)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 0.22, atol=2e-3)
    assert (vertex_normals(vertices, faces) * vertices).sum(1).min() > 0.0


@pytest.fixture(scope="module")
def cone():
    """A body part along -z, elliptic, whose half widths shrink from (0.3, 0.2) to (0.15, 0.1) over 1 m."""
    angle, z = np.meshgrid(np.linspace(0, 2 * np.pi, 120), np.linspace(0, 1, 200))
    wide = 1.0 - 0.5 * z
    points = np.stack([0.1 + 0.3 * wide * np.cos(angle), 0.2 * wide * np.sin(angle), 1.0 - z], -1).reshape(-1, 3)
    return measure(points, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]), 1.0)


def test_a_loft_measures_a_cone(cone):
    middle = len(cone.along) // 2
    assert cone.half[middle] == pytest.approx([0.225, 0.15], abs=0.006)  # slabs of 7 cm count their widest place
    assert np.abs(cone.centre[:, 0]) == pytest.approx(0.1, abs=2e-3)
    on_surface = np.array([[0.1 + cone.half[middle, 0], 0.0, 0.5], [0.1, cone.half[middle, 1], 0.5]])
    np.testing.assert_allclose(cone.distance(on_surface), 0.0, atol=2e-3)
    assert cone.distance(np.array([[0.1, 0.0, 0.5]]))[0] < -0.1
    assert cone.distance(np.array([[0.1, 0.0, 1.3]]))[0] > 0.2


def test_a_loft_hangs_flares_and_widens(cone):
    hanging = cone.hanging(0.0, 0.5)
    start = np.searchsorted(cone.along, 0.5)
    assert np.diff(hanging.half[start:, 0]).min() >= 0.0
    np.testing.assert_array_equal(hanging.half[: start - 1], cone.half[: start - 1])
    np.testing.assert_allclose(cone.hanging(1.0, 0.5).half, cone.half)
    np.testing.assert_allclose(cone.wider(0.02).half - cone.half, 0.02)
    np.testing.assert_allclose((cone.flared(0.5, 0.3).half - cone.half)[-1], 0.3 * (cone.along[-1] - 0.5))
    assert cone.reach(np.array([[0.0, 0.0, 0.5]]))[0] == pytest.approx(0.325, abs=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_random_styles_repeat_and_keep_the_limits(kind):
    styles = [random_style(kind, np.random.default_rng(seed)) for seed in (3, 3, 4)]
    assert styles[0] == styles[1] != styles[2]
    assert all(LIMITS[name][0] <= low <= high <= LIMITS[name][1] for name, (low, high) in RANGES[kind].items())
    assert RANGES["top"].get("strap", (0.06, 1))[0] >= 0.055


def test_styles_out_of_range_are_refused():
    with pytest.raises(DrapeError, match=r"garment style: strap is 0\.02; expected 0\.055 to 0\.12"):
        GarmentStyle(strap=0.02)
    with pytest.raises(DrapeError, match="ease is nan"):
        GarmentStyle(ease=float("nan"))
    with pytest.raises(DrapeError, match="found 'cape'; expected one of tshirt"):
        random_style("cape", np.random.default_rng(0))


def test_triangle_quality_of_known_triangles():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0], [0, 1, 0], [2, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    np.testing.assert_allclose(triangle_quality(vertices, faces), [1.0, np.sqrt(0.75), 0.0], atol=1e-12)
