"""Training of simulators as users run it: every row trains and animates, can be continued, and says what is wrong."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from drape.benchmark.simulator_step import PARTS
from drape.config.entry_point import CONF
from drape.data.animation_hdf5 import AnimationFile
from tests import garments
from tests.integration.conftest import in_process, program

ROWS = ["mgn", "layersnet", "mgn_s_phys", "mgn_s_phys_f", "hood", "mgn_s_eunet", "mgn_h_eunet", "mgn_s_eunet_newton"]
KILL = "+callbacks.kill={_target_: tests.integration.kill.KillAt, step: 5}"


@pytest.fixture(scope="module")
def tubes(tmp_path_factory) -> Path:
    return garments.write(tmp_path_factory.mktemp("garments") / "garments.h5")


def overrides(path: Path, folder: Path, *others: str) -> list[str]:
    common = ["scale=smoke", "material=silk", "logger=csv", "trainer.log_every_n_steps=1"]
    return [*common, f"data.path={path}", f"hydra.run.dir={folder}", *others]


@pytest.fixture(scope="module", params=ROWS)
def run(request, tubes, tmp_path_factory) -> tuple[str, Path]:
    """A finished training of each row, which has animated the test split."""
    folder = tmp_path_factory.mktemp(request.param)
    done = in_process("train", *overrides(tubes, folder, f"model={request.param}", KILL))
    assert done.code == 0, done.err
    return request.param, folder


def parameters(folder: Path) -> dict[str, torch.Tensor]:
    return torch.load(folder / "checkpoints" / "last.ckpt", weights_only=True)["state_dict"]


def test_a_row_learns_and_says_what_it_did(run):
    """Parameters moved away from where the seed put them; the record and the checkpoint say the same."""
    row, folder = run
    record = json.loads((folder / "simulator.json").read_text())
    assert (record["training"]["row"], record["training"]["iterations"]) == (row, 6)
    assert record["watched"]["error_mm"] > 0
    content = torch.load(folder / "checkpoints" / "last.ckpt", weights_only=True)
    assert content["drape"]["training"]["row"] == row
    assert content["global_step"] == 6
    with open(folder / "metrics.csv") as file:
        columns = set(next(csv.reader(file)))
    assert {"val/error_mm", "val/inside_percent", "val/ms_per_frame", "train/ms_per_step"} <= columns
    energies = {f"train/{kind}/{name}" for kind in ("loss", "energy_J") for name in ("inertia", "gravity", "contact")}
    assert energies <= columns if row not in ("mgn", "layersnet") else not energies & columns
    assert (folder / "figures" / "rollouts.png").stat().st_size > 5_000


def test_a_row_animates_when_it_is_trained(run):
    row, folder = run
    record = json.loads((folder / "evaluation" / "metrics.json").read_text())
    assert record["method"]["name"] == f"{row}_smoke_seed_0"
    assert record["method"]["training"]["parameters"] > 0
    assert record["data"]["sequences"] == ["00001", "00002", "00003"]
    assert 0 < record["metrics"]["error_mm/overall"] < 1000


@pytest.mark.parametrize("run", ["mgn_s_eunet"], indirect=True)
def test_a_checkpoint_animates_by_itself(run, tubes, tmp_path):
    """Where it was not trained: the same frames."""
    _, folder = run
    done = in_process(
        "evaluate", "simulator=neural", f"simulator.checkpoint={folder}/checkpoints/last.ckpt", f"data.path={tubes}",
        f"folder={tmp_path}", "sequences=1",
    )  # fmt: skip
    assert done.code == 0, done.err
    one, other = (AnimationFile(place / "sequences" / "00001.h5") for place in (folder / "evaluation", tmp_path))
    with one, other:
        np.testing.assert_allclose(one.trajectory().x, other.trajectory().x, atol=1e-9)


def test_a_trained_simulator_is_measured_over_many_frames(run, tubes, tmp_path):
    """Every way to train has an energy that is measured."""
    row, folder = run
    done = in_process(
        "benchmark",
        "measure=long_rollouts",
        f"measure.checkpoints=[{folder}/checkpoints/last.ckpt]",
        f"measure.path={tubes}",
        "measure.sequences=1",
        "measure.frames=12",
        "measure.stand=8",
        f"folder={tmp_path}",
    )
    assert done.code == 0, done.err
    with open(tmp_path / "long_rollouts.csv") as file:
        (line,) = csv.DictReader(file)
    assert line.pop("row") == row
    assert float(line["finite_frames_percent"]) == 100.0
    assert all(np.isfinite(float(value)) for value in line.values())
    assert float(line["energy_rise_worst_J_per_kg"]) >= max(0.0, float(line["energy_change_worst_J_per_kg"]))


@pytest.mark.parametrize("run", ["mgn_h_eunet"], indirect=True)
def test_killed_and_continued_is_as_never_killed(run, tubes, tmp_path):
    """Killed at iteration 5, continued from the checkpoint of iteration 4: the same parameters, bit for bit."""
    row, straight = run
    command = overrides(tubes, tmp_path, f"model={row}", KILL, "evaluate=false")
    assert program("train", *command, KILL="1").returncode == 9
    assert torch.load(tmp_path / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] == 4
    assert in_process("train", *command).code == 0
    one, other = parameters(straight), parameters(tmp_path)
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.slow
def test_two_processes_train_and_one_animates(tubes, tmp_path):
    """With ``trainer=ddp`` the test split is animated once, by a process that waits for no other."""
    done = program("train", *overrides(tubes, tmp_path, "model=mgn", "trainer=ddp"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("run directory:") == 1
    record = json.loads((tmp_path / "evaluation" / "metrics.json").read_text())
    assert record["data"]["sequences"] == ["00001", "00002", "00003"]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (("model=mgn_s_eunet", "datamodule.start=skined"), "found 'skined'; expected recorded or carried"),
        (("model=mgn_s_eunet", "training.updates=twice"), "expected step or rollout"),
        (("model=mgn_s_eunet", "scale.simulator.rollout_last=5"), "expected at least 7"),
        (("model=mgn", "ablation=no_bending"), "this ablation does not fit"),
        (("model=mgn_s_eunet", "ablation=no_estimation"), "model.cloths.estimates: LearnedCloths has no argument"),
        (("model=mgn", "loss=potential"), "no elastic energy to minimise"),
        (("model=mgn", "loss=paper"), "found energy_balance (EnergyBalance), contrastive (Contrastive)"),
        (("model=mgn", "loss=paper"), "choose another option, loss=..."),
        (("model=mgn_s_eunet", "optimizer.lr=1e11"), "training stopped at step"),
        (("model=mgn_h_eunet", "model.network.network.coarse_levels=3"), "schedule"),
    ],
)
def test_what_makes_no_sense_is_refused(wrong, told, tubes, tmp_path):
    done = in_process("train", *overrides(tubes, tmp_path, *wrong))
    assert done.code == 2, done.err
    assert told in done.err


def test_parts_combine_freely(tubes, tmp_path):
    """A network, cloths and a loss that make no row of the paper."""
    choice = ["model=layersnet", "model/cloths=eunet", "loss=newton", "evaluate=false"]
    done = in_process("train", *overrides(tubes, tmp_path, *choice))
    assert done.code == 0, done.err
    with open(tmp_path / "metrics.csv") as file:
        assert {"train/loss/newton", "train/loss/contact"} <= set(next(csv.reader(file)))


def test_the_checkpoint_of_an_energy_is_no_simulator(tubes):
    checkpoint = CONF.parent / "src/drape/checkpoints/eunet_garment.ckpt"
    done = in_process("evaluate", "simulator=neural", f"simulator.checkpoint={checkpoint}", f"data.path={tubes}")
    assert done.code == 2
    assert "found the checkpoint of an energy; expected one of a simulator" in done.err


@pytest.mark.parametrize("row", ["mgn_s_eunet", "layersnet"])
def test_a_step_is_measured_beside_its_network(row, tubes, tmp_path):
    """The parts add up to the step, and the network alone is a part of it."""
    done = in_process(
        "benchmark",
        f"model={row}",
        "scale=smoke",
        "material=silk",
        f"data.path={tubes}",
        "repeats=2",
        f"folder={tmp_path}",
    )
    assert done.code == 0, done.err
    with open(tmp_path / "training_step.csv") as file:
        rows = {line["part"]: line for line in csv.DictReader(file)}
    ms = {part: float(row["ms"]) for part, row in rows.items()}
    parts = [ms[name] for name in ("data", "search", "forward", "loss", "backward", "optimizer")]
    assert min(parts) > 0
    assert 0.5 < sum(parts) / ms["step"] < 2.0  # measured one after the other, maybe on a busy machine
    assert 0 < ms["networks"] < ms["step"]
    operations = {part: int(row["operations"]) for part, row in rows.items()}
    assert sum(operations[name] for name in PARTS) + operations["data"] == operations["step"]
    assert 0 < operations["networks"] < operations["forward"] + operations["backward"]


def test_blender_is_timed_on_what_it_made_only(tubes, tmp_path):
    done = in_process("benchmark", "measure=blender_time", f"measure.paths=[{tubes}]", f"folder={tmp_path}")
    assert done.code == 2
    assert "found no garments that Blender has simulated; expected those of src/generate.py data=garments" in done.err


def test_a_step_on_a_gpu_needs_one(tubes, tmp_path):
    done = in_process("benchmark", "model=mgn", "trainer=gpu", f"data.path={tubes}", f"folder={tmp_path}")
    assert done.code == 2
    assert done.err == "error: trainer.accelerator: found gpu, but PyTorch sees none here; use trainer=cpu\n"
