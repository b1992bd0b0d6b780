"""Bodies from files: right at the scene's times, whatever the file's rate; every bad one refused with a sentence."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh

from drape.blender import read_meshes as animation
from drape.errors import DrapeError
from drape.reading.files import natural_order, read_file
from drape.scene.follow import follow
from drape.scene.obstacle import Obstacle
from drape.scene.obstacle_file import read_body, read_obstacle, resample

BALL = trimesh.creation.icosphere(1, 0.5)
FACES, X = np.array(BALL.faces), np.array(BALL.vertices)
RECORDED = X + np.linspace(0, 1, 11)[:, None, None] * [1.0, 0.0, 2.0]
"""11 frames: at 10 per second 1 m/s along x and 2 m/s along z for a second."""

needs_blender = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")


def npz(path: Path, **changes: object) -> Path:
    arrays = {"faces": FACES, "positions": RECORDED, "fps": 10.0} | changes
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


def folder(path: Path, frames: np.ndarray = RECORDED, kind: str = "obj") -> Path:
    path.mkdir()
    for number, positions in enumerate(frames, start=1):
        trimesh.Trimesh(positions, FACES, process=False).export(path / f"body_{number}.{kind}")
    return path


def test_a_body_stands_still_or_moves_until_its_last_frame():
    still, moving = Obstacle(FACES, X[None]), Obstacle(FACES, RECORDED)
    assert still.is_static
    assert (still.at(0) == still.at(99)).all()
    assert (moving.at(10) == RECORDED[10]).all()
    for frame in (11, -1):
        with pytest.raises(DrapeError, match=rf"body: asked for frame {frame}; expected 0\.\.10; simulate fewer"):
            moving.at(frame)


@pytest.mark.parametrize(
    ("faces", "positions", "sentence"),
    [
        (np.zeros((0, 3), np.int64), X[None], r"faces: found shape \(0, 3\)"),
        (FACES, X[None, :9], r"faces: found vertex 41; expected 0\.\.8, as the body has 9 vertices; faces and pos"),
        (FACES - 1, X[None], "faces: found -1; expected whole numbers"),
        (FACES, np.where(np.arange(42)[:, None] == 7, np.nan, X)[None], "positions: frame 0, vertex 7: found .*nan"),
    ],
)
def test_bodies_that_are_none_are_refused(faces, positions, sentence):
    with pytest.raises(DrapeError, match=f"^body: {sentence}"):
        Obstacle(faces, positions)


@pytest.mark.parametrize("fps", [10.0, 25.0, 30.0, 240.0])
def test_the_body_is_where_it_should_be_at_the_times_of_the_scene(tmp_path, fps):
    frames = int(fps)
    body = read_obstacle(npz(tmp_path / "body.npz"), 1 / fps, frames)
    times = np.arange(frames + 1) / fps
    np.testing.assert_allclose(body.positions, X + times[:, None, None] * [1.0, 0.0, 2.0], atol=1e-12)


def test_resampling_interpolates_and_reproduces_recorded_frames():
    x = np.random.default_rng(0).normal(size=(4, 2, 3))
    np.testing.assert_array_equal(resample(x, 10.0, 0.1, 3, "body"), x)
    np.testing.assert_allclose(resample(x, 10.0, 0.05, 6, "body")[1::2], 0.5 * (x[1:] + x[:-1]), atol=1e-12)
    np.testing.assert_allclose(resample(x, 10.0, 0.2, 1, "body"), x[::2], atol=1e-12)


def test_every_kind_of_file_gives_the_same_body(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.update({"faces": FACES, "positions": RECORDED, "fps": 10.0})
    with h5py.File(tmp_path / "b.hdf5", "w") as file:
        file.update({"faces": FACES, "positions": RECORDED})
        file.attrs["fps"] = 10.0
    expected = read_obstacle(npz(tmp_path / "body.npz"), 1 / 30, 30)
    sources = [(tmp_path / "a.h5", None), (tmp_path / "b.hdf5", None), (folder(tmp_path / "walk"), 10.0)]
    sources.append((npz(tmp_path / "unsaid.npz", fps=None), 10.0))
    for path, fps in sources:
        body = read_obstacle(path, 1 / 30, 30, fps)
        np.testing.assert_array_equal(body.faces, expected.faces)
        np.testing.assert_allclose(body.positions, expected.positions, atol=1e-6)


def test_a_single_mesh_stands_still(tmp_path):
    BALL.export(tmp_path / "ball.stl")
    body = read_obstacle(tmp_path / "ball.stl", 1 / 30, 1000)
    assert body.is_static
    assert len(body.at(0)) == len(X), "the vertices of an STL are shared again"


def test_unit_and_axis_of_a_body(tmp_path):
    body = read_obstacle(npz(tmp_path / "body.npz"), 0.1, 10, scale=0.01, up_axis="y")
    np.testing.assert_allclose(body.at(10).mean(axis=0), [0.01, -0.02, 0.0], atol=1e-12)


def test_seams_of_a_body_are_closed_within_what_is_asked():
    """The two sides of the seam are 0.01 mm apart."""
    path = Path(__file__).parents[1] / "fixtures" / "by_hand" / "seam.obj"
    for weld, vertices in ((None, 9), (0.0, 11), (2e-5, 9)):
        assert read_body(path, 0.1, 1, scale=0.01, weld=weld).positions.shape[1] == vertices


def test_files_of_a_folder_are_in_natural_order():
    names = ["body_10.obj", "body_9.obj", "body_1.obj", "a2_b10.obj", "a2_b9.obj", "a10_b1.obj"]
    ordered = [path.name for path in sorted(map(Path, names), key=natural_order)]
    assert ordered == ["a2_b9.obj", "a2_b10.obj", "a10_b1.obj", "body_1.obj", "body_9.obj", "body_10.obj"]


NAN = np.where(np.arange(11)[:, None, None] == 4, np.nan, RECORDED)
BAD_ARRAYS = {
    "too short": ({"positions": RECORDED[:5]}, r"found 5 frames at 10 per second, 0\.4 s; expected 1 s, .* to 12 or"),
    "nan": ({"positions": NAN}, "frame 4, vertex 0: found .*nan.*; expected finite positions"),
    "no rate": ({"fps": None}, "found 11 frames without a rate; expected frames per second: set scene.body_fps"),
    "rate zero": ({"fps": 0.0}, r"fps: found 0\.0; expected frames per second, more than 0"),
    "rates": ({"fps": [1.0, 2.0]}, "fps: found 2 numbers; expected one"),
    "no positions": ({"positions": None}, r"positions: found nothing; expected numbers of shape \(frames, vertices, 3"),
    "no frames axis": ({"positions": X}, r"positions: found float64 of shape \(42, 3\); expected numbers of shape"),
    "no faces": ({"faces": None}, r"faces: found nothing; expected numbers of shape \(faces, 3\)"),
    "faces of floats": ({"faces": FACES + 0.5}, "faces: found float64; expected whole numbers"),
    "words": ({"positions": np.full((2, 2, 3), "x")}, "positions: found <U1 of shape .*; expected numbers"),
    "empty": ({"faces": FACES[:0]}, "found no triangle; expected a mesh with faces"),
    "another mesh": ({"faces": FACES + 7}, r"faces index 7\.\.48; expected 0\.\.41, as positions has so many"),
    "objects": ({"positions": np.array([{}], object)}, "cannot be read"),
}


@pytest.mark.parametrize("name", BAD_ARRAYS)
def test_bad_arrays_are_refused_with_a_sentence(tmp_path, name):
    changes, sentence = BAD_ARRAYS[name]
    with pytest.raises(DrapeError, match=rf"/body\.npz: {sentence}"):
        read_obstacle(npz(tmp_path / "body.npz", **changes), 1 / 30, 30)


def test_two_rates_must_agree(tmp_path):
    path = npz(tmp_path / "body.npz")
    assert read_obstacle(path, 0.1, 10, fps=10.0).num_frames == 11
    with pytest.raises(DrapeError, match=r"found 10 frames per second in the file and scene\.body_fps=24; leave"):
        read_obstacle(path, 0.1, 10, fps=24.0)


@pytest.mark.parametrize("name", ["body.npz", "body.h5", "body.abc.txt", "body"])
def test_files_that_are_no_body_are_refused(tmp_path, name):
    (tmp_path / name).write_bytes(b"no body")
    sentence = "cannot be read" if name in ("body.npz", "body.h5") else "expected a folder of meshes or one of .obj"
    with pytest.raises(DrapeError, match=rf"/{name}: .*{sentence}"):
        read_obstacle(tmp_path / name, 1 / 30, 30)
    with pytest.raises(DrapeError, match="nobody: no such file or folder; give the path of a mesh"):
        read_obstacle(tmp_path / "nobody", 1 / 30, 30)


def test_a_folder_with_a_changing_mesh_or_without_any_is_refused(tmp_path):
    walk = folder(tmp_path / "walk", RECORDED[:3])
    trimesh.creation.icosphere(2, 0.5).export(walk / "body_4.obj")
    with pytest.raises(DrapeError, match=r"body_4\.obj: found 162 vertices and 320 faces .* body_1\.obj \(42 and 80\)"):
        read_obstacle(walk, 0.1, 3, fps=10.0)
    (tmp_path / "empty").mkdir()
    with pytest.raises(DrapeError, match="empty: found no mesh in this folder; expected one file a frame"):
        read_obstacle(tmp_path / "empty", 0.1, 3)


def test_a_body_that_is_inside_out_is_turned_over(tmp_path):
    """Also one with a hole, and one far from the origin."""
    for name, faces, positions in (
        ("closed", FACES, RECORDED), ("open", FACES[1:], RECORDED), ("far", FACES, RECORDED + [100.0, 0.0, 0.0]),
    ):  # fmt: skip
        right = read_obstacle(npz(tmp_path / f"{name}.npz", faces=faces, positions=positions), 0.1, 10)
        turned = read_obstacle(npz(tmp_path / f"{name}.npz", faces=faces[:, ::-1], positions=positions), 0.1, 10)
        assert ordered(right.faces) == ordered(faces)
        assert ordered(turned.faces) == ordered(faces)


def ordered(faces: np.ndarray) -> set[tuple[int, ...]]:
    """Faces by their smallest corner: which way they wind, not where they begin."""
    return {tuple(np.roll(face, -int(np.argmin(face))).tolist()) for face in faces}


def test_points_follow_a_rigid_motion_rigidly():
    rng = np.random.default_rng(0)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    moved = np.stack([X, X @ turn.T + [1.0, 2.0, 3.0]])
    points = 1.1 * X[:5] + 0.01
    np.testing.assert_allclose(follow(Obstacle(FACES, moved), points)[0], points, atol=1e-12)
    np.testing.assert_allclose(follow(Obstacle(FACES, moved), points)[1], points @ turn.T + [1, 2, 3], atol=1e-12)


def test_points_follow_the_face_that_is_near():
    """One part of the body moves, the other stays: each point goes with its own."""
    two = np.concatenate([X, X + [5.0, 0.0, 0.0]])
    away = np.concatenate([X, X + [5.0, 0.0, 3.0]])
    body = Obstacle(np.concatenate([FACES, FACES + len(X)]), np.stack([two, away]))
    led = follow(body, np.array([[0.0, 0.0, 0.6], [5.0, 0.0, 0.6]]))
    np.testing.assert_allclose(led[1], [[0.0, 0.0, 0.6], [5.0, 0.0, 3.6]], atol=1e-12)


MAKE_ANIMATIONS = """
import sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps, scene.frame_start, scene.frame_end = 25, 1, 11
bpy.ops.mesh.primitive_cube_add(size=1)
cube = bpy.context.object
for frame, place in ((1, (0, 0, 1)), (11, (1, 0, 2))):
    cube.location = place
    cube.keyframe_insert("location", frame=frame)
