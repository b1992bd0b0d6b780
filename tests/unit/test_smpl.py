"""SMPL: the forward pass against cases known by heart, and pickles that are read without running what is in them."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import types
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.spatial.transform import Rotation

from drape.data.smpl.body_model import JOINTS, SmplModel
from drape.data.smpl.convert_pickle import convert, main
from drape.data.smpl.plain_unpickler import read_plain_pickle
from drape.errors import DrapeError
from tests.smpl_bodies import PARENTS, save_model, small_model

VERTICES = 30


def rest(body: SmplModel, shape: np.ndarray) -> np.ndarray:
    return body.rest_positions + body.shape_directions[..., : len(shape)] @ shape


def random_poses(frames: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(frames, 72))


def test_without_a_pose_the_body_is_its_shape() -> None:
    body, shape = small_model(), np.linspace(-1, 1, 10)
    translation = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    found = body.posed(np.zeros((2, 72)), shape, translation)
    np.testing.assert_allclose(found, rest(body, shape) + translation[:, None], atol=1e-12)


def test_the_root_turns_the_body_rigidly_about_its_joint() -> None:
    body, shape = small_model(), np.linspace(-1, 1, 10)
    poses = np.zeros((1, 72))
    poses[0, :3] = [0.3, -1.2, 0.7]
    turn = Rotation.from_rotvec(poses[0, :3]).as_matrix()
    shaped = rest(body, shape)
    root = body.joint_regressor[0] @ shaped
    where = np.array([[5.0, 6.0, 7.0]])
    turned = (shaped - root) @ turn.T
    np.testing.assert_allclose(body.posed(poses, shape, where)[0], turned + root + where[0], atol=1e-9)
    moved = body.posed(poses, shape, where, root_at_origin=True)[0]
    np.testing.assert_allclose(moved, turned + where[0], atol=1e-9)  # the root lies at where


def test_a_joint_turns_what_hangs_on_it() -> None:
    """The elbow (18) bends: what hangs on the hand (20 is its child) turns about the elbow, the rest stays."""
    weights = np.zeros((VERTICES, JOINTS))
    weights[:10, 20], weights[10:, 17] = 1.0, 1.0
    body = small_model(weights=weights, pose_directions=np.zeros((VERTICES, 3, 207)))
    poses = np.zeros((1, 72))
    poses[0, 3 * 18 : 3 * 19] = [0.0, 0.0, np.pi / 2]
    found = body.posed(poses, np.zeros(10), np.zeros((1, 3)))[0]
    elbow = body.joint_regressor[18] @ body.rest_positions
    offset = body.rest_positions[:10] - elbow
    expected = elbow + np.stack([-offset[:, 1], offset[:, 0], offset[:, 2]], axis=1)
    np.testing.assert_allclose(found[:10], expected, atol=1e-12)
    np.testing.assert_allclose(found[10:], body.rest_positions[10:], atol=1e-12)


def test_a_child_turns_in_the_frame_of_its_parent() -> None:
    """Hip (1) about z, knee (4) about x: R_hip R_knee, in this order, and the knee goes where the hip takes it."""
    weights = np.zeros((VERTICES, JOINTS))
    weights[:, 4] = 1.0
    body = small_model(weights=weights, pose_directions=np.zeros((VERTICES, 3, 207)))
    poses = np.zeros((1, 72))
    poses[0, 3 * 1 + 2], poses[0, 3 * 4] = 0.4, 0.9
    hip, knee = body.joint_regressor[[1, 4]] @ body.rest_positions
    about_z, about_x = Rotation.from_rotvec([0, 0, 0.4]).as_matrix(), Rotation.from_rotvec([0.9, 0, 0]).as_matrix()
    expected = hip + (knee - hip) @ about_z.T + (body.rest_positions - knee) @ (about_z @ about_x).T
    np.testing.assert_allclose(body.posed(poses, np.zeros(1), np.zeros((1, 3)))[0], expected, atol=1e-12)


def test_bends_displace_the_rest_shape() -> None:
    """With one direction only, for the entry (row 0, column 1) of the third joint's R - 1."""
    directions = np.zeros((VERTICES, 3, 207))
    directions[:, 2, 9 * 2 + 1] = 1.0
    weights = np.zeros((VERTICES, JOINTS))
    weights[:, 0] = 1.0
    body = small_model(weights=weights, pose_directions=directions)
    poses = np.zeros((1, 72))
    poses[0, 9:12] = [0.0, 0.0, 0.6]
    moved = body.posed(poses, np.zeros(10), np.zeros((1, 3)))[0] - body.rest_positions
    np.testing.assert_allclose(moved, np.tile([0.0, 0.0, -np.sin(0.6)], (VERTICES, 1)), atol=1e-12)


