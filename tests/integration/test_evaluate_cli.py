"""Evaluating as users do: baselines, the solver, tables, interruptions, mistakes."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import re
import runpy
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hydra.core.global_hydra import GlobalHydra

from drape.data.animation_hdf5 import AnimationFile
from drape.data.hdf5 import GarmentFile
from drape.data.stored_part import Header, StoredBody, StoredSequence
from tests import garments
from tests.integration.conftest import ROOT, Run, program

QUICK = ("simulator.iterations=3", "frames=2", "contact.reach=0.1")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    return garments.write(tmp_path_factory.mktemp("garments") / "recorded.h5")


@pytest.fixture
def run(monkeypatch, tmp_path, recordings) -> Iterator[Callable[..., Run]]:
    """``python src/<name>.py runs=<tmp_path> overrides`` in this process."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")

    def call(*overrides: str, name: str = "evaluate") -> Run:
        GlobalHydra.instance().clear()
        given = [f"runs={tmp_path}"]
        if name == "evaluate" and not any(word.startswith(("data.path", "data=")) for word in overrides):
            given.append(f"data.path={recordings}")
        monkeypatch.setattr(sys, "argv", [f"src/{name}.py", *overrides, *given])
        out, err, code = io.StringIO(), io.StringIO(), 0
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                runpy.run_path(str(ROOT / "src" / f"{name}.py"), run_name="__main__")
            except SystemExit as stop:
                code = stop.code or 0
        return Run(code, out.getvalue(), err.getvalue())

    yield call
    GlobalHydra.instance().clear()


def metrics(folder: Path) -> dict[str, float]:
    return json.loads((folder / "metrics.json").read_text())["metrics"]


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


# What comes out


def test_the_noise_floor_is_the_error_of_the_twins(run, tmp_path, recordings):
    """Numbers, tables, a picture and the frames themselves."""
    done = run("simulator=twin", "sequences=2")
    assert done.code == 0, done.err
    folder = tmp_path / "recorded_test" / "twin"
    found = metrics(folder)
    assert 1e-4 < found["error_mm/overall"] < 1e-2
    assert found["error_mm/overall"] == pytest.approx(found["floor_mm/overall"], rel=1e-9)
    assert found["error_in_floors/overall"] == pytest.approx(1.0)
    assert (found["sequences/dress"], found["sequences/skirt"], found["sequences/overall"]) == (1, 1, 2)
    each = rows(folder / "sequences.csv")
    assert [(row["sequence"], row["fabric"], row["frames"]) for row in each] == [
        ("00001", "silk", "4"), ("00002", "denim", "4"),
    ]  # fmt: skip
    assert np.mean([float(row["error_mm"]) for row in each]) == pytest.approx(found["error_mm/overall"])
    frames = rows(folder / "by_frame.csv")
    assert [int(row["frame"]) for row in frames] == [1, 2, 3, 4] * 2
    with AnimationFile(folder / "sequences" / "00001.h5") as file, GarmentFile(recordings) as recorded:
        np.testing.assert_array_equal(file.x(3), recorded.sequence("00001").twin[4])
        assert file.is_complete
    assert (folder / "by_frame.png").stat().st_size > 10_000
    assert list((folder / "tensorboard").iterdir())
    assert re.search(r"\| overall \(2\) \| [\d.e-]+ ± [\d.e-]+ \| 1.00 \|", (folder / "table.md").read_text())


def test_baselines_are_as_good_as_they_should_be_and_stand_side_by_side(run, tmp_path):
    """The tube is carried almost rigidly: skinning beats standing still, flying on is worst. The report shows it."""
    errors = {}
    for name in ("frozen", "skinned", "ballistic"):
        done = run(f"simulator={name}")
        assert done.code == 0, done.err
        errors[name] = metrics(tmp_path / "recorded_test" / name)["error_mm/overall"]
    assert errors["skinned"] < errors["frozen"] < errors["ballistic"]
    report = run(f"folder={tmp_path / 'tables'}", name="report")
    assert report.code == 0, report.err
    text = (tmp_path / "tables" / "garments.md").read_text()
    table = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")]
    assert table[0][:4] == ["method", "dress", "skirt", "overall"]
    names = [row[0] for row in table[2:]]
    assert names[:4] == ["ballistic", "frozen", "skinned", "noise floor (twin)"]
    of_paper = dict((row[0], row[1:]) for row in table)["MGN-H+EUNet (paper)"]
    assert of_paper[0] == "92.83 ± 52.29"
    assert of_paper[4] == "0.44 ± 0.48"
    assert "simulator=frozen" in text


def test_the_solver_animates_every_fabric_with_its_own_table(run, tmp_path):
    done = run(*QUICK)
    assert done.code == 0, done.err
    folder = tmp_path / "recorded_test" / "implicit_eunet_baked_garment_3"
    found = metrics(folder)
    assert found["sequences/overall"] == 3
    assert found["ms_per_frame/overall"] > 1
    assert found["inside_percent/overall"] == 0
    tables = []
    for name in ("00001", "00002"):
        with AnimationFile(folder / "sequences" / f"{name}.h5") as file:
            tables.append(re.search(r"eunet_garment_\w+", file.header.config).group())
    assert tables == ["eunet_garment_silk", "eunet_garment_denim"]


def test_an_analytic_law_needs_no_fabric(run, tmp_path):
    done = run("energy=phys", "areal_density=0.2", "kinds=[dress]", "name=mine", *QUICK)
    assert done.code == 0, done.err
    assert metrics(tmp_path / "recorded_test" / "mine")["sequences/overall"] == 1