for curve in cube.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
    for key in curve.keyframe_points:
        key.interpolation = "LINEAR"
bpy.ops.export_scene.gltf(filepath=sys.argv[1] + "/cube.glb")
bpy.ops.wm.alembic_export(filepath=sys.argv[1] + "/cube.abc", as_background_job=False)
bpy.ops.wm.usd_export(filepath=sys.argv[1] + "/cube.usdc", export_animation=True)
cube.animation_data_clear()
bpy.ops.export_scene.gltf(filepath=sys.argv[1] + "/still.glb")
bpy.ops.object.delete()
bpy.ops.object.camera_add()
bpy.ops.export_scene.gltf(filepath=sys.argv[1] + "/nothing.glb", export_cameras=True)
"""


@pytest.fixture(scope="module")
def animations(tmp_path_factory) -> Path:
    """A cube that moves 1 m along x and up within 0.4 s, as animators store it, at 25 frames per second."""
    path = tmp_path_factory.mktemp("animations")
    subprocess.run([sys.executable, "-c", MAKE_ANIMATIONS, str(path)], check=True, capture_output=True)
    return path


@needs_blender
@pytest.mark.blender
@pytest.mark.parametrize(("name", "fps"), [("cube.glb", None), ("cube.abc", None), ("cube.usdc", None)])
def test_animations_are_read_at_the_times_of_the_scene(animations, name, fps):
    body = read_obstacle(animations / name, 1 / 30, 12, fps)
    assert body.num_frames == 13
    centres = body.positions.mean(axis=1)
    np.testing.assert_allclose(centres, np.linspace(0, 1, 13)[:, None] * [1, 0, 1] + [0, 0, 1], atol=1e-5)
    np.testing.assert_allclose(np.ptp(body.at(3), axis=0), 1.0, atol=1e-5)


@needs_blender
@pytest.mark.blender
def test_animations_that_cannot_be_used_are_refused(animations, tmp_path):
    assert read_obstacle(animations / "still.glb", 1 / 30, 99).is_static
    with pytest.raises(DrapeError, match=r"cube\.glb: found 13 frames at 30 per second, 0\.4 s; expected 1 s"):
        read_obstacle(animations / "cube.glb", 1 / 30, 30)
    with pytest.raises(DrapeError, match=r"nothing\.glb: found no mesh with faces; expected a mesh; export its faces"):
        read_obstacle(animations / "nothing.glb", 1 / 30, 12)
    (tmp_path / "torn.glb").write_bytes((animations / "cube.glb").read_bytes()[:200])
    with pytest.raises(DrapeError, match=r"torn\.glb: Blender cannot open it .*export it again"):
        read_file(tmp_path / "torn.glb", animated=True)


def test_without_blender_the_sentence_says_which_python_and_which_command(monkeypatch):
    monkeypatch.setattr(animation.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DrapeError, match=r'needs Python 3\.11 exactly: python3\.11 -m pip install -e ".\[blender\]"'):
        animation.read(Path("walk.glb"), 1 / 30, 10, None)
