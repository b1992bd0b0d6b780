"""The generator as users run it: same data whatever happens on the way, and a sentence for every accident."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from drape.data.hdf5 import GarmentFile
from tests.integration.conftest import ROOT, Run, in_process

SEQUENCES = 32
pytestmark = [
    pytest.mark.blender,
    pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)"),
]


def typed(path: Path, *overrides: str) -> list[str]:
    counts = [f"data.counts.train={SEQUENCES - 8}", "data.counts.test=8"]
    return ["data=tiny", *counts, f"data.path={path}", f"hydra.run.dir={path.parent}/run", *overrides]


def generate(path: Path, *overrides: str) -> Run:
    return in_process("generate", *typed(path, *overrides))


def command(path: Path, *overrides: str) -> list[str]:
    """The same, for a process that is to be killed or hindered."""
    return [sys.executable, str(ROOT / "src/generate.py"), *typed(path, *overrides)]


def parts_of(path: Path) -> list[Path]:
    return sorted(Path(f"{path}.parts").glob("[0-9]*.npz"))


def started(path: Path, finished: int, *overrides: str) -> subprocess.Popen:
    """A generator in the middle of its work: ``finished`` sequences are stored."""
    process = subprocess.Popen(command(path, *overrides), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 800
    while len(parts_of(path)) < finished:
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.002)
    return process


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def same(one: GarmentFile, other: GarmentFile) -> None:
    assert len(one.sequences) == len(other.sequences) == SEQUENCES
    for first, second in zip(one.sequences, other.sequences, strict=True):
        np.testing.assert_array_equal(first.positions, second.positions)
        assert first.attempts == second.attempts


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> tuple[GarmentFile, str]:
    """A data set made by two workers in one go, and what was printed."""
    path = tmp_path_factory.mktemp("straight") / "cloth.h5"
    run = generate(path, "workers=2")
    assert run.code == 0, run.err
    return GarmentFile(path), run.out


def test_the_data_set_is_complete_and_described(straight: tuple[GarmentFile, str]) -> None:
    file, printed = straight
    assert {(each.num_frames, each.mesh.num_vertices) for each in file.sequences} == {(8, 64)}
    assert len(file.sequences) == SEQUENCES
    assert file.fabrics == ("silk", "leather", "denim", "cotton")
    for split, count in (("train", SEQUENCES - 8), ("test", 8)):
        shown = Counter(file.sequence(name).fabric for name in file.split(split))
        assert shown == dict.fromkeys(file.fabrics, count // 4)
    assert file.materials["silk"]["bending_stiffness"] == 0.5
    moved = np.stack([each.positions[1] - each.positions[0] for each in file.sequences])
    assert np.linalg.norm(moved, axis=-1).max(axis=1).min() > 1e-4  # every sequence moves from its first frame on
    assert np.abs(moved[:, file.sequences[0].pinned]).max() == 0.0
    for text in (f"{SEQUENCES} sequences of 8 frames", "gravity 9.810 m/s2", "rejected", "contact sheet: "):
        assert text in printed
    assert file.path.with_suffix(".png").stat().st_size > 10_000
    assert sorted(p.name for p in file.path.parent.iterdir()) == ["cloth.h5", "cloth.png", "run"]


def test_the_same_command_again_simulates_nothing(straight: tuple[GarmentFile, str]) -> None:
    path = straight[0].path
    before = path.stat().st_mtime_ns
    run = generate(path, "workers=1")
    assert run.code == 0
    assert "already there with this configuration" in run.out
    assert path.stat().st_mtime_ns == before
    run = generate(path, "data.start.push=1.0")
    assert run.code != 0
    assert "data.start.push: 3.0 there, 1.0 asked for" in run.err
    assert path.stat().st_mtime_ns == before


def test_killed_and_resumed_with_another_number_of_workers_is_the_same(
    straight: tuple[GarmentFile, str], tmp_path: Path
) -> None:
    path = tmp_path / "cloth.h5"
    process = started(path, 5, "workers=2")
    process.kill()
    process.wait()
    assert not path.exists()
    kept = parts_of(path)
    assert 5 <= len(kept) < SEQUENCES
    times = {part: part.stat().st_mtime_ns for part in kept[:3]}

    refused = generate(path, "data.seed=1")
    assert refused.code != 0
    assert "data.seed: 0 there, 1 asked for" in refused.err
    assert {part: part.stat().st_mtime_ns for part in kept[:3]} == times

    resumed = generate(path, "workers=1")
    assert resumed.code == 0, resumed.err
    same(GarmentFile(path), straight[0])
    assert not Path(f"{path}.parts").exists()


def test_a_dead_worker_is_reported_and_nothing_hangs(straight: tuple[GarmentFile, str], tmp_path: Path) -> None:
    path = tmp_path / "cloth.h5"
    process = started(path, 3, "workers=2")
    os.kill(children(process.pid)[0], signal.SIGKILL)
    _, errors = process.communicate(timeout=800)
    assert process.returncode not in (0, None)
    assert "its Blender process died (exit status -9)" in errors
    assert "error: sequence " in errors
    assert "Traceback" not in errors
    assert generate(path).code == 0
    same(GarmentFile(path), straight[0])


@pytest.mark.parametrize("blocks", [4, 60])
def test_a_full_disk_is_a_sentence_and_finished_sequences_are_kept(
    straight: tuple[GarmentFile, str], tmp_path: Path, blocks: int
) -> None:
    """Files of at most ``blocks`` KiB: too little for a sequence, or for the data set."""
    path = tmp_path / "cloth.h5"
    limit = ["bash", "-c", f'ulimit -f {blocks}; exec "$@"', "bash"]
    whole = [*limit, *command(path, "workers=2", "hydra.output_subdir=null")]
    run = subprocess.run(whole, capture_output=True, text=True, timeout=800)
    assert run.returncode not in (0, None)
    assert re.search(r"error: .*cloth.h5: .*File too large; finished .* are kept in .*cloth.h5.parts", run.stderr)
    assert "Traceback" not in run.stderr
    assert not path.exists()
    assert len(parts_of(path)) == (SEQUENCES if blocks == 60 else 0)
    assert not list(tmp_path.glob("*.tmp*"))
    if blocks == 60:
        assert generate(path).code == 0
        same(GarmentFile(path), straight[0])


def test_a_foreign_file_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "cloth.h5"
    path.write_text("my thesis")
    run = generate(path)
    assert run.code != 0
    assert "no whole HDF5 file" in run.err
    assert path.read_text() == "my thesis"


def test_help_explains_without_running() -> None:
    run = in_process("generate", "--help")
    assert run.code == 0
    for text in ("python src/generate.py data=cloth_1m", "resolution: 22", "workers: auto"):
        assert text in run.out
