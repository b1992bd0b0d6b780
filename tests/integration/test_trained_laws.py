"""Laws of trainings against what they have seen, and what a recorder does: from the command line to tables."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from PIL import Image

from drape.benchmark.recorder import backward_euler
from tests.integration.conftest import ROOT, Run, in_process, trained

MEASURE = ["measure=trained_laws", "measure.sequences=1", "measure.frames=2", "measure.windows=8"]


@pytest.fixture(scope="module")
def runs(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two trainings, with and without noise."""
    folder = tmp_path_factory.mktemp("runs")
    for noise in ("0.0", "1e-3"):
        done = trained(data, folder / noise, "model=eunet_hinge", f"observation.noise={noise}", "scale.max_steps=2")
        assert done.code == 0, done.err
    return folder


def measured(folder: Path, *overrides: str) -> Run:
    return in_process("benchmark", *MEASURE, *overrides, f"folder={folder}", f"hydra.run.dir={folder}")


def test_laws_are_compared_with_what_they_have_seen(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    laws = "measure.laws=[learned,spring_hinge,instruments]"
    done = measured(tmp_path, f"measure.runs=[{runs}]", "measure.against=observation.noise", laws,
                    "measure.fits.instruments=[1]")  # fmt: skip
    assert done.code == 0, done.err
    with open(tmp_path / "noise.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 3 * 4
    assert (tmp_path / "noise.png").stat().st_size > 10_000
    found = {(float(row["value"]), row["law"], row["fabric"]): float(row["force_residual_N"]) for row in rows}
    assert min(found.values()) > 0
    clean, noisy = found[0.0, "spring_hinge", "silk"], found[1e-3, "spring_hinge", "silk"]
    assert noisy != pytest.approx(clean, rel=1e-3)  # each law is fitted to what its training saw


def test_a_law_and_its_ablations_are_animated_beside_recorded_cloth(data, tmp_path, monkeypatch):
    """Each law is that of its own checkpoint, and the picture has a line for each and for what was recorded."""
    monkeypatch.chdir(ROOT)
    rows = tmp_path / "eunet"
    for seed, name in enumerate(("none", "no_dissipation", "no_contrastive")):
        given = ("model=eunet", f"ablation={name}", "scale.max_steps=1", f"seed={seed}")
        done = trained(data, rows / name / "all" / "seed_0", *given)
        assert done.code == 0, done.err
    given = [f"trained={rows}", f"measure.path={data}", "measure.frames=2", "measure.variants.default.iterations=[6]"]
    done = in_process("benchmark", "measure=animated_laws", *given, f"folder={tmp_path}", f"hydra.run.dir={tmp_path}")
    assert done.code == 0, done.err
    with open(tmp_path / "animated_laws.csv") as file:
        found = {(row["fabric"], row["energy"]): float(row["error_mm"]) for row in csv.DictReader(file)}
    assert len(found) == 4 * 4
    for fabric in ("silk", "leather", "denim", "cotton"):
        assert len({error for (name, _), error in found.items() if name == fabric}) == 4
    with Image.open(tmp_path / "animated_laws_last_frames.png") as picture:
        assert picture.width == pytest.approx(4 / 5 * picture.height, rel=0.1)


def test_mistakes_get_a_sentence(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    for override, sentence in (
        ("measure.runs=[nowhere]", "found no checkpoints/last.ckpt below nowhere; train first"),
        ("measure.against=name", "expected a number to compare by"),
        ("measure.laws=[phys]", "measure.laws: found phys; expected some of learned, spring_hinge, instruments"),
    ):
        given = [f"measure.runs=[{runs}]", override] if "runs=" not in override else [override]
        done = measured(tmp_path, *given)
        assert done.code == 2
        assert sentence in done.err
        assert "Traceback" not in done.err


def test_steps_of_backward_euler_have_these_weights():
    """One step takes all forces at its end; of very many a sixth acts as before, a sixth as after."""
    assert backward_euler(1) == (0.0, 0.0, 1.0)
    assert backward_euler(2) == (0.0, 0.5, 0.5)
    assert backward_euler(10_000) == pytest.approx((1 / 6, 2 / 3, 1 / 6), abs=1e-3)


def test_a_recorder_is_described_for_each_fabric(data, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    done = in_process("benchmark", "measure=recorder", f"measure.paths=[{data}]", f"folder={tmp_path}",
                      f"hydra.run.dir={tmp_path}")  # fmt: skip
    assert done.code == 0, done.err
    with open(tmp_path / "recorder.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["fabric"] for row in rows] == ["silk", "leather", "denim", "cotton"]
    for row in rows:
        for part in ("spring", "hinge", "euler"):
            assert sum(float(row[f"{part}_{frame}"]) for frame in ("before", "now", "next")) == pytest.approx(1.0)
