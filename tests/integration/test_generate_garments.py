"""The generator of garments as users run it: complete, the same whatever happens on the way, and nothing twice."""

from __future__ import annotations

import csv
import importlib.util
import json
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from drape.data.hdf5 import GarmentFile
from tests.integration.conftest import ROOT, Run, in_process
from tests.people import needs_anny

SMALLEST = [
    "data.counts={train:2,test:1}",
    "data.bodies={train:1,test:1}",
    "data.kinds=[tshirt,skirt]",
    "data.frames=4",
    "data.settle=4",
]
pytestmark = [
    pytest.mark.blender,
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)"),
]


def typed(path: Path, *overrides: str) -> list[str]:
    paths = [f"data.path={path}", f"hydra.run.dir={path.parent}/run"]
    return ["data=garments", "size=tiny", *SMALLEST, *paths, *overrides]


def generate(path: Path, *overrides: str) -> Run:
    return in_process("generate", *typed(path, *overrides))


def parts_of(path: Path) -> list[Path]:
    return sorted(part for part in Path(f"{path}.parts").glob("[0-9]*.npz") if "tmp" not in part.name)


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> tuple[GarmentFile, str]:
    """A data set made by two workers in one go, and what was printed."""
    path = tmp_path_factory.mktemp("straight") / "garments.h5"
    run = generate(path, "workers=2")
    assert run.code == 0, run.err
    return GarmentFile(path), run.out


def test_the_data_set_is_complete_and_described(straight: tuple[GarmentFile, str]) -> None:
    file, printed = straight
    assert (file.names, file.fabrics) == (("00000", "00001", "00002"), ("silk", "leather", "denim", "cotton"))
    np.testing.assert_array_equal(file.gravity, [0.0, 0.0, -9.81])
    assert file.split("test") == ("00002",)
    sequences = [file.sequence(name) for name in file.names]
    assert {sequence.kind for sequence in sequences} == {"tshirt", "skirt"}
    assert sequences[2].body not in {sequence.body for sequence in sequences[:2]}
    for sequence in sequences:
        assert sequence.positions.shape == (4, sequence.mesh.num_vertices, 3)
        assert np.linalg.norm(np.diff(sequence.positions, axis=0), axis=-1).max() > 1e-4
        assert sequence.mass_per_vertex == file.materials[sequence.fabric]["mass_per_vertex"]
        assert sequence.quality["inside_worst"] <= 0.002
        if sequence.kind == "skirt":  # the waistband goes where its weights carry it
            pinned = sequence.pinned
            assert len(pinned) > 5
            np.testing.assert_allclose(sequence.positions[:, pinned], sequence.skinned[:, pinned], atol=1e-5)
    twin = sequences[2].twin - sequences[2].positions
    assert 0.0 < np.median(np.abs(twin)) < 0.01  # it settles in four frames, which is violent
    assert all(sequence.twin is None for sequence in sequences[:2])
    for text in ("3 sequences of 4 frames", "gravity 9.810 m/s2", "quality control: ", "contact sheet: "):
        assert text in printed
    assert file.path.with_suffix(".png").stat().st_size > 10_000
    assert sorted(p.name for p in file.path.parent.iterdir()) == ["garments.h5", "garments.png", "run"]


def test_killed_and_resumed_with_another_number_of_workers_is_the_same(
    straight: tuple[GarmentFile, str], tmp_path: Path
) -> None:
    path = tmp_path / "garments.h5"
    command = [sys.executable, str(ROOT / "src/generate.py"), *typed(path, "workers=1")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 800
    while not parts_of(path):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert not path.exists()
    first = parts_of(path)[0]
    stamp = first.stat().st_mtime_ns

    refused = generate(path, "data.seed=1")
    assert refused.code != 0
    assert "data.seed: 0 there, 1 asked for" in refused.err
    assert first.stat().st_mtime_ns == stamp

    assert generate(path, "workers=2").code == 0
    assert not Path(f"{path}.parts").exists()
    assert path.read_bytes() == straight[0].path.read_bytes()


def test_the_same_command_again_simulates_nothing(straight: tuple[GarmentFile, str]) -> None:
    path = straight[0].path
    before = path.stat().st_mtime_ns
    run = generate(path, "workers=1")
    assert run.code == 0
    assert "already there with this configuration" in run.out
    refused = generate(path, "data.contact.friction=0.5")
    assert refused.code != 0
    assert "data.contact.friction: 0.02 there, 0.5 asked for" in refused.err
    assert path.stat().st_mtime_ns == before


def test_blender_is_timed_on_its_own_garments(straight: tuple[GarmentFile, str], tmp_path: Path) -> None:
    """The test sequence, simulated once more with the solver steps that it was made with."""
    file, _ = straight
    options = [f"measure.paths=[{file.path}]", "measure.frames=2", f"folder={tmp_path}"]
    done = in_process("benchmark", "measure=blender_time", *options)
    assert done.code == 0, done.err
    with open(tmp_path / "blender_time.csv") as rows:
        (row,) = csv.DictReader(rows)
    sequence = file.sequence("00002")
    assert (row["sequence"], row["garment"], row["fabric"]) == ("00002", sequence.kind, sequence.fabric)
    assert int(row["vertices"]) == sequence.mesh.num_vertices
    assert int(row["steps_per_frame"]) == sequence.quality["solver_steps"]
    assert 0.0 < float(row["ms_per_frame"]) < 1e4


def test_an_unknown_source_is_a_sentence(tmp_path: Path) -> None:
    run = generate(tmp_path / "garments.h5", "data.source=smpl")
    assert run.code != 0
    assert "data.source: found 'smpl'; expected garments, cloth3d, recorded, vto" in run.err


@needs_anny
def test_people_of_anny_are_dressed_and_stored(tmp_path: Path) -> None:
    path = tmp_path / "garments.h5"
    run = generate(path, "workers=1", "data/shape=anny", "data.counts={train:1,test:0}", "data.kinds=[tshirt]")
    assert run.code == 0, run.err
    file = GarmentFile(path)
    sequence = file.sequence("00000")
    assert np.linalg.norm(np.diff(sequence.positions, axis=0), axis=-1).max() > 1e-4
    assert sequence.quality["inside_worst"] <= 0.002
    with h5py.File(path) as stored:
        shape = json.loads(stored[f"bodies/{sequence.body}"].attrs["shape"])
    assert set(shape) == {"gender", "age", "muscle", "weight", "height", "proportions"}
    assert 0.4 <= shape["age"] <= 1.0
