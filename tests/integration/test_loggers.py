"""Curves, images and the resolved config arrive in every logger, and survive an interruption."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from drape.report.curves import read_curves
from drape.training.metrics_csv import parts, set_aside
from tests.integration.conftest import ROOT, program

KILL = "+callbacks.kill={_target_: tests.integration.kill.KillAt, step: 7}"
"""Two steps after the last checkpoint, which is of step 5."""


@pytest.fixture(scope="module")
def continued(data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, subprocess.CompletedProcess]:
    """A training with all loggers, killed and continued; what was in metrics.csv when it was killed."""
    folder = tmp_path_factory.mktemp("logged")
    command = ["scale=smoke", "logger=all", "trainer.log_every_n_steps=1", KILL]
    command += [f"data.path={data}", f"hydra.run.dir={folder}"]
    killed = program("train", *command, KILL="1")
    assert killed.returncode == 9, killed.stderr
    before = (folder / "metrics.csv").read_text()
    done = program("train", *command)
    assert done.returncode == 0, done.stderr
    return folder, before, done


@pytest.fixture(scope="module")
def events(continued) -> EventAccumulator:
    """All that TensorBoard shows of it."""
    accumulator = EventAccumulator(str(continued[0]), size_guidance={"images": 0, "scalars": 0, "tensors": 0})
    return accumulator.Reload()


def test_rows_before_the_interruption_are_kept(continued):
    folder, before, _ = continued
    assert (folder / "metrics_0.csv").read_text() == before
    steps, losses = read_curves(folder / "metrics.csv")["train/loss/total"]
    assert steps == list(range(20))
    of_parts = [read_curves(folder / name)["train/loss/total"] for name in ("metrics_0.csv", "metrics.csv")]
    assert of_parts[0][0] == list(range(6))
    assert losses[:5] == of_parts[0][1][:5]
    assert losses[5:6] == of_parts[0][1][5:]  # repeated, with the same result


def test_tensorboard_has_curves_images_and_config(continued, events):
    assert {event.step for event in events.Scalars("train/loss/total")} == set(range(20))
    assert events.Scalars("test/force_residual_N/overall")[0].value > 0
    images = events.Images("figures/energy_map")
    assert {image.step for image in images} == {10, 20}
    assert images[0].width > 300
    text = events.Tensors("config/text_summary")[0].tensor_proto.string_val[0].decode()
    assert (continued[0] / "config.yaml").read_text() in text
    assert "stretch_scale: 0." in text
    assert "${" not in text


def test_wandb_has_all_of_it_offline_in_the_run_directory(continued):
    folder, _, done = continued
    runs = sorted((folder / "wandb").glob("offline-run-*"))
    assert len(runs) == 2
    stored = next(runs[-1].glob("*.wandb")).read_bytes()
    for words in (b"train/loss/total", b"test/force_residual_N/overall", b"stretch_scale", b"figures/energy_map"):
        assert words in stored
    assert len(list(runs[-1].glob("files/media/images/figures/energy_map_*.png"))) == 2
    assert not (ROOT / "wandb").exists()
    assert "login" not in done.stderr


def test_the_newest_map_is_in_the_run_directory(continued):
    image = continued[0] / "figures" / "energy_map.png"
    assert image.read_bytes()[:4] == b"\x89PNG"
    assert image.stat().st_size > 20_000


@pytest.mark.parametrize("words", ["Traceback", "Tip", "is not empty", "smaller than the logging interval", "LeafSpec"])
def test_nothing_pointless_is_said(continued, words):
    assert words not in continued[2].stderr


def test_parts_are_numbered_and_read_in_the_order_of_writing(tmp_path):
    """Steps that were repeated count as the last part logged them; so do curves that end early."""
    path = tmp_path / "metrics.csv"
    set_aside(path)  # nothing there: nothing to do
    for rows in ("0,9,8\n1,9,\n2,9,\n", "1,5,\n2,5,\n", "2,1,\n3,1,\n"):
        set_aside(path)
        path.write_text("step,train/loss,lr\n" + rows)
    assert [part.name for part in parts(path)] == ["metrics_0.csv", "metrics_1.csv", "metrics.csv"]
    assert read_curves(path) == {"train/loss": ([0, 1, 2, 3], [9.0, 5.0, 1.0, 1.0]), "lr": ([0], [8.0])}
