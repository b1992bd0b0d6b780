"""VTO and HOOD: motions of a body alone, from y up to z up; no garment, nothing to compare with."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drape.data.hdf5 import GarmentFile
from drape.data.smpl.convert_pickle import main as convert_pickles
from drape.data.vto.conversion import convert_vto
from drape.data.vto.motion import read_motion
from drape.errors import DrapeError
from tests.smpl_bodies import save_model, small_model

FRAMES = 8


def motion(frames: int = FRAMES, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {
        "pose": rng.normal(size=(frames, 72)),
        "translation": rng.normal(size=(frames, 3)),
        "shape": np.tile(rng.normal(size=10), (frames, 1)),
    }


def as_hood(content: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {
        "global_orient": content["pose"][:, :3],
        "body_pose": content["pose"][:, 3:],
        "transl": content["translation"],
        "betas": content["shape"][0],
    }


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Two pickles, of VTO and of HOOD, made plain by the command of the package."""
    pickles = tmp_path / "pickles"
    (pickles / "deep").mkdir(parents=True)
    (pickles / "01_01.pkl").write_bytes(pickle.dumps(motion(), protocol=2))
    (pickles / "deep" / "02_03.pkl").write_bytes(pickle.dumps(as_hood(motion(5, seed=1)), protocol=4))
    assert convert_pickles([str(pickles), str(tmp_path / "vto")]) == 0
    save_model(tmp_path / "female.npz", small_model())
    return tmp_path / "vto"


def settings(root: Path, **changes: object) -> dict[str, object]:
    node = {
        "name": "vto", "source": "vto", "path": str(root.parent / "out" / "vto.h5"), "root": str(root),
        "train": "all", "test": "none", "frames": [0, 6], "fps": 30, "smpl": str(root.parent / "female.npz"),
        "gravity": 9.81,
    }  # fmt: skip
    return node | changes


def test_motions_become_sequences_of_a_body_alone(root: Path) -> None:
    conversion = convert_vto(settings(root))
    assert (conversion.converted, conversion.left_out) == (2, {})
    with GarmentFile(conversion.path) as file:
        assert (file.source, file.fabrics, file.split("train")) == ("vto", (), ("01_01", "deep_02_03"))
        for name, content, frames in (("01_01", motion(), 6), ("deep_02_03", motion(5, seed=1), 5)):
            row = file.sequence(name)
            assert (row.num_frames, row.is_recorded, row.garment, row.motion) == (frames, False, "", name[-5:])
            found = row.body_positions
            up = small_model().posed(content["pose"], content["shape"], content["translation"])[:frames]
            np.testing.assert_allclose(found[..., 2], up[..., 1], atol=1e-6)  # y was up, z is
            np.testing.assert_allclose(found[..., 0], up[..., 0], atol=1e-6)
            np.testing.assert_allclose(found[..., 1], -up[..., 2], atol=1e-6)
            edges = [np.linalg.norm(x[:, 1:] - x[:, :-1], axis=-1) for x in (found, up)]
            np.testing.assert_allclose(edges[0], edges[1], atol=1e-5)
            assert row.window(1, 3).body_positions.shape == (3, 30, 3)


def test_a_shape_that_changes_is_followed(root: Path) -> None:
    content = motion()
    content["shape"] = np.linspace(0, 1, FRAMES)[:, None] * np.ones(10)
    np.savez(root / "grows.npz", poses=content["pose"], **{k: content[k] for k in ("translation", "shape")})
    convert_vto(settings(root, frames=[2, 8]))
    found = GarmentFile(settings(root)["path"]).sequence("grows").body_positions
    up = small_model().posed(content["pose"], content["shape"], content["translation"])
    np.testing.assert_allclose(found[..., 2], up[2:, :, 1], atol=1e-6)


def test_one_frame_and_a_constant_shape_are_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "one.npz", poses=np.zeros(72), translation=np.ones(3), shape=np.zeros(10))
    assert read_motion(tmp_path / "one.npz").num_frames == 1
    np.savez(tmp_path / "constant.npz", poses=np.zeros((4, 72)), translation=np.ones((4, 3)), shape=np.arange(10.0))
    np.testing.assert_array_equal(read_motion(tmp_path / "constant.npz").shape, np.tile(np.arange(10.0), (4, 1)))


def _motion(**changes: np.ndarray | None) -> Callable[[Path], None]:
    arrays = {"poses": np.zeros((6, 72)), "translation": np.zeros((6, 3)), "shape": np.zeros((6, 10))} | changes
    return lambda path: np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


BAD = {
    "short": (_motion(**{k: np.zeros((2, n)) for k, n in (("poses", 72), ("translation", 3), ("shape", 10))}),
              "found 2 frames; expected at least 3"),
    "joints": (_motion(poses=np.zeros((6, 156))), r"poses: found float64 of shape \(6, 156\); .*\(frames, 72\)"),
    "lengths": (_motion(translation=np.zeros((5, 3))), "found 6 of poses, 5 of translation, 6 of shape; expected"),
    "missing": (_motion(shape=None), "shape: found nothing; expected numbers"),
    "nan": (_motion(poses=np.full((6, 72), np.nan)), "poses: frame 0: found a number that is not finite"),
    "words": (_motion(poses=np.array(["a"] * 72)), "poses: found <U1 of shape"),
    "text": (lambda path: path.write_text("hello"), r"cannot be read \(.*make it with: python -m drape"),
}  # fmt: skip


def test_bad_motions_are_left_out_with_a_sentence(root: Path) -> None:
    for name, (change, _) in BAD.items():
        change(root / f"{name}.npz")
    conversion = convert_vto(settings(root))
    assert GarmentFile(conversion.path).names == ("01_01", "deep_02_03")
    assert conversion.left_out.keys() == BAD.keys()
    for name, (_, sentence) in BAD.items():
        assert re.search(rf"{name}.npz: {sentence}", conversion.left_out[name]), conversion.left_out[name]
    with pytest.raises(DrapeError, match="holds 2 sequences; 7 were left out"):
        conversion.refuse_left_out()


def test_nothing_to_convert(root: Path, tmp_path: Path) -> None:
    with pytest.raises(DrapeError, match=r"data.root: .*empty: found no motion \(.npz\); .*convert_pickle <folder>"):
        convert_vto(settings(tmp_path / "empty"))
    with pytest.raises(DrapeError, match="absent.npz: no such file; make it from your own SMPL model"):
        convert_vto(settings(root, smpl=str(tmp_path / "absent.npz")))
    listed = tmp_path / "list.txt"
    listed.write_text("01_01\nother\n")
    left_out = convert_vto(settings(root, train=str(listed))).left_out
    assert "found no other.npz below data.root" in left_out["other"]
