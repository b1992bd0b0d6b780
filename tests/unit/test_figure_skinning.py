"""Skeleton, forward kinematics, skinning."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from drape.figure.ease import ease_in
from drape.figure.figure import Figure
from drape.figure.kinematics import forward_kinematics, inverse_kinematics, joint_positions
from drape.figure.motions import make_motion
from drape.figure.skeleton import JOINTS, PARENTS
from drape.figure.skinning import pose_vertices, strongest
from tests.figures import usual_figure


@pytest.fixture(scope="module")
def figure() -> Figure:
    return usual_figure()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def random_pose(rng: np.random.Generator, frames: int, angle: float) -> tuple[np.ndarray, np.ndarray]:
    vectors = angle * rng.normal(size=(frames * len(JOINTS), 3))
    rotations = Rotation.from_rotvec(vectors).as_matrix().reshape(frames, len(JOINTS), 3, 3)
    return rotations, rng.normal(size=(frames, 3))


def test_a_bent_elbow_moves_the_hand_on_a_circle():
    joints = np.zeros((len(JOINTS), 3))
    for name, x in (("left_forearm", 1.0), ("left_hand", 1.5)):
        joints[JOINTS.index(name), 0] = x
    rotations = np.tile(np.eye(3), (1, len(JOINTS), 1, 1))
    rotations[0, JOINTS.index("left_forearm")] = Rotation.from_euler("z", np.pi / 2).as_matrix()
    posed = joint_positions(joints, forward_kinematics(joints, rotations, np.array([[0.0, 0.0, 2.0]])))
    np.testing.assert_allclose(posed[0, JOINTS.index("left_hand")], [1.0, 0.5, 2.0], atol=1e-12)
    np.testing.assert_allclose(posed[0, JOINTS.index("left_forearm")], [1.0, 0.0, 2.0], atol=1e-12)


def test_bones_keep_their_lengths_and_turns_come_back(figure, rng):
    rotations, root = random_pose(rng, 5, 0.7)
    transforms = forward_kinematics(figure.joints, rotations, root)
    posed = joint_positions(figure.joints, transforms)
    bones = [(joint, parent) for joint, parent in enumerate(PARENTS) if parent >= 0]
    for joint, parent in bones:
        length = np.linalg.norm(figure.joints[joint] - figure.joints[parent])
        np.testing.assert_allclose(np.linalg.norm(posed[:, joint] - posed[:, parent], axis=1), length)
    again, again_root = inverse_kinematics(figure.joints, transforms)
    np.testing.assert_allclose(again, rotations, atol=1e-12)
    np.testing.assert_allclose(again_root, root, atol=1e-12)


def test_skinning_is_the_weighted_sum_of_transforms(figure, rng):
    transforms = forward_kinematics(figure.joints, *random_pose(rng, 3, 0.5))
    posed = pose_vertices(figure.rest_positions, figure.bones, figure.weights, transforms)
    for frame in range(3):
        for vertex in range(0, len(figure.rest_positions), 101):
            x = np.append(figure.rest_positions[vertex], 1.0)
            pairs = zip(figure.bones[vertex], figure.weights[vertex], strict=True)
            expected = sum(weight * (transforms[frame, bone] @ x)[:3] for bone, weight in pairs)
            np.testing.assert_allclose(posed[frame, vertex], expected, atol=1e-12)


def test_a_turned_body_stays_rigid(figure, rng):
    rotations = np.tile(np.eye(3), (2, len(JOINTS), 1, 1))
    turn = Rotation.random(2, random_state=0).as_matrix()
    rotations[:, 0] = turn
    transforms = forward_kinematics(figure.joints, rotations, np.ones((2, 3)))
    posed = pose_vertices(figure.rest_positions, figure.bones, figure.weights, transforms)
    pelvis = figure.joints[0]
    expected = np.einsum("fab,vb->fva", turn, figure.rest_positions - pelvis) + pelvis + 1.0
    np.testing.assert_allclose(posed, expected, atol=1e-12)


def test_weights_are_smooth_and_belong_to_their_side(figure):
    assert figure.bones.min() >= 0
    assert figure.bones.max() < len(JOINTS)
    assert (figure.weights >= 0).all()
    np.testing.assert_allclose(figure.weights.sum(axis=1), 1.0)
    dense = np.zeros((len(figure.weights), len(JOINTS)))
    np.put_along_axis(dense, figure.bones, figure.weights, axis=1)
    edges = trimesh.Trimesh(figure.rest_positions, figure.faces, process=False).edges_unique
    assert np.abs(dense[edges[:, 0]] - dense[edges[:, 1]]).max() < 0.5
    left = dense[:, [name.startswith("left_") for name in JOINTS]].sum(axis=1)
    right = dense[:, [name.startswith("right_") for name in JOINTS]].sum(axis=1)
    assert left[figure.rest_positions[:, 0] < -0.12].max() < 0.01
    assert right[figure.rest_positions[:, 0] > 0.12].max() < 0.01
    strongest_bone = dense.argmax(axis=1)
    for joint in range(len(JOINTS)):
        if "clavicle" not in JOINTS[joint]:
            assert (strongest_bone == joint).any()


def test_the_strongest_bones_come_and_go_smoothly():
    """Where the fourth and the fifth bone change places, nothing jumps."""
    def chosen(shift: float) -> np.ndarray:
        weights = np.array([[0.4, 0.3, 0.15, 0.075 + shift, 0.075 - shift]])
        bones, kept = strongest(weights)
        dense = np.zeros((1, 5))
        np.put_along_axis(dense, bones, kept, axis=1)
        return dense

    np.testing.assert_allclose(chosen(1e-9), chosen(-1e-9), atol=1e-7)
    np.testing.assert_allclose(chosen(0.01).sum(), 1.0)


def test_points_take_the_weights_of_the_nearest_surface(figure, rng):
    bones, weights = figure.skin_weights(figure.rest_positions)
    dense, expected = np.zeros((2, len(bones), len(JOINTS)))
    np.put_along_axis(dense, bones, weights, axis=1)
    np.put_along_axis(expected, figure.bones, figure.weights, axis=1)
    np.testing.assert_allclose(dense, expected, atol=1e-6)
    wrist = figure.joints[JOINTS.index("left_hand")] + 0.05 * rng.normal(size=(10, 3))
    bones, weights = figure.skin_weights(wrist)
    assert bones.shape == weights.shape == (10, 4)
    strongest_bones = {JOINTS[bone] for bone in np.take_along_axis(bones, weights.argmax(1)[:, None], 1)[:, 0]}
    assert strongest_bones <= {"left_forearm", "left_hand"}


def test_a_body_keeps_its_volume_in_motion(figure):
    rest = trimesh.Trimesh(figure.rest_positions, figure.faces, process=False).volume
    for name, least in (("walk", 0.975), ("squat", 0.955), ("jump", 0.955), ("dance", 0.975)):
        transforms = make_motion(name, figure, 60, 30.0, np.random.default_rng(1))
        posed = pose_vertices(figure.rest_positions, figure.bones, figure.weights, transforms)
        volumes = [trimesh.Trimesh(frame, figure.faces, process=False).volume / rest for frame in posed[::6]]
        assert least < min(volumes)
        assert max(volumes) < 1.02


def test_a_motion_is_eased_into(figure, rng):
    motion = make_motion("wave", figure, 8, 30.0, rng)
    eased = ease_in(motion, figure, 30)
    assert eased.shape == (38, len(JOINTS), 4, 4)
    np.testing.assert_allclose(eased[0], np.tile(np.eye(4), (len(JOINTS), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(eased[18:30], np.tile(motion[0], (12, 1, 1, 1)), atol=1e-9)
    np.testing.assert_array_equal(eased[30:], motion)
    np.testing.assert_allclose(np.linalg.det(eased[..., :3, :3]), 1.0)
    hand = joint_positions(figure.joints, eased)[:, JOINTS.index("left_hand")]
    steps = np.linalg.norm(np.diff(hand, axis=0), axis=1)
    assert steps[:18].min() > 0
    assert steps[0] < 0.2 * steps.max()
    assert steps[17] < 0.2 * steps.max()
    assert ease_in(motion, figure, 0).shape == motion.shape
