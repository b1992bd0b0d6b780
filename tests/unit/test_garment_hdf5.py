"""Data sets of garments on moving bodies: what is written comes back, and what is wrong is refused with a sentence."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from drape.data.hdf5 import GarmentFile
from drape.data.hdf5_writer import data_writer
from drape.data.schema import FIELDS, MATERIAL_ATTRIBUTES
from drape.data.stored_part import Header, Part, StoredBody, StoredGarment, StoredSequence
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from tests.garments import write_groups

SETTINGS = dict.fromkeys(MATERIAL_ATTRIBUTES, 1.0) | {"preset": "Silk", "mass_per_vertex": 0.15}
FRAMES, JOINTS = 6, 3
SHEET = square_grid(1.0, 4)


def header(**changes: object) -> Header:
    values = {
        "source": "blender 5.0.1",
        "fps": 30.0,
        "gravity": (0.0, 0.0, -9.81),
        "materials": {"silk": SETTINGS, "denim": SETTINGS | {"preset": "Denim"}},
        "config": "data: {}",
        "seed": 3,
    }
    return Header(**(values | changes))


def body(seed: int = 0) -> StoredBody:
    """A tetrahedron that hangs on two of three joints."""
    rng = np.random.default_rng(seed)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    shares = rng.random(4)
    weights = np.stack([shares, 1 - shares, 0 * shares, 0 * shares], axis=1)
    return StoredBody(rng.normal(size=(4, 3)), faces, np.tile([0, 1, 0, 0], (4, 1)), weights, {"height": 1.7})


def garment(**changes: object) -> StoredGarment:
    bones = np.tile([2, 0, 0, 0], (16, 1))
    weights = np.tile([1.0, 0.0, 0.0, 0.0], (16, 1))
    values = {"kind": "dress", "body": "b", "rest_positions": SHEET.rest_positions.astype(np.float64),
              "faces": SHEET.faces, "bones": bones, "weights": weights, "style": {"ease": 0.01}}  # fmt: skip
    return StoredGarment(**(values | changes))


def transforms(seed: int) -> np.ndarray:
    """Translations, of every joint its own."""
    result = np.tile(np.eye(4, dtype=np.float32), (FRAMES, JOINTS, 1, 1))
    result[..., :3, 3] = np.random.default_rng(seed).normal(size=(FRAMES, JOINTS, 3))
    return result


def sequence(name: str = "00000", **changes: object) -> StoredSequence:
    number = int(name)
    x = np.random.default_rng(number).normal(size=(FRAMES, 16, 3)).astype(np.float32)
    values = {"body": "b", "motion": "walk", "split": "train", "garment": "g", "fabric": "silk",
              "mass_per_vertex": 0.15, "friction": 0.5, "attempts": 1 + number, "quality": {"inside": 0.001},
              "positions": x, "twin": x + np.float32(1e-6), "transforms": transforms(number)}  # fmt: skip
    return StoredSequence(name, **(values | changes))


def plain_body() -> StoredBody:
    return replace(body(), bones=None, weights=None)


def stored_frames() -> np.ndarray:
    return np.random.default_rng(9).normal(size=(FRAMES, 4, 3)).astype(np.float32)


def three_sequences() -> list[StoredSequence]:
    """A recorded one, one whose body is stored frame by frame, the motion of a body alone."""
    frames = {"transforms": None, "twin": None, "body": "p", "body_positions": stored_frames()}
    alone = {"garment": "", "fabric": "", "positions": None, "mass_per_vertex": 0.0}
    return [sequence(), sequence("00001", **frames, split="test"), sequence("00002", **frames, **alone)]


def write(path: Path, sequences: list[StoredSequence], **changes: object) -> None:
    parts = {"bodies": {"b": body(), "p": plain_body()}, "garments": {"g": garment()}} | changes
    write_groups(path, header(), sequences=iter(sequences), **parts)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    target = tmp_path / "data" / "garments.h5"
    write(target, three_sequences())
    return target


def test_everything_written_is_read_back(path: Path) -> None:
    with GarmentFile(path) as file:
        assert (file.source, file.fps, file.fabrics) == ("blender 5.0.1", 30.0, ("silk", "denim"))
        assert file.dt == pytest.approx(1 / 30)
        assert file.gravity.tolist() == [0.0, 0.0, -9.81]
        assert file.materials["denim"]["preset"] == "Denim"
        assert (file.attribute("seed"), file.attribute("up_axis")) == (3, "z")
        assert file.names == ("00000", "00001", "00002")
        assert (file.split("train"), file.split("test")) == (("00000", "00002"), ("00001",))
        first = file.sequence("00000")
        assert (first.kind, first.garment, first.body) == ("dress", "g", "b")
        assert (first.fabric, first.motion, first.split) == ("silk", "walk", "train")
        assert (first.attempts, first.mass_per_vertex, first.friction) == (1, 0.15, 0.5)
        assert first.quality == {"inside": 0.001}
        assert first.num_frames == FRAMES
        np.testing.assert_array_equal(first.positions, sequence().positions)
        np.testing.assert_array_equal(first.twin, sequence().twin)
        np.testing.assert_array_equal(first.transforms, transforms(0))
        np.testing.assert_array_equal(first.mesh.faces, SHEET.faces)
        np.testing.assert_array_equal(first.mesh.rest_positions, garment().rest_positions)
        np.testing.assert_array_equal(first.body_faces, body().faces)
        np.testing.assert_allclose(first.body_rest_positions, body().rest_positions, rtol=1e-6)
        assert first.pinned.tolist() == []
        assert first.positions.dtype == first.body_positions.dtype == np.float64


def test_body_and_garment_follow_their_joints(path: Path) -> None:
    """With translations alone: x' = x + Σ w_k t_k."""
    first = GarmentFile(path).sequence("00000")
    shifts = transforms(0)[..., :3, 3].astype(np.float64)
    weights = body().weights[:, :2]
    expected = body().rest_positions + np.einsum("vk,fkc->fvc", weights, shifts[:, :2])
    np.testing.assert_allclose(first.body_positions, expected, atol=1e-6)
    np.testing.assert_allclose(first.skinned, SHEET.rest_positions + shifts[:, 2, None], atol=1e-6)