def test_frames_do_not_depend_on_each_other() -> None:
    body, poses, where = small_model(), random_poses(70), np.random.default_rng(3).normal(size=(70, 3))
    shapes = np.random.default_rng(4).normal(size=(70, 10))
    together = body.posed(poses, shapes, where)
    for frame in (0, 31, 32, 69):
        alone = body.posed(poses[[frame]], shapes[frame], where[[frame]])[0]
        np.testing.assert_allclose(together[frame], alone, atol=1e-10)


def test_more_shape_parameters_than_the_model_has() -> None:
    with pytest.raises(DrapeError, match="shape: found 13 parameters; expected at most 12"):
        small_model().posed(np.zeros((1, 72)), np.zeros(13), np.zeros((1, 3)))


class Ch:
    """As chumpy pickles its arrays: the attributes but the caches."""


class Select(Ch):
    pass


class Reshape(Ch):
    pass


@pytest.fixture
def chumpy() -> Iterator[None]:
    """A package of that name while something is pickled; it is gone when it is read."""
    modules = {name: types.ModuleType(name) for name in ("chumpy", "chumpy.ch", "chumpy.reordering")}
    for kind, name in ((Ch, "chumpy.ch"), (Select, "chumpy.reordering"), (Reshape, "chumpy.reordering")):
        setattr(modules[name], kind.__name__, kind)
        kind.__module__ = name
    sys.modules.update(modules)
    yield
    for name in modules:
        sys.modules.pop(name, None)


def made(kind: type, **state: object) -> object:
    result = kind()
    result.__dict__.update(state, _dirty_vars=set(), _itr=None)
    return result


def store(path: Path, content: object, protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(content, protocol=protocol))
    for name in ("chumpy", "chumpy.ch", "chumpy.reordering"):
        sys.modules.pop(name, None)
    return path


def as_distributed(body: SmplModel, joints: int = JOINTS) -> dict[str, object]:
    """The dictionary in SMPL's files: chumpy arrays, a sparse regressor, the root's parent wrapped around."""
    chosen = np.arange(VERTICES * 3 * 12).reshape(VERTICES, 3, 12)
    whole = made(Ch, x=np.concatenate([body.shape_directions.ravel(), np.zeros(5)]))
    tree = np.stack([np.where(body.parents < 0, 2**32 - 1, body.parents), np.arange(JOINTS)]).astype(np.uint32)
    return {
        "v_template": made(Reshape, a=made(Ch, x=body.rest_positions.ravel()), newshape=(VERTICES, 3)),
        "f": body.faces.astype(np.uint32),
        "shapedirs": made(Select, a=whole, idxs=chosen.ravel(), preferred_shape=chosen.shape),
        "posedirs": body.pose_directions,
        "J_regressor": sparse.csc_matrix(body.joint_regressor)[:joints],
        "weights": made(Ch, x=body.weights[:, :joints]),
        "kintree_table": tree[:, :joints],
        "bs_type": "lrotmin",
        "J": made(Ch, x=body.joint_regressor @ body.rest_positions),
    }


@pytest.mark.parametrize("protocol", [0, 2, 5])
def test_a_model_is_converted_without_chumpy(chumpy: None, tmp_path: Path, protocol: int) -> None:
    body = small_model()
    source = store(tmp_path / "model_f.pkl", as_distributed(body), protocol)
    assert convert(source, tmp_path / "smpl" / "female.npz") == "model"
    found = SmplModel.load(tmp_path / "smpl" / "female.npz")
    for name in SmplModel.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(found, name), getattr(body, name))


def test_a_pickle_of_python_2_is_read(tmp_path: Path) -> None:
    """Protocol 0 with Python 2's module names and byte strings."""
    content = (
        b"(dp0\nS'pose'\np1\ncnumpy.core.multiarray\n_reconstruct\np2\n(cnumpy\nndarray\np3\n(I0\ntp4\nS'b'\np5\ntp6\n"
        b"Rp7\n(I1\n(I2\ntp8\ncnumpy\ndtype\np9\n(S'u1'\nI0\nI1\ntp10\nRp11\n(I3\nS'|'\nNNNI-1\nI-1\nI0\ntp12\nbI00\n"
        b"S'\\x01\\xff'\np13\ntp14\nbsS'kinds'\nc__builtin__\nset\n((lp15\nS'a'\natRs."
    )
    (tmp_path / "old.pkl").write_bytes(content)
    found = read_plain_pickle(tmp_path / "old.pkl")
    assert found["pose"].tolist() == [1, 255]
    assert found["kinds"] == {"a"}