def test_the_record_has_the_command_as_it_was_typed(run, tmp_path):
    """With its interpolations: no path of this machine, and a shell understands it."""
    law = "energy.table=${shipped:eunet_hinge_silk.npz}"
    done = run("kinds=[dress]", law, "name=mine", *QUICK)
    assert done.code == 0, done.err
    record = json.loads((tmp_path / "recorded_test" / "mine" / "metrics.json").read_text())
    words = shlex.split(record["provenance"]["command"])
    assert words[:4] == ["python", "src/evaluate.py", "kinds=[dress]", law]


def test_right_after_the_data_it_runs_in_a_process_of_its_own(tmp_path, recordings):
    done = program("evaluate", f"data.path={recordings}", f"runs={tmp_path}", "simulator=skinned", "sequences=1")
    assert done.returncode == 0, done.stderr
    assert "evaluating: 100%" in done.stderr
    assert "ms/frame" in done.stderr
    assert f"{tmp_path.name}/recorded_test/skinned/table.md" in done.stdout


def test_a_multirun_makes_a_folder_for_each(run, tmp_path):
    assert run("-m", "simulator=frozen,skinned", "sequences=1").code == 0
    assert {path.parent.name for path in tmp_path.glob("recorded_test/*/metrics.json")} == {"frozen", "skinned"}


# Interruptions


def test_it_goes_on_where_it_stopped(run, tmp_path):
    """Sequences that are done keep their frames and scores, an interrupted one its frames; the end is the same."""
    folder = tmp_path / "recorded_test" / "implicit_eunet_baked_garment_3"
    assert run(*QUICK, "sequences=1").code == 0
    first = folder / "sequences" / "00001.h5"
    before, scores = os.stat(first).st_mtime_ns, (folder / "sequences" / "00001.csv").read_text()
    assert run(*QUICK).code == 0
    assert os.stat(first).st_mtime_ns == before
    assert (folder / "sequences" / "00001.csv").read_text() == scores
    whole = metrics(folder)
    (folder / "sequences" / "00002.csv").write_text("sequence,frame\n00002,1\n")
    assert run(*QUICK).code == 0
    same = {key for key in whole if not key.startswith("ms_per_frame")}
    again = metrics(folder)
    assert {key: again[key] for key in same} == pytest.approx({key: whole[key] for key in same}, nan_ok=True)


def test_another_configuration_does_not_mix_into_the_folder(run):
    assert run("simulator=skinned", "sequences=1").code == 0
    done = run("simulator=skinned", "sequences=1", "simulator.start=rest")
    assert done.code == 2
    assert "simulator.start: recorded there, rest asked for" in done.err


# Mistakes


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["split=validation"], "split 'validation'; expected one of train, test"),
        (["kinds=[hat]"], "found no 'hat' in the split test; expected some of its kinds: dress, skirt"),
        (["kinds=[]"], "found no sequence in the split test"),
        (["sequences=0"], "sequences: found 0; expected a whole number from 1"),
        (["sequences=all"], "selection.sequences: found 'all' (str)"),
        (["frames=40"], "frames: found 40; expected 1..4, as 6 are recorded"),
        (["simulator=twin"], "sequences/00003: has no twin"),
        (["simulator=frozen", "energy=phys"], "found energy=phys; expected nothing, as simulator Frozen minimises no"),
        (["simulator=frozen", "areal_density=1"], "areal_density: found areal_density=1; expected nothing"),
        (["areal_density=-1"], "areal_density: found -1; expected a number above 0"),
        (["simulator=twin", "contact.thickness=0.01"], "contact.thickness: found contact.thickness=0.01; expected"),
        (["fabric=denim"], "fabric: found fabric=denim; expected nothing, as the fabric of each sequence is the one"),
        (["simulator.device=abacus"], "simulator.device: found 'abacus'"),
        (["simulator=frozn"], "frozn"),
        (["data.path=nowhere.h5"], "nowhere.h5: no such file; make it with: python src/generate.py data=garments"),
        (["energy.table=${shipped:eunet_hinge_silk.npz}"], "found a table of silk; expected one of denim"),
    ],
)  # fmt: skip
def test_mistakes_are_sentences_before_any_work(run, tmp_path, overrides, words):
    done = run(*overrides)
    assert done.code == 2, done.out
    assert words in done.err
    assert not list(tmp_path.rglob("metrics.json"))


def test_the_motion_of_a_body_alone_cannot_be_evaluated(run, tmp_path):
    points, faces = garments.tube()
    alone = StoredSequence("00000", "body", "walk", "test", body_positions=garments.carried(points))
    header = Header("vto", 30.0, (0.0, 0.0, -9.81), {}, "{}")
    garments.write_groups(tmp_path / "vto.h5", header, {"body": StoredBody(points, faces)}, {}, [alone])
    done = run(f"data.path={tmp_path}/vto.h5", "simulator=frozen")
    assert done.code == 2
    assert "sequences/00000: found the motion of a body without recorded positions of a garment" in done.err


def test_baselines_do_not_animate_other_scenes(animate):
    done = animate("simulator=frozen", "scene=hanging", "scene.resolution=6", "output.render=none")
    assert done.code == 2
    assert "simulator: found Frozen, which follows a recorded garment; expected a simulator" in done.err


def test_a_recorded_garment_is_a_scene_of_animate(animate, tmp_path, recordings):
    done = animate(
        "scene=garment", f"scene.path={recordings}", "scene.sequence='00001'", "scene.frames=1",
        "simulator.iterations=3", "output.render=none",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert "mean distance to the recorded frames" in done.out
    wrong = animate("scene=garment", f"scene.path={recordings}", "scene.sequence='00002'")
    assert (wrong.code, "choose fabric=denim" in wrong.err) == (2, True)
