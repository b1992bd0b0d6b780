"""Motion capture: our own motions, written as the BVH files of other skeletons, come back."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drape.errors import DrapeError
from drape.figure.bvh import read_bvh
from drape.figure.figure import Figure
from drape.figure.kinematics import joint_positions
from drape.figure.motions import make_motion
from drape.figure.pose import FORWARDS
from drape.figure.retarget import own_hinge, shortest_turn
from drape.figure.skeleton import ARM_DROP, JOINTS, PARENTS, bone_directions
from drape.figure.skinning import pose_vertices
from tests.figures import usual_figure

FPS = 30.0
TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
MIXAMO = ["Hips", "Spine", "Spine2", "Neck", "Head"]
MIXAMO += [side + part for side in ("Left", "Right") for part in ("Shoulder", "Arm", "ForeArm", "Hand")]
MIXAMO += [side + part for side in ("Left", "Right") for part in ("UpLeg", "Leg", "Foot")]
BIOVISION = ["Hips", "Chest", "Chest2", "Neck", "Head"]
BIOVISION += [side + part for side in ("Left", "Right") for part in ("Collar", "Shoulder", "Elbow", "Wrist")]
BIOVISION += [side + part for side in ("Left", "Right") for part in ("Hip", "Knee", "Ankle")]
CMU = ["root", "lowerback", "thorax", "lowerneck", "head"]
CMU += [side + part for side in ("l", "r") for part in ("clavicle", "humerus", "radius", "wrist")]
CMU += [side + part for side in ("l", "r") for part in ("femur", "tibia", "foot")]


@pytest.fixture(scope="module")
def figure() -> Figure:
    return usual_figure()


@pytest.fixture(scope="module")
def motion(figure) -> np.ndarray:
    return make_motion("walk", figure, 24, FPS, np.random.default_rng(2))


def t_pose(figure: Figure) -> list[np.ndarray]:
    """For each joint the turn from our rest to one with level arms and upright legs."""
    turns = []
    for name, direction in bone_directions(figure.shape).items():
        side = 1.0 if name.startswith("left") else -1.0
        if name.endswith(("upper_arm", "forearm", "hand")):
            turns.append(Rotation.from_euler("y", -side * ARM_DROP).as_matrix())
        elif name.endswith(("thigh", "shin")):
            turns.append(shortest_turn(direction, np.array([0.0, 0.0, -1.0])))
        else:
            turns.append(np.eye(3))
    return turns


def folded(figure: Figure) -> list[np.ndarray]:
    """All limbs, up the spine, on one line, as in LAFAN1, and every limb turned about itself."""
    turns = t_pose(figure)
    directions = bone_directions(figure.shape)
    for index, name in enumerate(JOINTS):
        if name.endswith(("thigh", "shin")):
            upper = "thigh" if name.endswith("thigh") else "shin"
            thigh = name.replace(upper, "thigh")
            along = np.array([0.0, 0.0, 1.0])
            turned = Rotation.from_euler("z", 2.0).as_matrix() @ shortest_turn(directions[thigh], along)
            turns[index] = turned if upper == "thigh" else shortest_turn(turned @ directions[name], along) @ turned
        elif name.endswith("foot"):
            turns[index] = turns[index - 1]
    return turns


def write_bvh(
    path: Path, figure: Figure, transforms: np.ndarray, names: list[str], rest: list[np.ndarray], order: str = "ZXY",
    unit: float = 100.0, fps: float = FPS, up: np.ndarray = TO_Y_UP,
) -> None:  # fmt: skip
    """A skeleton whose bones at rest are ours turned by ``rest``, with the same motion in the world."""
    world = np.einsum("fjab,jcb->fjac", transforms[..., :3, :3], np.array(rest))
    local = world.copy()
    parents = np.array(PARENTS)
    local[:, 1:] = np.swapaxes(world[:, parents[1:]], -1, -2) @ world[:, 1:]
    local = up @ local @ up.T
    root = joint_positions(figure.joints, transforms)[:, 0] @ up.T * unit
    children = [[child for child, parent in enumerate(PARENTS) if parent == joint] for joint in range(len(JOINTS))]
    lines, sequence = ["HIERARCHY"], []

    def write(joint: int) -> None:
        parent = PARENTS[joint]
        offset = rest[parent] @ (figure.joints[joint] - figure.joints[parent]) if parent >= 0 else np.zeros(3)
        channels = "6 Xposition Yposition Zposition" if parent < 0 else "3"
        lines.extend([
            f"{'ROOT' if parent < 0 else 'JOINT'} {names[joint]}", "{",
            "OFFSET " + " ".join(f"{value:.9f}" for value in up @ offset * unit),
            f"CHANNELS {channels} " + " ".join(f"{axis}rotation" for axis in order),
        ])  # fmt: skip
        sequence.append(joint)
        for child in children[joint]:
            write(child)
        if not children[joint]:
            tip = up @ rest[joint] @ bone_directions(figure.shape)[JOINTS[joint]] * unit * 0.1
            lines.extend(["End Site", "{", "OFFSET " + " ".join(f"{value:.9f}" for value in tip), "}"])
        lines.append("}")

    write(0)
    lines.extend(["MOTION", f"Frames: {len(transforms)}", f"Frame Time: {1 / fps:.8f}"])
    for frame in range(len(transforms)):
        angles = Rotation.from_matrix(local[frame]).as_euler(order, degrees=True)  # upper case: about turned axes
        values = np.concatenate([root[frame], *angles[sequence]])
        lines.append(" ".join(f"{value:.8f}" for value in values))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def compare(figure: Figure, expected: np.ndarray, found: np.ndarray, atol: float) -> None:
    """Joints and turns, but for the place on the ground."""
    places = [joint_positions(figure.joints, transforms) for transforms in (expected, found)]
    places = [place - place[0, 0] for place in places]
    np.testing.assert_allclose(places[1], places[0], atol=atol)
    np.testing.assert_allclose(found[..., :3, :3], expected[..., :3, :3], atol=max(5 * atol, 0.006))


@pytest.mark.parametrize("order", ["ZXY", "XYZ", "YZX", "ZYX"])
@pytest.mark.parametrize("rest", [t_pose, lambda figure: [np.eye(3)] * len(JOINTS)])
def test_a_motion_comes_back(tmp_path, figure, motion, order, rest):
    write_bvh(tmp_path / "walk.bvh", figure, motion, MIXAMO, rest(figure), order)
    compare(figure, motion, read_bvh(tmp_path / "walk.bvh", figure, 24, FPS), 1e-5)


def test_limbs_that_are_folded_at_rest_are_turned_by_their_hinges(tmp_path, figure):
    motion = make_motion("squat", figure, 24, FPS, np.random.default_rng(0))
    write_bvh(tmp_path / "squat.bvh", figure, motion, MIXAMO, folded(figure))
    found = read_bvh(tmp_path / "squat.bvh", figure, 24, FPS)
    compare(figure, motion, found, 0.02)


def test_a_hinge_bends_the_limb_the_right_way():
    for name in ("left_upper_arm", "right_upper_arm"):
        side = 1.0 if name.startswith("left") else -1.0
        arm = np.array([side * np.cos(ARM_DROP), 0.0, -np.sin(ARM_DROP)])
        bent = Rotation.from_rotvec(0.5 * own_hinge(name)).apply(arm)
        assert bent @ FORWARDS > 0.4
    assert Rotation.from_rotvec(0.5 * own_hinge("left_thigh")).apply([0.0, 0.0, -1.0]) @ FORWARDS < -0.4


@pytest.mark.parametrize("names", [BIOVISION, CMU, [f"mixamorig:{name}" for name in MIXAMO], list(JOINTS)])
def test_names_of_many_conventions_are_known(tmp_path, figure, motion, names):
    write_bvh(tmp_path / "walk.bvh", figure, motion, names, t_pose(figure))
    compare(figure, motion, read_bvh(tmp_path / "walk.bvh", figure, 24, FPS), 1e-5)


def test_other_names_can_be_given(tmp_path, figure, motion):
    names = [f"bone{index}" for index in range(len(JOINTS))]
    write_bvh(tmp_path / "walk.bvh", figure, motion, names, t_pose(figure))
    with pytest.raises(DrapeError, match="walk.bvh: found no pelvis, .* among the joints bone0, .*; say which"):
        read_bvh(tmp_path / "walk.bvh", figure, 24, FPS)
    given = dict(zip(JOINTS, names, strict=True))
    compare(figure, motion, read_bvh(tmp_path / "walk.bvh", figure, 24, FPS, names=given), 1e-5)
    with pytest.raises(DrapeError, match="has no joint 'elbow' for 'left_forearm'; expected one of bone0"):
        read_bvh(tmp_path / "walk.bvh", figure, 24, FPS, names={"left_forearm": "elbow"})
    with pytest.raises(DrapeError, match="the figure has no joint 'left_forarm'; .* did you mean 'left_forearm'"):
        read_bvh(tmp_path / "walk.bvh", figure, 24, FPS, names={"left_forarm": "bone7"})


@pytest.mark.parametrize(
    ("unit", "name"),
    [(1.0, "metres"), (100.0, "centimetres"), (39.37, "inches"), (1000.0, "millimetres"), (17.7, "CMU")],
)
def test_units_are_guessed_and_stated(tmp_path, figure, motion, caplog, unit, name):
    write_bvh(tmp_path / "walk.bvh", figure, motion, MIXAMO, t_pose(figure), unit=unit)
    with caplog.at_level(logging.INFO, logger="drape.figure.bvh"):
        found = read_bvh(tmp_path / "walk.bvh", figure, 24, FPS)
    assert name in caplog.text
    compare(figure, motion, found, 1e-4)


def test_a_recording_of_many_frames_is_resampled(tmp_path, figure):
    fine = make_motion("dance", figure, 161, 120.0, np.random.default_rng(1))
    write_bvh(tmp_path / "dance.bvh", figure, fine, MIXAMO, t_pose(figure), fps=120.0)
    found = read_bvh(tmp_path / "dance.bvh", figure, 41, FPS)
    compare(figure, fine[::4], found, 1e-4)
    later = read_bvh(tmp_path / "dance.bvh", figure, 11, FPS, start=1.0)
    compare(figure, fine[120::4], later, 1e-4)
    between = read_bvh(tmp_path / "dance.bvh", figure, 80, 61.3)
    speed = np.diff(joint_positions(figure.joints, between), axis=0) * 61.3
    assert np.linalg.norm(np.diff(speed, axis=0), axis=2).max() < 0.6
    with pytest.raises(DrapeError, match=r"has 161 frames, 1.33 s; expected 1.67 s for 51 .* at most 41 frames"):
        read_bvh(tmp_path / "dance.bvh", figure, 51, FPS)


def test_a_body_stands_on_the_ground_at_the_origin(tmp_path, figure, motion):
    shifted = motion.copy()
    shifted[..., :3, 3] += [5.0, -3.0, 0.7]
    write_bvh(tmp_path / "walk.bvh", figure, shifted, MIXAMO, t_pose(figure), up=np.eye(3))
    found = read_bvh(tmp_path / "walk.bvh", figure, 24, FPS, up="z")
    np.testing.assert_array_equal(found, read_bvh(tmp_path / "walk.bvh", figure, 24, FPS), "it stands along z")
    compare(figure, motion, found, 1e-5)
    lowest = pose_vertices(figure.rest_positions, figure.bones, figure.weights, found)[:, :, 2].min(axis=1)
    assert np.abs(lowest).max() < 0.02
    assert np.abs(joint_positions(figure.joints, found)[0, 0, :2]).max() < 0.1
    with pytest.raises(DrapeError, match="up axis 'x'; expected 'y' or 'z'"):
        read_bvh(tmp_path / "walk.bvh", figure, 24, FPS, up="x")


def edited(path: Path, old: str, new: str) -> Path:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("HIERARCHY", "MESH", "is no BVH file; expected the sections HIERARCHY"),
        ("MOTION", "", "is no BVH file"),
        ("JOINT LeftLeg", "JOINT LeftCalf", "found no left_shin among the joints Hips"),
        ("CHANNELS 3 Z", "CHANNELS 2 X", "cannot read the hierarchy near|found the channels"),
        ("CHANNELS 3 Zrotation", "CHANNELS 3 Wrotation", "found the channels Wrotation"),
        ("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 1 Zrotation", "expected 24 frames of 58 channels, 1392"),
        ("Frames: 24", "Frames: 25", "found 1440 values; expected 25 frames of 60 channels, 1500"),
        ("Frames: 24", "Frames: many", "cannot read the motion"),
        ("Frame Time: 0.0333", "Frame Time: -0.0333", "a frame time of -0.0333.* s; expected finite numbers"),
        ("OFFSET 0.0000", "OFFSET nan", "cannot read the hierarchy|finite offsets"),
        ("JOINT Spine", "JOIN Spine", "cannot read the hierarchy near .*JOIN"),
    ],
)
def test_broken_files_are_refused(tmp_path, figure, motion, old, new, sentence):
    write_bvh(tmp_path / "walk.bvh", figure, motion, MIXAMO, t_pose(figure))
    with pytest.raises(DrapeError, match=rf"walk\.bvh: .*({sentence})"):
        read_bvh(edited(tmp_path / "walk.bvh", old, new), figure, 24, FPS)


def test_numbers_that_are_not_finite_are_refused(tmp_path, figure, motion):
    write_bvh(tmp_path / "walk.bvh", figure, motion, MIXAMO, t_pose(figure))
    lines = (tmp_path / "walk.bvh").read_text(encoding="utf-8").splitlines()
    lines[-2] = "nan " + lines[-2].split(" ", 1)[1]
    (tmp_path / "walk.bvh").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(DrapeError, match="walk.bvh: frame 22 is not finite"):
        read_bvh(tmp_path / "walk.bvh", figure, 24, FPS)


def test_a_missing_file_is_refused(tmp_path, figure):
    with pytest.raises(DrapeError, match="none.bvh: cannot be read .*; expected a BVH file"):
        read_bvh(tmp_path / "none.bvh", figure, 24, FPS)