def test_bodies_may_be_stored_frame_by_frame(path: Path) -> None:
    second = GarmentFile(path).sequence("00001")
    np.testing.assert_array_equal(second.body_positions, stored_frames())
    assert second.skinned is None
    assert second.transforms is None
    assert second.twin is None
    assert second.is_recorded


def test_the_motion_of_a_body_alone_has_no_garment(path: Path) -> None:
    third = GarmentFile(path).sequence("00002")
    assert (third.kind, third.garment, third.is_recorded, third.num_frames) == ("", "", False, FRAMES)
    assert third.window(1, 2).positions is None
    np.testing.assert_array_equal(third.window(1, 2).body_positions, stored_frames()[1:3])
    for ask in (lambda: third.mesh, lambda: third.pinned):
        with pytest.raises(DrapeError, match=r"garments.h5: sequences/00002: is the motion of a body alone"):
            ask()
    with pytest.raises(DrapeError, match=r"sequences/00002: has no recorded positions of the garment"):
        _ = third.positions


@pytest.mark.parametrize("name", ["00000", "00001"])
def test_a_window_is_a_cut_of_the_whole(path: Path, name: str) -> None:
    row = GarmentFile(path).sequence(name)
    window = row.window(2, 3)
    np.testing.assert_array_equal(window.positions, row.positions[2:5])
    np.testing.assert_allclose(window.body_positions, row.body_positions[2:5], rtol=1e-12)
    for start, length in ((-1, 3), (4, 3), (0, 0)):
        with pytest.raises(DrapeError, match=rf"sequences/{name}: asked for frames .*; expected frames in 0..6"):
            row.window(start, length)


