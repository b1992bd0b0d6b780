"""Training as users run it: what it leaves behind, that it can be repeated, continued, and refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
import yaml

from drape.energy.law.checkpoint import load_energy
from drape.errors import DrapeError
from tests.integration.conftest import in_process, program, small, trained

KILL = "+callbacks.kill={_target_: tests.integration.kill.KillAt, step: 7}"


def metrics(folder: Path) -> dict[str, float]:
    return json.loads((folder / "metrics.json").read_text())["metrics"]


def same(one: dict[str, float], other: dict[str, float]) -> bool:
    return one.keys() == other.keys() and all(one[k] == other[k] or one[k] != one[k] for k in one)


@pytest.fixture(scope="module", params=["eunet", "eunet_hinge"])
def run(request, data, tmp_path_factory) -> tuple[str, Path]:
    """A finished training of each model."""
    folder = tmp_path_factory.mktemp(request.param)
    done = trained(data, folder, f"model={request.param}", KILL)
    assert done.code == 0, done.err
    return request.param, folder


def test_a_run_leaves_metrics_config_and_checkpoint(run):
    """Numbers for every fabric, a config without interpolations, a checkpoint that is read without pickle."""
    model, folder = run
    record = json.loads((folder / "metrics.json").read_text())
    assert record["model"] == model
    assert record["setting"]["steps"] == 20
    for fabric in ("silk", "leather", "denim", "cotton", "overall"):
        assert record["metrics"][f"energy_error_J2/{fabric}"] > 0
        assert record["metrics"][f"force_residual_N/{fabric}"] > 0
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert config["model"]["potential"]["stretch_scale"] > 0
    assert "${" not in (folder / "config.yaml").read_text()
    content = torch.load(folder / "checkpoints" / "last.ckpt", weights_only=True)
    assert content["drape"]["config"] == config


def test_the_same_command_again_returns_the_same_result(run, data):
    """A finished run is not trained again."""
    model, folder = run
    before = (folder / "metrics.json").stat().st_mtime_ns
    again = trained(data, folder, f"model={model}", KILL)
    assert again.code == 0, again.err
    assert "finished before" in again.err
    assert (folder / "metrics.json").stat().st_mtime_ns == before


def test_killed_and_continued_is_as_never_killed(run, data, tmp_path):
    """Killed at step 7, continued from the checkpoint of step 5: the metrics of the uninterrupted run, bit for bit."""
    model, folder = run
    killed = program("train", *small(data, tmp_path, f"model={model}", KILL), KILL="1")
    assert killed.returncode == 9
    assert not (tmp_path / "metrics.json").exists()
    state = torch.load(tmp_path / "checkpoints" / "last.ckpt", weights_only=True)
    assert state["global_step"] == 5
    continued = trained(data, tmp_path, f"model={model}", KILL)
    assert continued.code == 0, continued.err
    assert same(metrics(folder), metrics(tmp_path))


def test_another_seed_is_another_result(run, data, tmp_path):
    """The seed reaches the parameters."""
    model, folder = run
    other = trained(data, tmp_path, f"model={model}", KILL, "seed=1")
    assert other.code == 0, other.err
    assert not same(metrics(folder), metrics(tmp_path))


def test_a_folder_keeps_one_config(run, data):
    """Other values in the folder of a run are refused, naming them."""
    model, folder = run
    other = trained(data, folder, f"model={model}", KILL, "scale.max_steps=30")
    assert other.code == 2
    assert "scale.max_steps" in other.err
    assert "Traceback" not in other.err


def test_a_checkpoint_reproduces_its_example_and_notices_changes(run, tmp_path):
    """Loaded here it gives the energies and forces that it stored; with other weights it is refused."""
    _, folder = run
    path = folder / "checkpoints" / "last.ckpt"
    assert not any(p.requires_grad for p in load_energy(path).parameters())
    content = torch.load(path, weights_only=True)
    for name, value in content["state_dict"].items():
        if name.startswith("energy.") and value.is_floating_point():
            value.mul_(1.1)
    torch.save(content, tmp_path / "changed.ckpt")
    with pytest.raises(DrapeError, match="example differ"):
        load_energy(tmp_path / "changed.ckpt")
    model = content["drape"]["config"]["model"]
    content["drape"]["config"]["model"] = model | {"width_of_old": 3}
    torch.save(content, tmp_path / "old.ckpt")
    with pytest.raises(DrapeError, match="has no argument .width_of_old."):
        load_energy(tmp_path / "old.ckpt")
    content["drape"]["config"]["model"] = model
    del content["state_dict"][next(name for name in content["state_dict"] if name.startswith("energy."))]
    torch.save(content, tmp_path / "partial.ckpt")
    with pytest.raises(DrapeError, match="cannot be built"):
        load_energy(tmp_path / "partial.ckpt")
    content["drape"]["format"] = 99
    torch.save(content, tmp_path / "future.ckpt")
    with pytest.raises(DrapeError, match="format 99"):
        load_energy(tmp_path / "future.ckpt")
    (tmp_path / "text.ckpt").write_text("no checkpoint")
    with pytest.raises(DrapeError, match="cannot be read"):
        load_energy(tmp_path / "text.ckpt")
    with pytest.raises(DrapeError, match="no such checkpoint"):
        load_energy(tmp_path / "missing.ckpt")


def test_batch_size_of_the_test_does_not_change_the_metrics(run, data, tmp_path):
    """Energy error and force residual are those of windows, not of batches."""
    model, folder = run
    other = trained(data, tmp_path, f"model={model}", KILL, "scale.eval_batch_size=7")
    assert other.code == 0, other.err
    for name, value in metrics(folder).items():
        if name.startswith(("energy_error", "force_residual", "spring_hinge")):
            assert metrics(tmp_path)[name] == pytest.approx(value, rel=1e-5)


def test_every_ablation_runs_and_reports(data, tmp_path):
    """All ablations of the paper's model in one multirun, then the table over them."""
    sweep = in_process(
        "train", "-m", f"data.path={data}", "scale=smoke", "scale.max_steps=4", "scale.validation_steps=4",
        "logger=csv", f"hydra.sweep.dir={tmp_path}", "ablation=none,no_dissipation,no_contrastive,no_bending",
    )  # fmt: skip
    assert sweep.code == 0, sweep.err
    assert len(list(tmp_path.rglob("metrics.json"))) == 4
    report = in_process("report", f"runs={tmp_path}")
    assert report.code == 0, report.err
    table = (tmp_path / "report" / "tables.md").read_text()
    assert "85.74" in table
    assert (tmp_path / "report" / "energy_map.png").stat().st_size > 10_000


@pytest.mark.slow
def test_two_processes_train(data, tmp_path):
    """``trainer=ddp`` on two CPU processes finishes, writes one record and speaks with one voice."""
    done = program("train", *small(data, tmp_path, "trainer=ddp", "scale.max_steps=4", "scale.validation_steps=2"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("run directory:") == 1
    assert "trial run" not in done.stdout
    assert metrics(tmp_path)["energy_error_J2/overall"] > 0


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (["model=eunt"], "eunet"),
        (["scale.widht=3"], "widht"),
        (["loss.energy_balance.weihgt=3"], "weihgt"),
        (["model=eunet_hinge", "ablation=no_contrastive"], "changes nothing"),
        (["data.path=missing.h5"], "no such file"),
        (["+material.wool={preset: Wool}"], "wool"),
        (["loss/energy_balance=zero", "loss/contrastive=zero"], "no term"),
    ],
)
def test_mistakes_get_a_sentence(data, tmp_path, overrides, sentence):
    """Exit status 2 and one sentence that names the mistake, no traceback."""
    done = trained(data, tmp_path, *overrides)
    assert done.code == 2, done.err
    assert sentence in done.err
    assert "Traceback" not in done.err
