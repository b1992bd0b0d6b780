"""Data sets of sheets: what is written comes back, and what is wrong is refused with a sentence."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from drape.data import schema
from drape.data.hdf5 import GarmentFile
from drape.data.hdf5_writer import data_writer, sheet_writer
from drape.data.stored_part import Part
from drape.data.trajectories import open_trajectories
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from tests import garments
from tests.trajectories import SETTINGS, header, sequences, write


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path / "data" / "small.h5", header(), sequences())


def test_everything_written_is_read_back(path: Path) -> None:
    file = open_trajectories(path)
    assert file.names == ("000000", "000001", "000002", "000003")
    for found, sequence in zip(file.sequences, sequences(), strict=True):
        np.testing.assert_array_equal(found.positions, sequence.positions)
        np.testing.assert_array_equal(found.window(1, 3).positions, sequence.positions[1:4])
        assert (found.num_frames, found.pinned.tolist(), found.body) == (5, [0, 3], "")
        assert found.window(1, 3).body_positions is None
        np.testing.assert_array_equal(found.mesh.faces, square_grid(1.0, 4).faces)
        assert found.mesh is file.sequences[0].mesh
    assert file.fabrics == ("silk", "denim")
    assert [each.fabric for each in file.sequences] == ["silk", "denim", "silk", "denim"]
    assert [each.attempts for each in file.sequences] == [1, 2, 3, 4]
    assert [each.mass.tolist() for each in file.sequences[:2]] == [[0.15] * 16, [1.0] * 16]
    assert file.split("train") == ("000000", "000001", "000002")
    assert file.split("test") == ("000003",)
    assert file.materials["denim"]["mass_per_vertex"] == 1.0
    assert file.materials["silk"]["preset"] == "Silk"
    assert file.dt == pytest.approx(1 / 30)
    assert file.gravity.tolist() == [0.0, 0.0, -9.81]


def test_every_dataset_of_the_table_states_its_unit(path: Path) -> None:
    with h5py.File(path) as file:
        for field in schema.SHEET_FIELDS:
            assert file[field.name].attrs["units"] == field.unit != ""
        assert file["positions"].chunks is None  # contiguous: windows are mapped


def test_windows_of_several_sequences_are_read_at_once(path: Path) -> None:
    """Frame by frame, window by window, what the sequences hold; the same after closing and in a copy."""
    file = open_trajectories(path)
    numbers, starts = np.array([0, 2, 2, 3]), np.array([1, 0, 2, 2])
    expected = np.concatenate([sequences()[n].positions[s : s + 3] for n, s in zip(numbers, starts, strict=True)], 1)
    np.testing.assert_array_equal(file.windows(numbers, starts + np.arange(3)[:, None]), expected)
    assert len(pickle.dumps(file)) < 10_000  # the map does not travel
    file.close()
    np.testing.assert_array_equal(file.windows(numbers, starts + np.arange(3)[:, None]), expected)


def test_a_copy_in_another_process_opens_the_file_itself(path: Path) -> None:
    file = open_trajectories(path)
    copy = pickle.loads(pickle.dumps(file))
    file.close()
    np.testing.assert_array_equal(copy.sequence("000002").positions, sequences()[2].positions)
    np.testing.assert_array_equal(file.sequence("000002").positions, sequences()[2].positions)


def test_a_refused_write_leaves_what_was_there(path: Path) -> None:
    before = path.read_bytes()
    bad = sequences()
    bad[1] = replace(bad[1], positions=bad[1].positions[:3])
    with pytest.raises(DrapeError, match=r"sequence 1: positions: found shape \(3, 16, 3\); expected \(5, 16, 3\)"):
        write(path, header(), bad)
    with pytest.raises(DrapeError, match="found 4 sequences; expected 7"):
        write(path, header(), sequences(), count=7)
    with pytest.raises(DrapeError, match=r"found 4 sequences; expected 3"):
        write(path, header(), sequences(), count=3)
    with pytest.raises(DrapeError, match=r"sequence 1: fabric: found 'denim'; expected one of silk"):
        write(path, header(materials={"silk": SETTINGS}), sequences())
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["small.h5"]


def _set(name: str, index: object, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file[name][index] = value

    return change


def _chunked(file: h5py.File) -> None:
    values, attributes = file["positions"][:], dict(file["positions"].attrs)
    del file["positions"]
    file.create_dataset("positions", data=values, chunks=True, compression="gzip").attrs.update(attributes)


def _replace(name: str, array: np.ndarray) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        attributes = dict(file[name].attrs)
        del file[name]
        file[name] = array
        file[name].attrs.update(attributes)

    return change


FAULTS = {
    "nan": (_set("positions", (2, 1, 5), np.nan), "000002/positions: frame 1: .*not finite"),
    "infinite": (_set("positions", (0, 0, 0), np.inf), "sequences/000000/positions: frame 0: .*not finite"),
    "chunks": (_chunked, "positions: found chunks or compression; expected numbers that lie in the file as they are"),
    "fabric": (_set("fabric", 1, 7), r"fabric: entry 1: found 7; expected 0..1 \(silk, denim\)"),
    "split": (_set("split", 0, 2), r"split: entry 0: found 2; expected 0..1 \(train, test\)"),
    "pin": (_set("mesh/pinned", 1, 16), "mesh/pinned: entry 1: found 16; expected 0..15"),
    "face": (_set("mesh/faces", (0, 2), -1), "mesh/faces: entry 0: found -1; expected 0..15"),
    "vertices": (
        _replace("positions", np.zeros((4, 5, 15, 3), np.float32)),
        r"positions: found float32 of shape \(4, 5, 15, 3\); expected float32 of shape \(sequences, frames, 16, 3\)",
    ),
    "dtype": (_replace("positions", np.zeros((4, 5, 16, 3))), "positions: found float64 of shape"),
    "rank": (_replace("fabric", np.zeros((4, 1), np.int64)), r"fabric: found int64 of shape \(4, 1\)"),
    "sequences": (_replace("split", np.zeros(3, np.int8)), r"split: found int8 of shape \(3,\); .* shape \(4\)"),
    "missing dataset": (lambda f: f.__delitem__("attempts"), "attempts: missing; expected int64"),
    "missing attribute": (lambda f: f.attrs.__delitem__("dt"), "attribute dt: missing; expected time step"),
    "unit": (lambda f: f["positions"].attrs.__setitem__("units", "mm"), "attribute units: found 'mm'; expected 'm'"),
    "time step": (lambda f: f.attrs.__setitem__("dt", 0.1), r"dt and fps: found 0.1 s and 30.0 1/s; expected dt"),
    "gravity": (lambda f: f.attrs.__setitem__("gravity", 9.81), "attribute gravity: found .*; expected three numbers"),
    "material": (lambda f: f["materials"].__delitem__("denim"), "materials/denim: missing preset, mass_per_vertex"),
    "version": (lambda f: f.attrs.__setitem__("schema_version", 99), "schema_version: found 99; expected 1"),
    "format": (lambda f: f.attrs.__setitem__("format", "else"), "format: found 'else'; expected .*or 'drape traj"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_file_with_a_fault_is_refused_with_a_sentence(path: Path, fault: str) -> None:
    change, sentence = FAULTS[fault]
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(DrapeError, match=sentence) as error:
        open_trajectories(path)
    assert str(error.value).startswith(str(path))


def test_files_that_are_no_data_set(path: Path, tmp_path: Path) -> None:
    with pytest.raises(DrapeError, match=r"no such file; make it with: python src/generate.py data.path="):
        open_trajectories(tmp_path / "absent.h5")
    cut = tmp_path / "cut.h5"
    cut.write_bytes(path.read_bytes()[:3000])
    foreign = tmp_path / "foreign.h5"
    foreign.write_text("not HDF5")
    for wrong in (cut, foreign):
        with pytest.raises(DrapeError, match="no whole HDF5 file"):
            open_trajectories(wrong)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = [1.0]
    with pytest.raises(DrapeError, match="attribute format: found 'nothing'"):
        open_trajectories(tmp_path / "other.h5")


@pytest.mark.parametrize("window", [(0, 6), (-1, 2), (5, 1), (2, 0)])
def test_frames_that_are_not_there_are_refused(path: Path, window: tuple[int, int]) -> None:
    with pytest.raises(DrapeError, match=r"sequences/000003: asked for frames .*; expected frames in 0..5"):
        GarmentFile(path).sequence("000003").window(*window)


def test_unknown_names_are_refused(path: Path) -> None:
    with pytest.raises(DrapeError, match="split 'val'; expected one of train, test"):
        GarmentFile(path).split("val")
    with pytest.raises(DrapeError, match="found no sequence '000004'; expected one of 4, from 000000 to 000003"):
        GarmentFile(path).sequence("000004")


def test_a_sheet_has_no_body_and_a_garment_is_no_sheet(path: Path, tmp_path: Path) -> None:
    sheet = GarmentFile(path).sequences[0]
    for name in ("body_positions", "body_faces", "body_rest_positions"):
        with pytest.raises(DrapeError, match=r"small.h5: sequences/000000: is a sheet without a body; expected"):
            getattr(sheet, name)
    with pytest.raises(DrapeError, match=r"sequences/00000: found the body ball; expected cloth without bodies"):
        open_trajectories(garments.write(tmp_path / "garments.h5"))


def test_sheets_may_lie_as_groups(path: Path, tmp_path: Path) -> None:
    """What is copied out of a file of sheets into one of groups is the same, windows too."""
    file = open_trajectories(path)
    with data_writer(tmp_path / "groups.h5", header(format=schema.GARMENTS)) as writer:
        for name in file.names:
            writer.add(file.part(name))
    copy = open_trajectories(tmp_path / "groups.h5")
    numbers, frames = np.array([3, 0]), np.array([[1, 0], [2, 1], [3, 2]])
    np.testing.assert_array_equal(copy.windows(numbers, frames), file.windows(numbers, frames))
    for one, other in zip(file.sequences, copy.sequences, strict=True):
        assert (one.fabric, one.split, one.attempts) == (other.fabric, other.split, other.attempts)
        np.testing.assert_array_equal(one.mass, other.mass)
        np.testing.assert_array_equal(one.mesh.rest_positions, other.mesh.rest_positions)


def test_other_cloth_is_not_taken_for_a_sheet(path: Path, tmp_path: Path) -> None:
    part = GarmentFile(path).part("000000")

    def add(wrong: Part) -> None:
        with sheet_writer(tmp_path / "x.h5", header(), 2) as writer:
            writer.add(part)
            writer.add(wrong)

    for wrong, words in (
        (part._replace(garment=replace(part.garment, mass=np.ones(16))), "found a body, no cloth, or masses"),
        (part._replace(garment=replace(part.garment, pinned=np.array([1]))), "sequence 1: found another mesh"),
    ):
        with pytest.raises(DrapeError, match=words):
            add(wrong)
    assert not (tmp_path / "x.h5").exists()
