"""CLOTH3D: files in exactly its formats, ugly parts included, come out in metres, in the world, in agreement."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.spatial.transform import Rotation

from drape.data.cloth3d import conversion
from drape.data.cloth3d.bodies import REST_POSE
from drape.data.cloth3d.conversion import convert_cloth3d
from drape.data.cloth3d.info_mat import read_info
from drape.data.cloth3d.pc16 import pc16_shape, read_pc16
from drape.data.cloth3d.rest_mesh import read_rest_mesh
from drape.data.conversion import Conversion
from drape.data.hdf5 import GarmentFile
from drape.data.schema import MATERIAL_ATTRIBUTES
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from tests.smpl_bodies import save_model, small_model

SHEET = square_grid(1.0, 4).rest_positions.astype(np.float64)
QUADS = [(r + c, r + c + 1, r + c + 5, r + c + 4) for r in (0, 4, 8) for c in range(3)]
FRAMES = 12
FABRIC = {"tension_stiffness": 15.0, "bending_stiffness": 0.5, "tension_damping": 5.0, "bending_damping": 0.0,
          "air_damping": 1.0, "mass_per_vertex": 0.3}  # fmt: skip


def write_pc16(path: Path, positions: np.ndarray, tag: bytes = b"POINTCACHE2\0", version: int = 1) -> None:
    samples, points, _ = positions.shape
    lead = tag + struct.pack("<iiffi", version, points, 0.0, 1.0, samples)
    assert len(lead) == 32
    path.write_bytes(lead + positions.astype("<f2").tobytes())


def write_obj(path: Path, positions: np.ndarray, faces: list[tuple[int, ...]]) -> None:
    """As Blender exports it: texture coordinates, more of them than vertices."""
    lines = ["# Blender", "o Garment", *(f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in positions)]
    lines += [f"vt {k / 100:.4f} 0.5" for k in range(4 * len(faces))]
    for k, face in enumerate(faces):
        lines.append("f " + " ".join(f"{vertex + 1}/{4 * k + n + 1}" for n, vertex in enumerate(face)))
    path.write_text("\n".join(lines) + "\n")


def turned(positions: np.ndarray, angle: float) -> np.ndarray:
    return positions @ Rotation.from_euler("z", angle).as_matrix().T


def relative_frames(frames: int = FRAMES, seed: int = 5) -> np.ndarray:
    return SHEET + np.random.default_rng(seed).normal(scale=0.3, size=(frames, 16, 3))


def write_sequence(folder: Path, frames: int = FRAMES, zrot: float = 0.7, gender: int = 1) -> dict[str, np.ndarray]:
    """A sequence of a dress and trousers, as distributed; returns its info."""
    garment, fabric = "Dress", "cotton"
    folder.mkdir(parents=True)
    rng = np.random.default_rng(len(folder.name))
    info = {
        "gender": gender,
        "poses": rng.normal(size=(72, frames)).squeeze(),
        "shape": rng.normal(size=10),
        "trans": rng.normal(size=(3, frames)).squeeze(),
        "outfit": {garment: {"fabric": fabric, "texture": {"type": "color"}}, "Trousers": {"fabric": "denim"}},
        "tightness": np.array([0.5, -1.5]),
        "zrot": zrot,
        "camLoc": np.zeros(3),
        "lights": {"type": "sun"},
    }
    savemat(folder / "info.mat", info)
    write_obj(folder / f"{garment}.obj", turned(SHEET, zrot), QUADS)
    write_pc16(folder / f"{garment}.pc16", relative_frames(frames))
    write_obj(folder / "Trousers.obj", SHEET, QUADS)
    return info


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in ("00010", "00034"):
        write_sequence(tmp_path / "cloth3d" / name)
    save_model(tmp_path / "male.npz", small_model())
    save_model(tmp_path / "female.npz", small_model(seed=1))
    return tmp_path / "cloth3d"


def settings(root: Path, **changes: object) -> dict[str, object]:
    above = root.parent
    node = {
        "name": "cloth3d", "source": "cloth3d", "path": str(above / "out" / "cloth3d.h5"), "root": str(root),
        "train": "none", "test": "all", "frames": [4, 10], "bodies": "smpl",
        "smpl": {"female": str(above / "female.npz"), "male": str(above / "male.npz")},
        "gravity": 9.81, "friction": 0.25,
        "fabrics": {"cotton": {"_target_": "x", "name": "cotton", **FABRIC}, "silk": FABRIC},
    }  # fmt: skip
    return node | changes


def test_a_sequence_is_read_as_it_is_distributed(root: Path) -> None:
    conversion = convert_cloth3d(settings(root))
    assert (conversion.converted, conversion.made, conversion.left_out) == (2, True, {})
    conversion.refuse_left_out()
    info = read_info(root / "00034" / "info.mat")
    with GarmentFile(conversion.path) as file:
        assert (file.source, file.fps) == ("cloth3d", 30.0)
        assert file.names == file.split("test") == ("00010", "00034")
        assert file.gravity.tolist() == [0.0, 0.0, -9.81]
        assert MATERIAL_ATTRIBUTES.keys() <= file.materials["cotton"].keys()
        row = file.sequence("00034")
        assert (row.kind, row.fabric, row.split, row.num_frames) == ("dress", "cotton", "test", 6)
        assert (row.mass_per_vertex, row.friction) == (0.3, 0.25)
        world = relative_frames().astype(np.float16)[4:10].astype(np.float64) + info.trans[4:10, None]
        np.testing.assert_allclose(row.positions, world, atol=1e-6)
        np.testing.assert_allclose(row.mesh.rest_positions, SHEET, atol=2e-6)  # zrot taken back
        moved = small_model().posed(info.poses, info.shape, info.trans, root_at_origin=True)
        np.testing.assert_allclose(row.body_positions, moved[4:10], atol=1e-6)
        assert row.window(2, 3).positions.shape == (3, 16, 3)
        assert row.twin is row.skinned is None


def test_the_body_in_its_rest_pose_stands_with_open_legs(root: Path) -> None:
    convert_cloth3d(settings(root))
    info = read_info(root / "00034" / "info.mat")
    model = small_model()
    expected = np.zeros((24, 3))
    expected[0], expected[1], expected[2] = [np.pi / 2, 0, 0], [0, 0, 0.15], [0, 0, -0.15]
    np.testing.assert_array_equal(REST_POSE.reshape(24, 3), expected)
    rest = GarmentFile(settings(root)["path"]).sequence("00034").body_rest_positions
    np.testing.assert_allclose(
        rest, model.posed(REST_POSE[None], info.shape, np.zeros((1, 3)), root_at_origin=True)[0], atol=1e-6
    )


def test_quads_are_cut_along_their_first_diagonal(root: Path) -> None:
    mesh = read_rest_mesh(root / "00034" / "Dress.obj", 0.7)
    wanted = {frozenset(t) for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))}
    assert {frozenset(face) for face in mesh.faces.tolist()} == wanted
    assert mesh.num_faces == 18


@pytest.mark.parametrize("angle", [0.0, 0.7, -2.9])
def test_rest_meshes_are_turned_back(tmp_path: Path, angle: float) -> None:
    write_obj(tmp_path / "Top.obj", turned(SHEET, angle), QUADS)
    np.testing.assert_allclose(read_rest_mesh(tmp_path / "Top.obj", angle).rest_positions, SHEET, atol=2e-6)


def test_float16_is_read_to_the_last_bit(tmp_path: Path) -> None:
    """Rounded to the nearest half, which at 1 to 2 m is a multiple of 1/1024 m, and nothing lost after that."""
    positions = np.random.default_rng(0).uniform(1.0, 2.0, (5, 7, 3))
    write_pc16(tmp_path / "a.pc16", positions)
    found = read_pc16(tmp_path / "a.pc16", 1, 4)
    np.testing.assert_array_equal(found * 1024, np.round(found * 1024))
    assert 1e-4 < np.abs(found - positions[1:4]).max() <= 0.5 / 1024
    assert pc16_shape(tmp_path / "a.pc16") == (5, 7)
    with pytest.raises(DrapeError, match="a.pc16: found 5 samples; expected samples 3 to 6"):
        read_pc16(tmp_path / "a.pc16", 3, 6)


def test_one_frame_has_lost_a_dimension(root: Path) -> None:
    """MATLAB squeezes (72, 1) to (72,) and (3, 1) to (3,): read as one frame, and too few to convert."""
    info = write_sequence(root / "one", frames=1)
    assert info["poses"].shape == (72,)
    found = read_info(root / "one" / "info.mat")
    np.testing.assert_array_equal(found.poses, info["poses"][None])
    np.testing.assert_array_equal(found.trans, info["trans"][None])
    assert found.num_frames == 1
    left_out = convert_cloth3d(settings(root)).left_out
    assert "Dress.pc16: found 1 frames; expected at least 7" in left_out["one"]


@pytest.mark.parametrize("frames", [3, 72])
def test_frames_are_never_taken_for_coordinates(tmp_path: Path, frames: int) -> None:
    info = write_sequence(tmp_path / "x", frames=frames)
    found = read_info(tmp_path / "x" / "info.mat")
    np.testing.assert_array_equal(found.poses, info["poses"].T)
    np.testing.assert_array_equal(found.trans, info["trans"].T)


def test_info_says_who_and_what(root: Path) -> None:
    found = read_info(root / "00034" / "info.mat")
    assert (found.gender, found.zrot, found.tightness) == ("male", 0.7, (0.5, -1.5))
    assert found.fabrics == {"Dress": "cotton", "Trousers": "denim"}
    write_sequence(root / "her", gender=0)
    assert read_info(root / "her" / "info.mat").gender == "female"


def test_a_shorter_sequence_ends_earlier(root: Path) -> None:
    write_sequence(root / "short", frames=8)
    convert_cloth3d(settings(root))
    assert GarmentFile(settings(root)["path"]).sequence("short").num_frames == 4


def test_a_body_may_be_a_mesh_sequence(root: Path) -> None:
    """Then SMPL is not needed; frame 0 of the mesh is frame 0 of the sequence."""
    bodies = root.parent / "bodies"
    bodies.mkdir()
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    moved = corners + np.arange(FRAMES)[:, None, None] * 0.1
    np.savez(bodies / "00034.npz", faces=faces, positions=moved, fps=30.0)
    conversion = convert_cloth3d(settings(root, bodies=str(bodies), smpl={}))
    assert "00010.npz: no such file; expected the body of the sequence" in conversion.left_out["00010"]
    row = GarmentFile(conversion.path).sequence("00034")
    np.testing.assert_allclose(row.body_positions, moved[4:10], atol=1e-6)
    np.testing.assert_array_equal(row.body_faces, faces)


def test_splits_are_lists_of_names(root: Path) -> None:
    """The official list has start and end behind the name."""
    listed = root.parent / "entry_test.txt"
    listed.write_text("00034\t10\t90\n\n")
    conversion = convert_cloth3d(settings(root, train="all", test=str(listed)))
    file = GarmentFile(conversion.path)
    assert (file.split("train"), file.split("test")) == (("00010",), ("00034",))
    other = {"path": str(root.parent / "other.h5")}
    assert GarmentFile(convert_cloth3d(settings(root, test=str(listed), **other)).path).names == ("00034",)
    with pytest.raises(DrapeError, match="found 00034 in both"):
        convert_cloth3d(settings(root, train=str(listed), test=str(listed)))
    with pytest.raises(DrapeError, match="found all and all"):
        convert_cloth3d(settings(root, train="all"))
    with pytest.raises(DrapeError, match=r"data.test: .*absent.txt: no such file; expected all, none, or a text file"):
        convert_cloth3d(settings(root, test=str(root / "absent.txt")))


def _without(field: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        found = loadmat(folder / "info.mat", simplify_cells=True)
        savemat(folder / "info.mat", {k: v for k, v in found.items() if k != field and not k.startswith("__")})

    return change


def _with(**fields: object) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        found = loadmat(folder / "info.mat", simplify_cells=True)
        savemat(folder / "info.mat", {k: v for k, v in (found | fields).items() if not k.startswith("__")})

    return change


def _cut(name: str, size: int) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:size])


def _gone(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def _cache(positions: np.ndarray, **changes: object) -> Callable[[Path], None]:
    return lambda folder: write_pc16(folder / "Dress.pc16", positions, **changes)


NAN = relative_frames()
NAN[6, 3] = np.nan
BAD = {
    "no info": (_gone("info.mat"), "info.mat: no such file; expected a sequence of CLOTH3D"),
    "info cut off": (_cut("info.mat", 300), r"info.mat: cannot be read as a MATLAB file"),
    "no poses": (_without("poses"), "info.mat: found the fields .*; expected gender, poses.*; missing poses"),
    "no zrot": (_without("zrot"), "missing zrot"),
    "poses of another body": (_with(poses=np.zeros((156, 12))), r"poses: found shape \(156, 12\); expected \(72"),
    "fewer trans": (_with(trans=np.zeros((3, 11))), "found 12 frames of poses and 11 of trans"),
    "gender": (_with(gender=2), r"gender: found 2; expected 0 \(female\) or 1 \(male\)"),
    "outfit": (_with(outfit=3), "outfit: found int; expected a struct of garments"),
    "no fabric": (_with(outfit={"Dress": {"texture": 1}}), "outfit.Dress: found no fabric"),
    "another fabric": (_with(outfit={"Dress": {"fabric": "rubber"}}), "Dress.fabric: found 'rubber'; expected one"),
    "trousers only": (_with(outfit={"Trousers": {"fabric": "silk"}}), "found Trousers; expected exactly one of Tsh"),
    "two garments": (
        _with(outfit={"Top": {"fabric": "silk"}, "Dress": {"fabric": "silk"}}), "found Top, Dress; expected exactly one"
    ),
    "no garment file": (_gone("Dress.pc16"), "Dress.pc16: no such file; expected the frames of the garment"),
    "no rest mesh": (_gone("Dress.obj"), "Dress.obj: no such file"),
    "magic bytes": (
        _cache(relative_frames(), tag=b"POINTCACHE3\0"), r"Dress.pc16: found 1184 bytes that begin with b'POINTCACHE3"
    ),
    "version": (_cache(relative_frames(), version=2), "Dress.pc16: found version 2, 16 points, 12 samples; expected"),
    "pc16 cut off": (_cut("Dress.pc16", 1000), "found 1000 bytes; expected 1184, for 12 samples of 16 points"),
    "pc16 shorter than its lead": (_cut("Dress.pc16", 20), "Dress.pc16: found 20 bytes that begin with b'POINTCACHE2"),
    "another mesh": (
        _cache(relative_frames()[:, :15]), "Dress.pc16: found 15 points a frame; expected 16, as Dress.obj has so many"
    ),
    "another length": (_cache(relative_frames(11)), "Dress.pc16: found 11 frames; expected 12, as info.mat"),
    "nan": (_cache(NAN), "Dress.pc16: sample 6: found a number that is not finite"),
    "a mesh that is no cloth": (
        lambda folder: write_obj(folder / "Dress.obj", SHEET, [QUADS[0][::-1], *QUADS[1:]]), "Dress.obj: .* opposite"
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def conversion_of_all(tmp_path_factory: pytest.TempPathFactory) -> Conversion:
    """Two good sequences among many bad ones, in one go."""
    root = tmp_path_factory.mktemp("all") / "cloth3d"
    for name in ("00010", "zz", *BAD):
        write_sequence(root / name.replace(" ", "-"))
    for name, (change, _) in BAD.items():
        change(root / name.replace(" ", "-"))
    save_model(root.parent / "male.npz", small_model())
    listed = root.parent / "names.txt"
    listed.write_text("\n".join(path.name for path in root.iterdir()))
    return convert_cloth3d(settings(root, test=str(listed)))


@pytest.mark.parametrize("case", BAD)
def test_a_bad_sequence_is_left_out_with_a_sentence(conversion_of_all: Conversion, case: str) -> None:
    name = case.replace(" ", "-")
    assert re.search(f"/{name}/.*{BAD[case][1]}", conversion_of_all.left_out[name])


def test_the_others_go_on_and_the_end_is_an_error(conversion_of_all: Conversion) -> None:
    assert GarmentFile(conversion_of_all.path).names == ("00010", "zz")
    assert len(conversion_of_all.left_out) == len(BAD)
    with pytest.raises(DrapeError, match=rf"holds 2 sequences; {len(BAD)} were left out(.|\n)*and {len(BAD) - 20} m"):
        conversion_of_all.refuse_left_out()
    assert [path.name for path in conversion_of_all.path.parent.iterdir()] == ["cloth3d.h5"]


def test_a_body_of_the_wrong_kind(root: Path) -> None:
    write_sequence(root / "her", gender=0)
    save_model(root.parent / "female.npz", small_model(), parents=np.arange(55) - 1)
    conversion = convert_cloth3d(settings(root))
    assert "female.npz: found a body of 55 joints; expected the 24 of SMPL" in conversion.left_out["her"]
    (root.parent / "female.npz").unlink()
    assert "make it from your own SMPL model with: python -m" in convert_cloth3d(settings(root)).left_out["her"]


def test_nothing_that_can_be_converted_is_an_error(root: Path, tmp_path: Path) -> None:
    with pytest.raises(DrapeError, match=r"none of 2 sequences can be converted:\n  00010: .*male.npz: no such file"):
        convert_cloth3d(settings(root, smpl={"female": "absent.npz", "male": str(tmp_path / "x" / "male.npz")}))
    assert not Path(settings(root)["path"]).exists()
    with pytest.raises(DrapeError, match="data.root: .*absent: no such folder; expected CLOTH3D"):
        convert_cloth3d(settings(tmp_path / "absent"))
    with pytest.raises(DrapeError, match="found no sequence to convert"):
        convert_cloth3d(settings(root, test="none"))
    with pytest.raises(DrapeError, match=r"data.frames: found \[90, 10\]; expected \[first, end\]"):
        convert_cloth3d(settings(root, frames=[90, 10]))


def test_what_was_left_out_is_tried_again(root: Path) -> None:
    """And what is there is not read again."""
    good = (root / "00034" / "Dress.pc16").read_bytes()
    (root / "00034" / "Dress.pc16").write_bytes(b"")
    first = convert_cloth3d(settings(root))
    assert (first.converted, set(first.left_out)) == (1, {"00034"})
    (root / "00010" / "Dress.pc16").write_bytes(b"")
    again = convert_cloth3d(settings(root))
    assert (again.converted, again.made, set(again.left_out)) == (1, False, {"00034"})
    (root / "00034" / "Dress.pc16").write_bytes(good)
    last = convert_cloth3d(settings(root))
    assert (last.converted, last.made, last.left_out) == (2, True, {})
    assert GarmentFile(last.path).names == ("00010", "00034")
    assert convert_cloth3d(settings(root)).made is False
    with pytest.raises(DrapeError, match=r"another configuration \(data.gravity: 9.81 there, 5.0 asked for\)"):
        convert_cloth3d(settings(root, gravity=5.0))


def test_an_interrupted_conversion_goes_on_and_gives_the_same_file(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = convert_cloth3d(settings(root))
    wanted, read = Path(whole.path).read_bytes(), []
    Path(whole.path).unlink()
    original = conversion.SequenceReader.read

    def stopped(self: object, name: str) -> object:
        read.append(name)
        if read == ["00010", "00034"]:
            raise KeyboardInterrupt
        return original(self, name)

    monkeypatch.setattr(conversion.SequenceReader, "read", stopped)
    with pytest.raises(KeyboardInterrupt):
        convert_cloth3d(settings(root))
    assert not Path(whole.path).exists()
    convert_cloth3d(settings(root))
    assert read == ["00010", "00034", "00034"]  # the first was done
    assert Path(whole.path).read_bytes() == wanted
