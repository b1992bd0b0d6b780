"""Animated scenes in HDF5: no frame that is done is lost, and nothing of another scene is mixed in."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from drape.data import animation_writer
from drape.data.animation_hdf5 import FIELDS, AnimationFile
from drape.data.animation_writer import AnimationWriter
from drape.data.look import Look
from drape.errors import DrapeError
from drape.scene.state import State
from tests.animations import COLUMNS, MESH, REST, header, numbers, state, write

ROOT = Path(__file__).parents[2]
FRAMES = 5


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path / "runs" / "animation.h5", header(FRAMES))


def parts_of(path: Path) -> list[Path]:
    return sorted(Path(f"{path}.parts").glob("[0-9][0-9][0-9][0-9][0-9][0-9].npz"))


def check_frames(path: Path, count: int) -> None:
    with AnimationFile(path) as file:
        assert file.num_frames == count
        for frame in range(count):
            np.testing.assert_array_equal(file.state(frame).x, state(frame).x)
            np.testing.assert_array_equal(file.state(frame).v, state(frame).v)
        expected = [np.nan, *(numbers(frame)["residual"] for frame in range(1, count))]
        np.testing.assert_array_equal(file.numbers()["residual"], expected)


def test_everything_written_is_read_back(path: Path) -> None:
    check_frames(path, FRAMES)
    made = header(FRAMES)
    with AnimationFile(path) as file:
        found = file.header
        assert file.is_complete
        for name, array in made.arrays().items():
            np.testing.assert_array_equal(found.arrays()[name], array)
        assert found.pinned.tolist() == [0, 6]
        assert (found.dt, found.frames, found.fabric, found.config) == (1 / 30, FRAMES, "denim", made.config)
        assert found.gravity.tolist() == [0.0, 0.0, -9.81]
        assert found.columns == COLUMNS
        motion = file.trajectory()
        assert (motion.num_frames, motion.dt) == (FRAMES, 1 / 30)
        assert motion.x.dtype == np.float64
        with pytest.raises(DrapeError, match=r"x: asked for frame 5; expected 0..4"):
            file.x(FRAMES)
    assert [p.name for p in path.parent.iterdir()] == ["animation.h5"]


def test_every_dataset_states_its_unit(path: Path) -> None:
    with h5py.File(path) as file:
        assert {field.name: file[field.name].attrs["units"] for field in FIELDS} == {f.name: f.unit for f in FIELDS}
        assert file["numbers/residual"].attrs["units"] == "N"


def test_without_body_pins_and_numbers(tmp_path: Path) -> None:
    made = header(2, body=False, pinned=np.zeros(0, np.int64), columns={})
    with AnimationWriter(tmp_path / "a.h5", made) as writer:
        for frame in range(2):
            writer.append(state(frame))
    with AnimationFile(tmp_path / "a.h5") as file:
        assert file.header.obstacle is None
        with pytest.raises(DrapeError, match="body: found none"):
            Look(file).body(0)
        assert file.header.pinned.shape == (0,)
        assert file.numbers() == {}


def test_interrupted_it_holds_what_is_done_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "animation.h5"
    with contextlib.suppress(KeyboardInterrupt), AnimationWriter(path, header(FRAMES)) as writer:
        writer.append(state(0))
        writer.append(state(1), numbers(1))
        raise KeyboardInterrupt
    check_frames(path, 2)
    with AnimationFile(path) as file:
        assert not file.is_complete
    times = {part: part.stat().st_mtime_ns for part in parts_of(path)}
    with AnimationWriter(path, header(FRAMES)) as writer:
        assert writer.num_frames == 2
        np.testing.assert_array_equal(writer.state(1).v, state(1).v)
        writer.append(state(2), numbers(2))
        assert {part: part.stat().st_mtime_ns for part in parts_of(path)[:2]} == times
    write(path, header(FRAMES))
    check_frames(path, FRAMES)
    assert not Path(f"{path}.parts").exists()


def test_a_finished_animation_is_left_alone(path: Path) -> None:
    before = path.stat().st_mtime_ns
    with AnimationWriter(path, header(FRAMES)) as writer:
        assert writer.num_frames == FRAMES
        np.testing.assert_array_equal(writer.state(3).x, state(3).x)
        with pytest.raises(DrapeError, match="all 5 frames are there"):
            writer.append(state(0))
    assert path.stat().st_mtime_ns == before


def process(path: Path, frames: int) -> subprocess.Popen:
    """A process that writes frames as fast as it can."""
    code = f"from pathlib import Path; from tests.animations import *; write(Path({str(path)!r}), header({frames}))"
    env = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"}
    return subprocess.Popen([sys.executable, "-c", code], env=env, stderr=subprocess.PIPE, text=True)


def test_killed_again_and_again_no_frame_is_lost(tmp_path: Path) -> None:
    """SIGKILL while frames are stored, and while HDF5 is written."""
    path, frames, rng = tmp_path / "animation.h5", 600, np.random.default_rng(0)
    kept, kills = 0, 0
    for goal in (1, 120, 300, frames, frames):
        writer = process(path, frames)
        deadline = time.monotonic() + 800
        while len(parts_of(path)) < goal and writer.poll() is None and time.monotonic() < deadline:
            time.sleep(0.0005)
        time.sleep(rng.uniform(0, 0.01))
        writer.send_signal(signal.SIGKILL)
        kills += writer.wait() == -signal.SIGKILL
        done = len(parts_of(path)) or frames
        assert done >= max(kept, goal), writer.stderr.read()
        kept = done
        if path.exists():
            AnimationFile(path).close()  # never half-written
    assert kills >= 3
    with AnimationWriter(path, header(frames)) as writer:
        assert writer.num_frames == kept
    write(path, header(frames))
    check_frames(path, frames)
    assert [p.name for p in tmp_path.iterdir()] == ["animation.h5"]


def test_a_torn_part_counts_as_not_there(tmp_path: Path) -> None:
    path = write(tmp_path / "animation.h5", header(FRAMES), stop=4)
    torn = parts_of(path)[2]
    whole = torn.read_bytes()
    for content in (whole[: len(whole) // 2], whole[:300] + b"\xff" * 8 + whole[308:], b""):
        torn.write_bytes(content)
        with AnimationWriter(path, header(FRAMES)) as writer:
            assert writer.num_frames == 2
    write(path, header(FRAMES))
    check_frames(path, FRAMES)


OTHERS = {
    "config": ({"config": "scene: {name: waving}\nsolver: {tolerance: 0.1}"},
               r"config.solver.tolerance: 0.001 there, 0.1 asked for"),
    "frames": ({"frames": 9}, "frames: 5 there, 9 asked for"),
    "time step": ({"dt": 1 / 60}, "dt: 0.0333"),
    "mass": ({"mass": np.full(len(REST), 0.004)}, r"arrays.mesh.mass: \(49,\) .* there, \(49,\) .* asked for"),
    "body": ({"obstacle": None}, "arrays.body.faces: .* there, nothing asked for"),
    "columns": ({"columns": {"ms": "ms"}}, "columns.iterations: 1 there, nothing asked for"),
}  # fmt: skip


@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("stop", [2, None])
def test_another_scene_is_refused_and_nothing_changes(tmp_path: Path, other: str, stop: int | None) -> None:
    path = write(tmp_path / "animation.h5", header(FRAMES), stop=stop)
    before, parts = path.read_bytes(), parts_of(path)
    changes, sentence = OTHERS[other]
    for where in ("with its HDF5 file", "with parts only"):
        made = header(9) if other == "frames" else header(FRAMES, **changes)
        with pytest.raises(DrapeError, match=f"{sentence}.*; delete animation.h5 and .*, or choose another folder"):
            AnimationWriter(path, made)
        if stop is None or where == "with parts only":
            break
        path.unlink()
    assert (parts_of(path), stop or path.read_bytes()) == (parts, stop or before)


def test_what_cannot_be_appended(tmp_path: Path) -> None:
    with AnimationWriter(tmp_path / "a.h5", header(FRAMES)) as writer:
        with pytest.raises(DrapeError, match="frame 0: found 48 vertices; expected 49, as at rest"):
            writer.append(State.at_rest(REST[1:]))
        with pytest.raises(DrapeError, match=r"found numbers \['residue'\]; expected some of residual, iterations"):
            writer.append(state(0), {"residue": 1.0})
        with pytest.raises(DrapeError, match="another process is writing here"):
            AnimationWriter(tmp_path / "a.h5", header(FRAMES))
    assert not (tmp_path / "a.h5").exists()  # no frame, no file


def test_a_full_disk_is_a_sentence_and_frames_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "a.h5"
    with AnimationWriter(path, header(FRAMES)) as writer:
        writer.append(state(0))
        with monkeypatch.context() as patch:
            patch.setattr(animation_writer.np, "savez", full)
            with pytest.raises(DrapeError, match=r"No space left .* are kept in .*a.h5.parts"):
                writer.append(state(1))
        assert writer.num_frames == 1
    write(path, header(FRAMES))
    check_frames(path, FRAMES)
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def _replace(name: str, array: np.ndarray) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        attributes = dict(file[name].attrs)
        del file[name]
        file[name] = array
        file[name].attrs.update(attributes)

    return change


FAULTS = {
    "format": (lambda f: f.attrs.__setitem__("format", "else"), "attribute format: found 'else'; expected 'drape anim"),
    "attribute": (lambda f: f.attrs.__delitem__("dt"), "attributes: missing dt"),
    "missing": (lambda f: f.__delitem__("v"), "v: missing; expected float64"),
    "shape": (_replace("v", np.zeros((4, 49, 3))), r"v: found float64 of shape \(4, 49, 3\); expected .* \(5, 49, 3\)"),
    "numbers": (_replace("numbers/residual", np.zeros(2)), r"numbers/residual: found float64 of shape \(2\)?"),
    "body": (lambda f: f.__delitem__("body/faces"), "body/faces: missing"),
    "unit": (lambda f: f["x"].attrs.__setitem__("units", "mm"), "x: attribute units: found 'mm'; expected 'm'"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_file_with_a_fault_is_refused_with_a_sentence(path: Path, fault: str) -> None:
    change, sentence = FAULTS[fault]
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(DrapeError, match=sentence) as error:
        AnimationFile(path)
    assert str(error.value).startswith(str(path))


def test_a_foreign_file_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "thesis.h5"
    path.write_text("my thesis")
    with pytest.raises(DrapeError, match="no whole HDF5 file"):
        AnimationWriter(path, header(FRAMES))
    assert path.read_text() == "my thesis"
    with pytest.raises(DrapeError, match=r"no such file; make it with: python src/animate.py"):
        AnimationFile(tmp_path / "absent.h5")


def test_the_mesh_of_the_tests_is_a_mesh() -> None:
    assert MESH.num_vertices == len(state(0).x) == 49


def test_frames_and_body_are_read_when_they_are_asked_for(path: Path) -> None:
    """A frame that is damaged is refused by whoever reads it, and by nobody else."""
    with h5py.File(path, "r+") as file:
        file["x"][2, 0, 0] = np.nan
    with AnimationFile(path) as file:
        assert "header" not in vars(file), "its body was not read"
        np.testing.assert_array_equal(file.x(1), state(1).x)
        for read in (lambda: file.x(2), lambda: file.state(2), file.trajectory):
            with pytest.raises(DrapeError, match=r"x: frame 2: found a number that is not finite"):
                read()