class Program:
    """What a hostile pickle looks like."""

    def __init__(self, call: object, *arguments: object) -> None:
        self.call, self.arguments = call, arguments

    def __reduce__(self) -> tuple:
        return self.call, self.arguments


@pytest.mark.parametrize(
    "call", [os.system, eval, getattr, subprocess.call, pickle.loads, np.load, np.fromfile, np.ctypeslib.as_array]
)
def test_a_pickle_that_does_something_is_refused(tmp_path: Path, call: object) -> None:
    """Nothing runs, wherever in the file it stands."""
    witness = tmp_path / "witness"
    source = store(tmp_path / "bad.pkl", {"pose": np.zeros(3), "x": [Program(call, f"touch {witness}")]})
    with pytest.raises(DrapeError, match=r"bad.pkl: cannot be read as plain numbers \(UnpicklingError: asks for "):
        read_plain_pickle(source)
    assert not witness.exists()


def test_an_array_is_never_made_of_raw_memory(tmp_path: Path) -> None:
    source = store(tmp_path / "bad.pkl", {"pose": Program(np.ndarray, (1,), "O", b"12345678")})
    with pytest.raises(DrapeError, match="pose: found an object _ArrayType of nothing; expected an array"):
        read_plain_pickle(source)


def test_files_that_are_no_pickle_of_numbers(chumpy: None, tmp_path: Path) -> None:
    with pytest.raises(DrapeError, match="absent.pkl: no such file"):
        read_plain_pickle(tmp_path / "absent.pkl")
    (tmp_path / "text.pkl").write_text("hello")
    with pytest.raises(DrapeError, match="text.pkl: cannot be read as plain numbers"):
        read_plain_pickle(tmp_path / "text.pkl")
    unknown = store(tmp_path / "unknown.pkl", {"f": made(Ch, y=3)})
    with pytest.raises(DrapeError, match="unknown.pkl: f: found an object Ch of .*; expected an array"):
        read_plain_pickle(unknown)
    with pytest.raises(DrapeError, match="list.pkl: found a list; expected a dictionary of arrays"):
        read_plain_pickle(store(tmp_path / "list.pkl", [1, 2]))
    other = store(tmp_path / "other.pkl", {"poses": np.zeros(3)})
    with pytest.raises(DrapeError, match=r"other.pkl: found poses; expected an SMPL model \(.*\) or a motion"):
        convert(other, tmp_path / "other.npz")
    words = store(tmp_path / "words.pkl", {"pose": np.array(["a"]), "translation": np.zeros(3), "shape": np.zeros(3)})
    with pytest.raises(DrapeError, match="words.pkl: poses: found <U1; expected an array of numbers"):
        convert(words, tmp_path / "other.npz")
    assert not (tmp_path / "other.npz").exists()


def test_a_folder_is_converted_and_what_is_left_out_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "in" / "deep").mkdir(parents=True)
    motion = {"pose": np.ones((5, 72)), "translation": np.ones((5, 3)), "shape": [1.0]}
    store(tmp_path / "in" / "deep" / "a.pkl", motion)
    store(tmp_path / "in" / "b.pkl", {"x": Program(os.system, "true")})
    assert main([str(tmp_path / "in"), str(tmp_path / "out")]) == 2
    assert "left out" in capsys.readouterr().err
    with np.load(tmp_path / "out" / "deep" / "a.npz") as file:
        assert (file["poses"].shape, file["shape"].tolist()) == ((5, 72), [1.0])
    (tmp_path / "in" / "b.pkl").unlink()
    assert main([str(tmp_path / "in"), str(tmp_path / "out")]) == 0
    assert main([]) == 2


def test_a_model_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    with pytest.raises(DrapeError, match=r"model.npz: no such file; make it from your own SMPL model with: python -m "):
        SmplModel.load(path)
    save_model(path, small_model(), parents=np.arange(52) - 1)
    with pytest.raises(DrapeError, match="model.npz: found a body of 52 joints; expected the 24 of SMPL"):
        SmplModel.load(path)
    save_model(path, small_model(), pose_directions=np.zeros((VERTICES, 3, 459)))
    with pytest.raises(DrapeError, match=r"pose_directions: found shape \(30, 3, 459\); expected .* \(30, 3, 207\)"):
        SmplModel.load(path)
    save_model(path, small_model(), weights=None)
    with pytest.raises(DrapeError, match="model.npz: found .*; expected rest_positions, .*weights"):
        SmplModel.load(path)
    save_model(path, small_model(), parents=PARENTS[::-1])
    with pytest.raises(DrapeError, match="expected parents before children"):
        SmplModel.load(path)
    path.write_text("not an npz")
    with pytest.raises(DrapeError, match="model.npz: cannot be read"):
        SmplModel.load(path)
