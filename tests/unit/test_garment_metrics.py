"""Metrics of animated garments on cases whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh

from drape.contact.penetration import Penetration, distances
from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import recorded_scene
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.normals import vertex_normals
from drape.geometry.surface_points import SurfacePoints
from drape.metrics.collision import behind_nearest_vertex
from drape.metrics.drift import energy_drift, momentum_drift
from drape.metrics.garment_metric import GarmentMetric
from drape.metrics.garment_scores import SCORES, AnimatedGarment, frame_scores, sequence_scores
from drape.metrics.hem import hem_angle, hem_corners
from drape.metrics.record import EvaluationRecord
from drape.metrics.self_intersection import self_intersecting
from drape.scene.obstacle import Obstacle
from tests import garments

BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
POINTS, FACES = np.array(BALL.vertices), np.array(BALL.faces)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = garments.write(tmp_path_factory.mktemp("garments") / "garments.h5")
    return recorded_scene(GarmentFile(path).sequence("00001"))


# Collisions


def test_normals_of_a_ball_point_outwards():
    np.testing.assert_allclose(vertex_normals(POINTS, FACES), POINTS / 0.3, atol=0.012)


def test_a_vertex_inside_a_ball_counts_and_one_outside_does_not():
    x = np.array([[0.0, 0.0, 0.25], [0.0, 0.31, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(behind_nearest_vertex(x, POINTS, FACES), [True, False, True, False])
    ball = Obstacle(FACES, POINTS[None])
    np.testing.assert_allclose(np.maximum(-distances(x, ball, 0), 0.0), [0.05, 0.0, 0.3, 0.0], atol=3e-3)


def test_the_paper_does_not_count_what_is_far_away():
    """A vertex behind a single face, as if that were a body."""
    plate, face = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
    below = np.array([[0.1, 0.1, -0.4], [0.1, 0.1, -0.6]])
    np.testing.assert_array_equal(behind_nearest_vertex(below, plate, face), [True, False])


def test_the_side_of_a_sharp_edge_is_told_by_all_its_faces():
    """Above the edge of a wedge the nearest face alone would say inside for a vertex that is outside."""
    box = trimesh.creation.box(extents=[1.0, 1.0, 0.01])
    x = np.array([[0.502, 0.0, 0.0], [0.498, 0.0, 0.0], [0.0, 0.0, 0.006], [0.0, 0.0, 0.004]])
    inside = distances(x, Obstacle(np.array(box.faces), np.array(box.vertices)[None]), 0) < 0
    np.testing.assert_array_equal(inside, [False, True, False, True])


# Self-intersection


def test_two_faces_that_cross_count_and_neighbours_do_not():
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    upright = np.array([[0.2, 0.2, -0.5], [0.3, 0.2, 0.5], [0.2, 0.3, 0.5]])
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    assert self_intersecting(np.concatenate([flat, upright]), faces).all()
    assert not self_intersecting(np.concatenate([flat, upright + [0, 0, 0.51]]), faces).any(), "above it"
    assert not self_intersecting(np.concatenate([flat, upright + [0.7, 0.7, 0]]), faces).any(), "beside it"
    shared = np.concatenate([flat, [[0.0, 0.1, -0.5], [0.3, 0.2, 0.5]]])
    assert not self_intersecting(shared, np.array([[0, 1, 2], [0, 3, 4]])).any(), "they share a vertex"


def test_a_face_that_a_corner_pokes_through_counts_whatever_the_order():
    rng = np.random.default_rng(0)
    for _ in range(20):
        flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        spike = np.array([[0.3, 0.3, 0.1], [0.4, 0.2, -1.0], [0.2, 0.4, -1.0]])
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        x = np.concatenate([rng.permutation(flat), rng.permutation(spike)]) @ turn
        assert self_intersecting(x, np.array([[0, 1, 2], [3, 4, 5]])).all()


def test_a_smooth_cloth_does_not_intersect_itself_and_two_balls_do_in_a_ring():
    assert not self_intersecting(POINTS, FACES).any()
    other = trimesh.util.concatenate([BALL, BALL.copy().apply_translation([0.31, 0.013, 0.007])])
    x, faces = np.array(other.vertices), np.array(other.faces)
    found = self_intersecting(x, faces)
    centre = x[faces[found]].mean(axis=1)
    assert 100 < found.sum() < 200
    ring = np.linalg.norm(centre[:, 1:], axis=1)
    assert abs(ring - np.sqrt(0.3**2 - 0.155**2)).max() < 0.04, "where two spheres meet"
    assert found[: len(FACES)].any()
    assert found[len(FACES) :].any()


def test_large_faces_among_small_ones_are_found():
    """A blade of two triangles cuts a sheet of many: classes of size are compared with one another."""
    sheet = square_grid(1.0, 20)
    blade = np.array([[0.313, -2.0, -1.0], [0.313, 2.0, -1.0], [0.313, 0.0, 1.7]])
    x = np.concatenate([sheet.rest_positions - sheet.rest_positions.mean(0), blade - [0.31, 0, 0] + [0.011, 0, 0]])
    faces = np.concatenate([sheet.faces, [[400, 401, 402]]])
    found = self_intersecting(x, faces)
    assert found[-1]
    assert 19 <= found[:-1].sum() <= 40


# Motion


def test_energy_and_momentum_of_the_same_motion_do_not_drift():
    t = np.arange(5)[:, None, None] / 30
    fall = np.zeros((5, 4, 3)) + 0.5 * np.array([0, 0, -9.81]) * t**2
    gravity = np.array([0.0, 0.0, -9.81])
    assert energy_drift(fall, fall, 1 / 30, gravity).max() == 0
    assert momentum_drift(fall, fall, 1 / 30).max() == 0
    gliding = fall + np.array([0.3, 0, 0]) * t
    np.testing.assert_allclose(momentum_drift(gliding, fall, 1 / 30), 0.3)
    np.testing.assert_allclose(energy_drift(gliding, fall, 1 / 30, gravity), 0.5 * 0.3**2)
    np.testing.assert_allclose(energy_drift(fall + [0, 0, 2.0], fall, 1 / 30, gravity), 2.0 * 9.81)


# All scores of a sequence


def test_a_cloth_that_is_moved_by_3_mm_has_an_error_of_3_mm(scene):
    moved = scene.reference + [0.003, 0.0, 0.0]
    moved[0] = scene.reference[0]
    scores = frame_scores(AnimatedGarment(moved, scene, twin=scene.reference + [0.0, 0.0, 0.001]))
    assert set(scores) == set(SCORES)
    np.testing.assert_allclose(scores["error_mm"], np.full(scene.frames, 3.0))
    np.testing.assert_allclose(scores["floor_mm"], np.full(scene.frames, 1.0))
    assert {len(values) for values in scores.values()} == {scene.frames}


def test_fewer_frames_than_recorded_are_compared_with_the_first(scene):
    scores = frame_scores(AnimatedGarment(scene.reference[:3], scene))
    np.testing.assert_array_equal(scores["error_mm"], [0.0, 0.0])
    assert np.isnan(scores["floor_mm"]).all()


def test_a_rigid_motion_has_stretch_1_and_a_cloth_twice_as_large_has_2(scene):
    rest = scene.mesh.rest_positions
    turned = np.repeat((rest @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0] + 5.0)[None], 3, axis=0)
    for factor in (1.0, 2.0):
        scores = frame_scores(AnimatedGarment(factor * turned, scene))
        np.testing.assert_allclose(scores["stretch"], factor)
        np.testing.assert_allclose(scores["stretch_p99"], factor)


def test_a_garment_pushed_into_the_body_collides(scene):
    """The tube squeezed to half its width lies inside the ball but for its rims; of its surface a larger share."""
    x = scene.reference[:2].copy()
    x[1, :, :2] = x[1, :, :2].mean(axis=0) + 0.5 * (x[1, :, :2] - x[1, :, :2].mean(axis=0))
    scores = frame_scores(AnimatedGarment(x, scene))
    expected = 100 * (np.linalg.norm(x[1] - scene.obstacle.at(1).mean(axis=0), axis=1) < garments.RADIUS).mean()
    assert expected > 50
    points = SurfacePoints.of(MeshBatch.from_meshes([scene.mesh]), 1, 1).at(torch.tensor(x[1])).numpy()
    deep = np.linalg.norm(points - scene.obstacle.at(1).mean(axis=0), axis=1) < garments.RADIUS
    share = Penetration(scene.mesh, scene.obstacle).share
    assert scores["inside_percent"][0] == pytest.approx(100 * share[deep].sum(), abs=1)
    assert scores["collision_percent"][0] == pytest.approx(expected, abs=1)
    assert 0 < scores["deepest_mm"][0] < 1e3 * garments.RADIUS


def test_without_a_body_nothing_collides_nor_does_it_count(scene):
    scores = frame_scores(AnimatedGarment(scene.reference, replace(scene, obstacle=None, friction=None)))
    assert np.isnan(scores["inside_percent"]).all()
    assert np.isnan(sequence_scores(scores)["collision_percent"])
    assert sequence_scores(scores)["error_mm"] == 0


# Over sequences


def test_every_sequence_counts_once_and_kinds_are_kept_apart():
    metric = GarmentMetric(["dress", "skirt"], ["error_mm", "floor_mm"])
    for kind, error in (("dress", 1.0), ("dress", 3.0), ("skirt", 8.0)):
        metric.update(kind, {"error_mm": error, "floor_mm": 0.5 if kind == "dress" else np.nan})
    found = metric.compute()
    assert found["error_mm/dress"] == 2.0
    assert found["error_mm_std/dress"] == pytest.approx(1.0)
    assert found["error_mm/overall"] == 4.0
    assert found["error_mm_std/overall"] == pytest.approx(np.std([1, 3, 8]))
    assert found["floor_mm/overall"] == 0.5
    assert "floor_mm/skirt" not in found


def test_the_order_and_the_processes_do_not_matter():
    """What torchmetrics does with several processes: the sums of two halves are those of the whole."""
    rows = [("dress", 1.0), ("skirt", 2.0), ("dress", 4.0), ("skirt", 3.5)]
    whole, halves = GarmentMetric(["dress", "skirt"], ["error_mm"]), []
    for kind, error in rows:
        whole.update(kind, {"error_mm": error})
    for part in (rows[2:], rows[:2]):
        halves.append(GarmentMetric(["dress", "skirt"], ["error_mm"]))
        for kind, error in part:
            halves[-1].update(kind, {"error_mm": error})
    first, second = halves
    for state in ("count", "total", "squares"):
        setattr(first, state, getattr(first, state) + getattr(second, state))
    assert first.compute() == pytest.approx(whole.compute())


def test_unknown_kinds_are_refused():
    with pytest.raises(DrapeError, match="kind 'hat'; expected one of dress"):
        GarmentMetric(["dress"], ["error_mm"]).update("hat", {})
    with pytest.raises(DrapeError, match="expected different names"):
        GarmentMetric(["dress", "dress"], ["error_mm"])


# Records


def test_a_record_comes_back_as_it_was_and_others_are_refused(tmp_path):
    metrics = {"error_mm/dress": 1.5, "sequences/dress": 2.0, "sequences/overall": 2.0}
    record = EvaluationRecord({"name": "twin"}, {"split": "test"}, metrics, {"command": "x"})
    record.save(tmp_path)
    assert EvaluationRecord.load(tmp_path) == record
    assert record.kinds == ["dress"]
    (tmp_path / "metrics.json").write_text('{"format": "drape run", "version": 1}')
    with pytest.raises(DrapeError, match="format and version are .*drape run.* expected .*drape evaluation"):
        EvaluationRecord.load(tmp_path)


def test_hems_are_as_jagged_as_they_were_made():
    """A level sheet whose boundary vertices stand up and down in turn: the angles of a zigzag, and none at rest."""
    mesh = square_grid(1.0, 11)
    corners = hem_corners(mesh)
    assert len(corners) == 40
    assert set(corners[:, 1].tolist()) == set(mesh.edges[mesh.boundary].ravel().tolist())
    rest = mesh.rest_positions.astype(float)
    straight = hem_angle(rest[None], mesh)[0]
    assert straight == pytest.approx(np.sqrt(4 * (np.pi / 2) ** 2 / 40))
    jagged = rest.copy()
    around = [int(corners[0, 1])]
    follow = {int(here): (int(before), int(after)) for before, here, after in corners}
    while len(around) < 40:
        around.append(next(v for v in follow[around[-1]] if v not in around[-2:] and v not in around))
    jagged[around, 2] += 0.05 * (-1.0) ** np.arange(40)
    expected = 2 * np.arctan(0.1 / 0.1)
    assert hem_angle(jagged[None], mesh)[0] == pytest.approx(expected, rel=0.05)
    assert np.isnan(hem_angle(np.zeros((1, 4, 3)), tetrahedron())).all()


def tetrahedron() -> ClothMesh:
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    return ClothMesh.from_faces(x, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
