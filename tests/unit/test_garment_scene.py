"""Recorded garments as scenes, and what a simulator has to beat there."""

from __future__ import annotations

import numpy as np
import pytest

from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import START, garment_scene, recorded_scene
from drape.data.stored_part import Header, StoredBody, StoredSequence
from drape.errors import DrapeError
from drape.simulators.baselines import Ballistic, Frozen, Skinned, Twin
from drape.simulators.simulator import Simulator
from tests import garments

BASELINES = {"skinned": Skinned, "frozen": Frozen, "ballistic": Ballistic, "twin": Twin}


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> GarmentFile:
    return GarmentFile(garments.write(tmp_path_factory.mktemp("garments") / "garments.h5"))


def animated(simulator: Simulator, scene) -> np.ndarray:
    """All frames of a scene."""
    state, x = scene.initial, [scene.initial.x]
    for frame in range(scene.frames):
        state = simulator.step(state, frame).state
        x.append(state.x)
    return np.stack(x)


# Scenes


def test_a_scene_starts_from_two_recorded_frames_and_has_the_rest_as_reference(file):
    sequence = file.sequence("00001")
    scene = recorded_scene(sequence)
    assert scene.frames == garments.FRAMES - 2
    np.testing.assert_array_equal(scene.initial.x, sequence.positions[1])
    np.testing.assert_allclose(scene.initial.v, (sequence.positions[1] - sequence.positions[0]) * 30)
    np.testing.assert_array_equal(scene.reference, sequence.positions[1:])
    assert (scene.material.name, scene.friction, scene.dt) == ("silk", 0.3, 1 / 30)
    np.testing.assert_allclose(scene.mass, 0.02)
    np.testing.assert_array_equal(scene.gravity, [0, 0, -9.81])


def test_a_cloth_of_another_weight(file):
    sequence = file.sequence("00001")
    scene = recorded_scene(sequence, areal_density=0.2)
    corners = sequence.mesh.rest_positions[sequence.mesh.faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    np.testing.assert_allclose(scene.mass.sum(), 0.2 * area)
    with pytest.raises(DrapeError, match="areal_density: found 0.0; expected a positive number"):
        recorded_scene(sequence, areal_density=0.0)


def test_body_and_pins_are_those_of_the_same_instant(file):
    """Frame k of the scene is the recorded frame k + 1: a body that lags by a frame would be wrong by 5 mm."""
    sequence = file.sequence("00002")
    scene = recorded_scene(sequence, 3)
    for frame in range(4):
        np.testing.assert_array_equal(scene.obstacle.at(frame), sequence.body_positions[START + frame])
        np.testing.assert_array_equal(scene.pins.at(frame), sequence.positions[START + frame, garments.TOP])
    np.testing.assert_array_equal(scene.pins.vertices, garments.TOP)
    assert recorded_scene(file.sequence("00001")).pins is None


def test_a_sequence_without_friction_slips_freely(tmp_path):
    path = garments.write(tmp_path / "slippery.h5", friction=0.0)
    assert garment_scene(str(path), "00001").friction is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("00001", 5), r"frames: found 5; expected 1\.\.4, as 6 are recorded"),
        (("00001", 0), r"frames: found 0; expected 1\.\.4"),
        (("7",), "found no sequence '7'; expected one of 4, from 00000 to 00003"),
        (("00002", None, "silk"), "found a garment of denim; expected one of silk.* choose fabric=denim"),
    ],
)
def test_what_the_file_does_not_have_is_refused(file, arguments, words):
    with pytest.raises(DrapeError, match=words):
        garment_scene(str(file.path), *arguments)


def test_the_motion_of_a_body_alone_is_refused(tmp_path):
    points, faces = garments.tube()
    alone = StoredSequence("00000", "body", "walk", "test", body_positions=garments.carried(points))
    header = Header("vto", 30.0, (0.0, 0.0, -9.81), {}, "{}")
    garments.write_groups(tmp_path / "vto.h5", header, {"body": StoredBody(points, faces)}, {}, [alone])
    with pytest.raises(DrapeError, match="found the motion of a body without recorded positions of a garment"):
        garment_scene(str(tmp_path / "vto.h5"), "00000")


# Baselines


@pytest.mark.parametrize("name", BASELINES)
def test_every_baseline_leads_the_pinned_vertices_and_says_how_fast_it_moves(file, name):
    sequence = file.sequence("00002")
    scene = recorded_scene(sequence)
    result = BASELINES[name](scene, sequence).step(scene.initial, 0)
    np.testing.assert_array_equal(result.state.x[garments.TOP], scene.pins.at(1))
    np.testing.assert_allclose(result.state.v, (result.state.x - scene.initial.x) * 30, atol=1e-12)


@pytest.mark.parametrize("name", BASELINES)
def test_the_same_call_gives_the_same_frame(file, name):
    scene = recorded_scene(file.sequence("00001"))
    simulator = BASELINES[name](scene, file.sequence("00001"))
    first, second = (simulator.step(scene.initial, 2).state.x for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_the_twin_is_a_millionth_of_a_metre_away_and_frame_by_frame(file):
    sequence = file.sequence("00001")
    scene = recorded_scene(sequence)
    x = animated(Twin(scene, sequence), scene)
    np.testing.assert_allclose(x, scene.reference, atol=1e-5)
    np.testing.assert_array_equal(x[1:], sequence.twin[START + 1 :])


def test_a_sequence_without_twin_has_no_noise_floor(file):
    with pytest.raises(DrapeError, match="has no twin"):
        Twin(recorded_scene(file.sequence("00003")), file.sequence("00003"))


def test_frozen_stays_and_ballistic_falls(file):
    sequence = file.sequence("00001")
    scene = recorded_scene(sequence)
    assert (animated(Frozen(scene, sequence), scene) == scene.initial.x).all()
    x = animated(Ballistic(scene, sequence), scene)
    fallen = x[-1] - x[0] - scene.frames * scene.dt * scene.initial.v
    np.testing.assert_allclose(fallen, np.broadcast_to([0, 0, -9.81 / 30**2 * 10], fallen.shape), atol=1e-9)


def test_skinning_carries_the_recorded_start_rigidly_with_a_rigid_body(file):
    """By the joints where there are some, by the faces of the body where not: the same for a rigid motion."""
    expected = garments.carried(garments.recorded()[1])[START:]
    for name in ("00001", "00003"):
        sequence = file.sequence(name)
        scene = recorded_scene(sequence)
        x = animated(Skinned(scene, sequence), scene)
        free = np.setdiff1d(np.arange(len(x[0])), [] if scene.pins is None else scene.pins.vertices)
        np.testing.assert_allclose(x[:, free], expected[:, free], atol=2e-6)


def test_skinning_may_start_from_the_rest_shape(file):
    sequence = file.sequence("00001")
    scene = recorded_scene(sequence)
    x = animated(Skinned(scene, sequence, start="rest"), scene)
    np.testing.assert_allclose(x[1:], garments.carried(garments.tube()[0])[START + 1 :], atol=1e-6)
    with pytest.raises(DrapeError, match="simulator.start: found 'first'; expected recorded or rest"):
        Skinned(scene, sequence, start="first")
    with pytest.raises(DrapeError, match="has no skinning weights of the garment"):
        Skinned(recorded_scene(file.sequence("00003")), file.sequence("00003"), start="rest")
