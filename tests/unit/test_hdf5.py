"""Data sets of trajectories: what is written comes back, and what is wrong is refused with a sentence."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from drape.data import schema
from drape.data.hdf5 import TrajectoryFile
from drape.data.hdf5_writer import write_trajectories
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from tests.trajectories import SETTINGS, header, sequences


@pytest.fixture
def path(tmp_path: Path) -> Path:
    target = tmp_path / "data" / "small.h5"
    write_trajectories(target, header(), sequences(), 4)
    return target


def test_everything_written_is_read_back(path: Path) -> None:
    file = TrajectoryFile(path)
    for index, sequence in enumerate(sequences()):
        np.testing.assert_array_equal(file.positions(index), sequence.positions)
        np.testing.assert_array_equal(file.positions(index, 1, 4), sequence.positions[1:4])
    np.testing.assert_array_equal(file.mesh.faces, square_grid(1.0, 4).faces)
    assert file.positions(0).dtype == np.float32
    assert (file.num_sequences, file.num_frames, file.pinned.tolist()) == (4, 5, [0, 3])
    assert file.fabrics == ("silk", "denim")
    assert file.fabric.tolist() == [0, 1, 0, 1]
    assert file.attempts.tolist() == [1, 2, 3, 4]
    assert file.split("train").tolist() == [0, 1, 2]
    assert file.split("test").tolist() == [3]
    assert file.materials["denim"]["mass_per_vertex"] == 1.0
    assert file.materials["silk"]["preset"] == "Silk"
    assert file.dt == pytest.approx(1 / 30)
    assert file.gravity.tolist() == [0.0, 0.0, -9.81]


def test_every_dataset_of_the_table_states_its_unit(path: Path) -> None:
    with h5py.File(path) as file:
        for field in schema.FIELDS:
            assert file[field.name].attrs["units"] == field.unit != ""
        assert file["positions"].chunks is None  # contiguous: windows are mapped


def test_windows_of_several_sequences_are_read_at_once(path: Path) -> None:
    """Frame by frame, window by window, what the sequences hold; the same after closing and in a copy."""
    file = TrajectoryFile(path)
    numbers, starts = np.array([0, 2, 2, 3]), np.array([1, 0, 2, 2])
    expected = np.concatenate([sequences()[n].positions[s : s + 3] for n, s in zip(numbers, starts, strict=True)], 1)
    np.testing.assert_array_equal(file.windows(numbers, starts + np.arange(3)[:, None]), expected)
    assert len(pickle.dumps(file)) < 10_000  # the map does not travel
    file.close()
    np.testing.assert_array_equal(file.windows(numbers, starts + np.arange(3)[:, None]), expected)


def test_a_copy_in_another_process_opens_the_file_itself(path: Path) -> None:
    file = TrajectoryFile(path)
    copy = pickle.loads(pickle.dumps(file))
    file.close()
    np.testing.assert_array_equal(copy.positions(2), sequences()[2].positions)
    np.testing.assert_array_equal(file.positions(2), sequences()[2].positions)


def test_a_refused_write_leaves_what_was_there(path: Path) -> None:
    before = path.read_bytes()
    bad = sequences()
    bad[1] = bad[1]._replace(positions=bad[1].positions[:3])
    with pytest.raises(DrapeError, match=r"sequence 1: positions: found shape \(3, 16, 3\); expected \(5, 16, 3\)"):
        write_trajectories(path, header(), bad, 4)
    with pytest.raises(DrapeError, match="found 4 sequences; expected 7"):
        write_trajectories(path, header(), sequences(), 7)
    with pytest.raises(DrapeError, match=r"fabric: entry 1: found 1; expected 0..0 \(silk\)"):
        write_trajectories(path, header(materials={"silk": SETTINGS}), sequences(), 4)
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
    "nan": (_set("positions", (2, 1, 5), np.nan), "positions: sequence 2, frame 1: .*not finite; expected positions"),
    "infinite": (_set("positions", (0, 0, 0), np.inf), "positions: sequence 0, frame 0: .*not finite"),
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
    "format": (lambda f: f.attrs.__setitem__("format", "else"), "attribute format: found 'else'; expected 'drape traj"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_file_with_a_fault_is_refused_with_a_sentence(path: Path, fault: str) -> None:
    change, sentence = FAULTS[fault]
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(DrapeError, match=sentence) as error:
        TrajectoryFile(path)
    assert str(error.value).startswith(str(path))


def test_files_that_are_no_data_set(path: Path, tmp_path: Path) -> None:
    with pytest.raises(DrapeError, match=r"no such file; make it with: python src/generate.py data.path="):
        TrajectoryFile(tmp_path / "absent.h5")
    cut = tmp_path / "cut.h5"
    cut.write_bytes(path.read_bytes()[:3000])
    foreign = tmp_path / "foreign.h5"
    foreign.write_text("not HDF5")
    for wrong in (cut, foreign):
        with pytest.raises(DrapeError, match="no whole HDF5 file"):
            TrajectoryFile(wrong)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = [1.0]
    with pytest.raises(DrapeError, match="attribute format: found 'nothing'"):
        TrajectoryFile(tmp_path / "other.h5")


@pytest.mark.parametrize("window", [(4, 0, 3), (-1, 0, 3), (0, 3, 3), (0, 2, 6), (0, -1, 2)])
def test_a_window_outside_the_file_is_refused(path: Path, window: tuple[int, int, int]) -> None:
    with pytest.raises(DrapeError, match=r"expected a sequence in 0..3 and frames in 0..5"):
        TrajectoryFile(path).positions(*window)


def test_an_unknown_split_is_refused(path: Path) -> None:
    with pytest.raises(DrapeError, match="split 'val'; expected one of train, test"):
        TrajectoryFile(path).split("val")
