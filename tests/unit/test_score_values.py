"""Scores of animations on motions of two frames that can be counted by hand: which frame, which mean, which unit."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import nn

from drape.contact.penetration import Penetration
from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import recorded_scene
from drape.geometry.normals import vertex_normals
from drape.metrics.collision import behind_nearest_vertex
from drape.metrics.drift import energy_drift, momentum_drift
from drape.metrics.garment_metric import GarmentMetric
from drape.metrics.garment_scores import AnimatedGarment, frame_scores
from drape.metrics.position import distance_by_frame, distance_travelled
from drape.metrics.rollout_scores import EVERY, rollout_scores
from drape.scene.material import ATTRIBUTES
from drape.scene.obstacle import Obstacle
from drape.simulators.neural.cloths import RecordedCloths
from tests import garments

CLOTHS = RecordedCloths(dict.fromkeys(ATTRIBUTES, 1.0))
PAIR = np.zeros((3, 2, 3))
"""Two vertices that do not move for three frames."""


def moved(*steps: tuple[int, int, float]) -> np.ndarray:
    """:data:`PAIR` with (frame, vertex, metres upwards)."""
    x = PAIR.copy()
    for frame, vertex, by in steps:
        x[frame, vertex, 2] = by
    return x


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> GarmentFile:
    return GarmentFile(garments.write(tmp_path_factory.mktemp("garments") / "garments.h5", frames=EVERY + 3))


@pytest.fixture(scope="module")
def scene(file):
    return recorded_scene(file.sequence("00001"))


# Distances and drifts


def test_distances_are_means_over_vertices_in_each_frame():
    """Of two vertices one is 3 m off in frame 1, both are 2 m off in frame 2."""
    x = moved((1, 0, 3.0), (2, 0, 2.0), (2, 1, -2.0))
    assert distance_by_frame(x, PAIR).tolist() == [0.0, 1.5, 2.0]
    assert distance_travelled(x) == pytest.approx((1.5 + 2.0) / 2)


def test_momentum_is_that_of_the_centre_of_mass_per_second():
    """One of two vertices rises by 0.2 m within 0.1 s and stays: the centre at 1 m/s, then 0."""
    x = moved((1, 0, 0.2), (2, 0, 0.2))
    np.testing.assert_allclose(momentum_drift(x, PAIR, 0.1), [1.0, 0.0], atol=1e-12)


def test_energy_is_that_per_mass_whichever_has_more_of_it():
    """The same: v = 2 m/s of one in two is ½ 4 / 2 = 1 J/kg, and 0.1 m of the centre under 10 m/s² is 1 J/kg."""
    x, gravity = moved((1, 0, 0.2), (2, 0, 0.2)), np.array([0.0, 0.0, -10.0])
    np.testing.assert_allclose(energy_drift(x, PAIR, 0.1, gravity), [2.0, 1.0])
    np.testing.assert_allclose(energy_drift(PAIR, x, 0.1, gravity), [2.0, 1.0])


# Bodies


def test_normals_are_weighted_by_area():
    """At the origin a face of 2 m² looks up and one of ½ m² to the side: (1, 0, 4)/√17."""
    x = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 1, 0], [0, 0, 1.0]])
    normal = vertex_normals(x, np.array([[0, 1, 2], [0, 3, 4]]))[0]
    np.testing.assert_allclose(normal, np.array([1.0, 0.0, 4.0]) / np.sqrt(17.0))


def test_the_side_is_seen_from_the_nearest_vertex_of_the_body():
    """Below a plate that is 1 m above the origin, though above the origin."""
    plate = np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1]])
    x = np.array([[0.0, 0.0, 0.9], [0.0, 0.0, 1.1]])
    np.testing.assert_array_equal(behind_nearest_vertex(x, plate, np.array([[0, 1, 2]])), [True, False])


def jumping(scene, frame: int, frames: int = 3):
    """The scene with a body that is far away in all frames but one, and the garment as it was at first, beside it."""
    far = scene.obstacle.positions[:frames] + [9.0, 0.0, 0.0]
    centre = scene.reference[0].mean(axis=0)
    far[frame] = scene.obstacle.positions[0] - scene.obstacle.positions[0].mean(axis=0) + centre
    still = np.repeat(scene.reference[:1], frames, axis=0)
    still = centre + 0.5 * (still - centre)  # half its size: inside of the ball
    return replace(scene, obstacle=Obstacle(scene.obstacle.faces, far), frames=frames - 1, pins=None, reference=still)


@pytest.mark.parametrize("frame", [1, 2])
def test_collisions_are_with_the_body_of_the_same_frame(scene, frame):
    """The body is there in one frame only; all of a tube of 7 cm in a ball of 12 cm is inside then."""
    there = jumping(scene, frame)
    scores = frame_scores(AnimatedGarment(there.reference, there))
    expected = [100.0 * (k == frame) for k in (1, 2)]
    np.testing.assert_allclose(scores["collision_percent"], expected)
    np.testing.assert_allclose(scores["inside_percent"], expected)
    deepest = 1e3 * (garments.RADIUS - 0.07)
    assert scores["deepest_mm"][frame - 1] == pytest.approx(deepest, rel=0.1), "where the tube is nearest to the middle"
    assert scores["deepest_mm"][2 - frame] <= 0.0


def test_the_share_inside_is_that_of_the_area(scene):
    """A ball as small as to hold one vertex of the rim, and nothing else: what that stands for of the area."""
    x = np.repeat(scene.reference[:1], 2, axis=0)
    ball = scene.obstacle.positions[0] - scene.obstacle.positions[0].mean(axis=0)
    tiny = np.repeat((0.05 * ball + x[0, 0])[None], 2, axis=0)
    there = replace(scene, obstacle=Obstacle(scene.obstacle.faces, tiny), frames=1, pins=None, reference=x)
    share = Penetration(scene.mesh, there.obstacle).share
    assert share[0] > 1.5 / len(share), "a vertex stands for more than a point does on the mean"
    assert frame_scores(AnimatedGarment(x, there))["inside_percent"][0] == pytest.approx(100.0 * share[0])


# Cloth


def test_scores_of_frame_k_are_those_of_frame_k(scene):
    """The garment grows to k + 1 times its size in frame k, the recorded one stays; so does its floor."""
    frames = 3
    still = np.repeat(scene.reference[:1], frames, axis=0)
    resting = np.repeat(scene.mesh.rest_positions[None].astype(float), frames, axis=0)
    grown = (1.0 + np.arange(frames))[:, None, None] * resting
    twin = still + 0.001 * np.arange(frames)[:, None, None] * [0.0, 0.0, 1.0]
    there = replace(scene, reference=still, obstacle=None, friction=None, pins=None, frames=frames - 1)
    scores = frame_scores(AnimatedGarment(grown, there, twin))
    np.testing.assert_allclose(scores["stretch"], [2.0, 3.0], rtol=1e-5)
    np.testing.assert_allclose(scores["floor_mm"], [1.0, 2.0])
    np.testing.assert_allclose(scores["error_mm"], 1e3 * np.linalg.norm(grown - still, axis=-1).mean(1)[1:])


def test_the_99th_percentile_is_of_the_most_stretched_edges(scene):
    """One vertex far away: a few per cent of the edges are long."""
    x = np.repeat(scene.mesh.rest_positions[None].astype(float), 2, axis=0)
    x[1, 30] += [0.0, 0.0, 5.0]
    there = replace(scene, reference=x, obstacle=None, friction=None, pins=None, frames=1)
    lengths = np.linalg.norm(np.diff(x[1][scene.mesh.edges], axis=1)[:, 0], axis=-1) / scene.mesh.rest_lengths
    assert (lengths > 2.0).mean() < 0.05
    assert frame_scores(AnimatedGarment(x, there))["stretch_p99"][0] == pytest.approx(np.percentile(lengths, 99))


def test_hems_are_compared_with_those_recorded_in_the_same_frame(scene):
    """The recorded hem becomes jagged in frame 2: an animation that is as it was then has 1, not less."""
    x = np.repeat(scene.reference[:1], 3, axis=0)
    x[2, garments.TOP[::2], 2] += 0.05
    there = replace(scene, reference=x, obstacle=None, friction=None, pins=None, frames=2)
    np.testing.assert_allclose(frame_scores(AnimatedGarment(x, there))["hem_times"], [1.0, 1.0])


def test_drifts_have_the_time_step_and_the_gravity_of_the_scene(scene):
    """All rises by 1 cm in frame 1: 0.01/dt of speed; ½ v² + 0.01 g of energy."""
    still = np.repeat(scene.reference[:1], 3, axis=0)
    x = still.copy()
    x[1:, :, 2] += 0.01
    there = replace(scene, reference=still, obstacle=None, friction=None, pins=None, frames=2)
    scores, speed = frame_scores(AnimatedGarment(x, there)), 0.01 * garments.FPS
    np.testing.assert_allclose(scores["momentum_drift_m_per_s"], [speed, 0.0], atol=1e-9)
    np.testing.assert_allclose(scores["energy_drift_J_per_kg"], [0.5 * speed**2 + 0.01 * 9.81, 0.01 * 9.81])


def test_self_intersection_is_measured_every_few_frames_and_at_the_end(scene):
    x = np.repeat(scene.reference[:1], EVERY + 2, axis=0)
    there = replace(scene, obstacle=None, friction=None, pins=None)
    found = frame_scores(AnimatedGarment(x, replace(there, reference=x, frames=EVERY + 1)))["self_intersection_percent"]
    assert np.isfinite(found).tolist() == [k in (EVERY, EVERY + 1) for k in range(1, EVERY + 2)]


# Of a network in training


class Coasts(nn.Module):
    """Accelerations of 0."""

    def __init__(self):
        super().__init__()
        self.nothing, self.seen = nn.Parameter(torch.zeros(())), []

    def forward(self, step):
        self.seen.append(step)
        return torch.zeros_like(step.x)


def test_a_rollout_meets_the_body_of_each_of_its_frames(file, monkeypatch):
    """The body comes to the garment in the one frame that is looked at: all of it is inside, in per cent."""
    sequence = file.sequence("00001")
    whole = recorded_scene(sequence)
    there = jumping(whole, EVERY, frames=EVERY + 2)
    there = replace(there, initial=type(there.initial).at_rest(there.reference[0]), gravity=np.zeros(3))
    monkeypatch.setattr("drape.metrics.rollout_scores.recorded_scene", lambda *_: there)
    scores = rollout_scores(Coasts(), CLOTHS, sequence).scores
    assert scores["collision_percent"] == pytest.approx(100.0)
    assert scores["inside_percent"] == pytest.approx(1.0 * 100.0)
    assert scores["error_mm"] == pytest.approx(0.0, abs=1e-6)


def test_a_network_is_shown_the_body_from_frame_to_frame(file):
    """The scene begins at the recorded frame 1; steps are relative to the middle of the garment."""
    network, sequence = Coasts(), file.sequence("00001")
    x = rollout_scores(network, CLOTHS, sequence, 4).x
    for k, step in enumerate(network.seen):
        for body, frame in ((step.obstacle.x, k + 1), (step.obstacle.x_next, k + 2)):
            np.testing.assert_allclose(body + x[k].mean(axis=0), sequence.body_positions[frame], atol=1e-9)
    assert len(network.seen) == 4


def test_time_is_that_of_a_frame(file, monkeypatch):
    """A clock that goes on by 3 s from look to look: of five frames each has taken 600 ms."""
    times = iter([10.0, 13.0])
    monkeypatch.setattr("drape.metrics.rollout_scores.time", SimpleNamespace(perf_counter=lambda: next(times)))
    assert rollout_scores(Coasts(), CLOTHS, file.sequence("00001"), 5).scores["ms_per_frame"] == pytest.approx(600.0)


def test_sequences_are_added():
    """1, 2 and 6 mm: mean 3, deviation √(14/3)."""
    metric = GarmentMetric(["dress"], ["error_mm"])
    for error in (1.0, 2.0, 6.0):
        metric.update("dress", {"error_mm": error})
    found = metric.compute()
    assert found["error_mm/dress"] == pytest.approx(3.0)
    assert found["error_mm_std/dress"] == pytest.approx((14.0 / 3.0) ** 0.5)