def test_a_window_reads_nothing_but_its_frames(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, read = GarmentFile(path), []
    array = GarmentFile.array

    def counted(self: GarmentFile, name: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        rows = array(self, name, start, stop)
        read.append(len(rows) if name.startswith("sequences/") else 0)
        return rows

    monkeypatch.setattr(GarmentFile, "array", counted)
    file.sequence("00000").window(1, 3)
    assert sum(read) == 2 * 3  # of the garment and of the transforms


def test_every_dataset_states_its_unit_and_lies_as_it_is(path: Path) -> None:
    with h5py.File(path) as file:
        for kind, name in (("bodies", "b"), ("garments", "g"), ("sequences", "00000"), ("sequences", "00001")):
            for field in FIELDS[kind]:
                if field.name in file[kind][name]:
                    dataset = file[kind][name][field.name]
                    assert dataset.attrs["units"] == field.unit
                    assert dataset.attrs["meaning"] == field.meaning
                    assert dataset.chunks is None


def test_the_same_data_gives_the_same_bytes(path: Path, tmp_path: Path) -> None:
    write(tmp_path / "again.h5", three_sequences())
    assert (tmp_path / "again.h5").read_bytes() == path.read_bytes()


def test_a_copy_in_another_process_opens_the_file_itself(path: Path) -> None:
    file = GarmentFile(path)
    before = file.sequence("00000").positions
    copy = pickle.loads(pickle.dumps(file))
    file.close()
    np.testing.assert_array_equal(copy.sequence("00000").positions, before)
    np.testing.assert_array_equal(file.sequence("00000").positions, before)
    assert len(pickle.dumps(file)) < 20_000  # no frames


def test_a_file_that_was_replaced_is_noticed(path: Path) -> None:
    file = GarmentFile(path)
    write(path, [sequence()])
    with pytest.raises(DrapeError, match="was replaced or changed since it was opened; open it again"):
        _ = file.sequence("00000").positions


REFUSED = {
    "frames of another mesh": (
        lambda: [sequence(positions=np.zeros((FRAMES, 15, 3), np.float32), twin=None)],
        {},
        r"sequences/00000/positions: found float32 of shape \(6, 15, 3\); expected float32 of shape \(frames, 16, 3\)",
    ),
    "neither": (lambda: [sequence(transforms=None)], {}, "found neither of transforms and body_positions"),
    "both": (lambda: [sequence(body_positions=stored_frames())], {}, "found both of transforms and body_positions"),
    "frames of nobody": (
        lambda: [sequence(body="")],
        {"garments": {"g": garment(body="")}},
        "found one of transforms and body_positions; expected neither without a body",
    ),
    "nothing": (lambda: [sequence(body="", garment="")], {}, "found neither a body nor a garment; expected one at"),
    "no frames": (
        lambda: [sequence(body="", transforms=None, positions=None, twin=None)],
        {"garments": {"g": garment(body="")}},
        "found no positions of a sheet; expected its frames",
    ),
    "no weight": (
        lambda: [sequence()],
        {"garments": {"g": garment(mass=np.zeros(16))}},
        "garments/g/mass: found 0.0; expected positive numbers",
    ),
    "nan": (
        lambda: [sequence(positions=np.full((FRAMES, 16, 3), np.nan, np.float32))],
        {},
        "sequences/00000/positions: found a number that is not finite",
    ),
    "no fabric": (lambda: [sequence(fabric="wool")], {}, "attribute fabric: found 'wool'; expected one of silk, denim"),
    "no body": (lambda: [sequence(), sequence("00001", body="x")], {}, "body: found 'x'; expected one of b;"),
    "no garment": (lambda: [sequence(garment="x")], {}, "attribute garment: found 'x'; expected one of none"),
    "positions without a garment": (lambda: [sequence(garment="")], {}, "found positions of no garment"),
    "no split": (lambda: [sequence(split="val")], {}, "attribute split: found 'val'; expected one of train, test"),
    "no mass": (lambda: [sequence(mass_per_vertex=0.0)], {}, "mass_per_vertex: found 0.0; expected kilograms above 0"),
    "twice": (lambda: [sequence(), sequence()], {}, "sequences: found the name '00000'; expected a new one"),
    "none": (lambda: [], {}, "sequences: found none; expected at least one"),
    "bare body": (
        lambda: [sequence(), sequence("00001", body="p")],
        {},
        "transforms need bodies/p/bones and weights; found none",
    ),
    "garment of no body": (
        lambda: [sequence()],
        {"garments": {"g": garment(body="x")}},
        "garments/g: attribute body: found 'x'",
    ),
    "too few joints": (
        lambda: [sequence(transforms=transforms(0)[:, :2])],
        {},
        "sequences/00000/transforms: found 2 joints; expected at least 3, for garments/g/bones",
    ),
    "weights": (
        lambda: [sequence()],
        {"garments": {"g": garment(weights=np.full((16, 4), 0.3))}},
        "garments/g/weights: vertex 0: found a sum of 1.2 .*; expected shares of 1",
    ),
    "bones alone": (
        lambda: [sequence()],
        {"bodies": {"b": replace(body(), weights=None)}},
        "bodies/b: found bones alone",
    ),
    "pin": (
        lambda: [sequence()],
        {"garments": {"g": garment(pinned=np.array([16]))}},
        "pinned: found vertex 16; expected 0..15",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_is_refused_and_nothing_is_left(path: Path, case: str) -> None:
    sequences, changes, sentence = REFUSED[case]
    before = path.read_bytes()
    with pytest.raises(DrapeError, match=sentence) as error:
        write(path, sequences(), **changes)
    assert "garments" in str(error.value)
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == ["garments.h5"]


def test_an_interrupted_writer_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with data_writer(tmp_path / "new.h5", header()) as writer:
            writer.add(Part(body(), garment(), sequence()))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def _set(name: str, index: object, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file[name][index] = value

    return change


def _label(name: str, key: str, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        (file if name == "" else file[name]).attrs[key] = value

    return change


def _shorter(name: str) -> Callable[[h5py.File], None]:
    """A frame is missing."""

    def change(file: h5py.File) -> None:
        values, attributes = file[name][:-1], dict(file[name].attrs)
        del file[name]
        file.create_dataset(name, data=values).attrs.update(attributes)

    return change


def _chunked(file: h5py.File) -> None:
    name = "sequences/00000/positions"
    values, attributes = file[name][:], dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, data=values, chunks=True, compression="gzip").attrs.update(attributes)


FAULTS = {
    "format": (_label("", "format", "else"), "attribute format: found 'else'; expected 'drape garments'"),
    "version": (_label("", "schema_version", 9), "schema_version: found 9; expected 1 or 2; .*generate.py data="),
    "time step": (_label("", "dt", 0.1), r"dt and fps: found 0.1 s and 30.0 1/s; expected dt"),
    "gravity": (_label("", "gravity", 9.81), "attribute gravity: found 9.81; expected three numbers"),
    "attribute": (lambda f: f.attrs.__delitem__("source"), "attribute source: missing; expected what made the frames"),
    "material": (lambda f: f["materials"].__delitem__("denim"), "materials/denim: missing preset, mass_per_vertex"),
    "label": (lambda f: f["garments/g"].attrs.__delitem__("kind"), "garments/g: attribute kind: missing; expected"),
    "json": (_label("sequences/00000", "quality", "{"), "sequences/00000: attribute quality: found '{'; expected JSON"),
    "unit": (_label("sequences/00000/twin", "units", "mm"), "00000/twin: attribute units: found 'mm'; expected 'm'"),
    "dataset": (lambda f: f["bodies/b"].__delitem__("faces"), "bodies/b/faces: missing; expected int64 of shape"),
    "body": (lambda f: f["bodies"].__delitem__("p"), "sequences/00001: attribute body: found 'p'; expected one of b;"),
    "face": (_set("garments/g/faces", (0, 2), -1), "garments/g/faces: found vertex -1; expected 0..15"),
    "rest": (_set("garments/g/rest_positions", (3, 0), np.nan), "g/rest_positions: vertex 3: found .*nan"),
    "body frames": (
        _shorter("sequences/00000/transforms"),
        r"00000/transforms: found float32 of shape \(5, 3, 4, 4\); expected float32 of shape \(6, joints, 4, 4\)",
    ),
    "twin": (_shorter("sequences/00000/twin"), r"twin: found float32 of shape \(5, 16, 3\); .* shape \(6, 16, 3\)"),
    "chunks": (_chunked, "sequences/00000/positions: found chunks or compression; .*repack them"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_file_with_a_fault_is_refused_with_a_sentence(path: Path, fault: str) -> None:
    change, sentence = FAULTS[fault]
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(DrapeError, match=sentence) as error:
        GarmentFile(path)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize("name", ["positions", "twin", "transforms"])
def test_a_frame_that_is_not_finite_is_found_when_it_is_read(path: Path, name: str) -> None:
    with h5py.File(path, "r+") as file:
        file[f"sequences/00000/{name}"][4, 1] = np.nan
    first = GarmentFile(path).sequence("00000")
    first.window(1, 3)  # other frames can be used
    with pytest.raises(DrapeError, match=rf"garments.h5: sequences/00000/{name}: frame 4: found .* not finite"):
        getattr(first, "body_positions" if name == "transforms" else name)
    with pytest.raises(DrapeError, match=rf"sequences/00000/{name}: frame 4"):
        GarmentFile(path).check_frames()
    if name != "twin":
        with pytest.raises(DrapeError, match=rf"sequences/00000/{name}: frame 4"):
            first.window(3, 2)


def test_files_that_are_no_data_set(path: Path, tmp_path: Path) -> None:
    with pytest.raises(DrapeError, match=r"no such file; make it with: python src/generate.py data=garments"):
        GarmentFile(tmp_path / "absent.h5")
    cut = tmp_path / "cut.h5"
    foreign = tmp_path / "foreign.h5"
    foreign.write_text("not HDF5")
    for size in (3000, path.stat().st_size - 100):
        cut.write_bytes(path.read_bytes()[:size])
        for wrong in (cut, foreign):
            with pytest.raises(DrapeError, match="no whole HDF5 file"):
                GarmentFile(wrong)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = [1.0]
    with pytest.raises(DrapeError, match="attribute format: found 'nothing'"):
        GarmentFile(tmp_path / "other.h5")


def test_unknown_names_are_refused(path: Path) -> None:
    file = GarmentFile(path)
    with pytest.raises(DrapeError, match="split 'val'; expected one of train, test"):
        file.split("val")
    with pytest.raises(DrapeError, match="found no sequence '7'; expected one of 3, from 00000 to 00002"):
        file.sequence("7")
