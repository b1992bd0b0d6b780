"""Training of simulators as users run it: every row trains and animates, can be continued, and says what is wrong."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
import torch

from drape.config.entry_point import CONF
from tests import garments
from tests.integration.conftest import program

ROWS = ["mgn", "layersnet", "mgn_s_phys", "mgn_s_phys_f", "hood", "mgn_s_eunet", "mgn_h_eunet"]
KILL = "+callbacks.kill={_target_: tests.integration.kill.KillAt, step: 5}"


@pytest.fixture(scope="module")
def tubes(tmp_path_factory) -> Path:
    return garments.write(tmp_path_factory.mktemp("garments") / "garments.h5")


def trained(path: Path, folder: Path, *overrides: str, **env: str):
    common = ["scale=smoke", "material=silk", "logger=csv", "evaluate=false"]
    common += [f"data.path={path}", f"hydra.run.dir={folder}"]
    return program("train", *common, *overrides, **env)


@pytest.fixture(scope="module", params=ROWS)
def run(request, tubes, tmp_path_factory) -> tuple[str, Path]:
    """A finished training of each row."""
    folder = tmp_path_factory.mktemp(request.param)
    done = trained(tubes, folder, f"model={request.param}", KILL)
    assert done.returncode == 0, done.stderr
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
        columns = next(csv.reader(file))
    assert {"val/error_mm", "val/inside_percent", "val/ms_per_frame"} <= set(columns)
    assert (folder / "figures" / "rollouts.png").stat().st_size > 5_000


def test_a_row_animates(run, tubes, tmp_path):
    row, folder = run
    checkpoint = folder / "checkpoints" / "last.ckpt"
    done = program(
        "evaluate", "simulator=neural", f"simulator.checkpoint={checkpoint}", f"data.path={tubes}",
        f"runs={tmp_path}", "sequences=1", "frames=3",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (found,) = tmp_path.rglob("metrics.json")
    record = json.loads(found.read_text())
    assert record["method"]["name"] == f"{row}_smoke_seed_0"
    assert record["method"]["training"]["parameters"] > 0
    assert 0 < record["metrics"]["error_mm/overall"] < 1000


@pytest.mark.parametrize("row", ["mgn_h_eunet"])
def test_killed_and_continued_is_as_never_killed(row, tubes, tmp_path):
    """Killed at iteration 5, continued from the checkpoint of iteration 4: the same parameters, bit for bit."""
    straight, broken = tmp_path / "straight", tmp_path / "broken"
    assert trained(tubes, straight, f"model={row}", KILL).returncode == 0
    assert trained(tubes, broken, f"model={row}", KILL, KILL="1").returncode == 9
    assert torch.load(broken / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] == 4
    assert trained(tubes, broken, f"model={row}", KILL).returncode == 0
    one, other = parameters(straight), parameters(broken)
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (("model=mgn_s_eunet", "datamodule.start=skined"), "found 'skined'; expected recorded or carried"),
        (("model=mgn_s_eunet", "training.updates=twice"), "expected step or rollout"),
        (("model=mgn_s_eunet", "scale.simulator.rollout_last=5"), "expected at least 7"),
        (("model=mgn", "ablation=no_bending"), "this ablation does not fit"),
        (("model=mgn_s_eunet", "optimizer.lr=1e30"), "training stopped at step"),
        (("model=mgn_h_eunet", "model.network.coarse_levels=3"), "schedule"),
    ],
)
def test_what_makes_no_sense_is_refused(overrides, told, tubes, tmp_path):
    done = trained(tubes, tmp_path, *overrides)
    assert done.returncode == 2, done.stderr
    assert told in done.stderr
    assert "Traceback" not in done.stderr


def test_the_checkpoint_of_an_energy_is_no_simulator(tubes, tmp_path):
    checkpoint = CONF.parent / "src/drape/checkpoints/eunet_garment.ckpt"
    done = program(
        "evaluate", "simulator=neural", f"simulator.checkpoint={checkpoint}", f"data.path={tubes}",
        f"runs={tmp_path}",
    )  # fmt: skip
    assert done.returncode == 2
    assert "found the checkpoint of an energy; expected one of a simulator" in done.stderr
