"""No file runs code: what a stored config may build, and that nothing is imported or called before it is checked."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import pytest
import torch
import yaml
from omegaconf import OmegaConf

from drape.config.from_file import build_from_file
from drape.energy.law.checkpoint import load_energy
from drape.errors import DrapeError
from drape.report.stability import BUILT
from drape.simulators.neural.checkpoint import load_simulator
from tests.energies import PAPER, make_energy, write_checkpoint

PLANTS = {
    "touch": {"_target_": "pathlib.Path.touch", "_args_": ["{mark}"]},
    "mkdir": {"_target_": "os.mkdir", "path": "{mark}"},
    "system": {"_target_": "os.system", "command": "touch {mark}"},
    "exec": {"_target_": "builtins.exec", "_args_": ["open('{mark}', 'w')"]},
    "open": {"_target_": "builtins.open", "file": "{mark}", "mode": "w"},
    "save": {"_target_": "torch.save", "obj": 1, "f": "{mark}"},
    "load": {"_target_": "torch.load", "f": "{mark}", "weights_only": False},
    "again": {"_target_": "hydra.utils.instantiate", "config": {"_target_": "os.mkdir", "path": "{mark}"}},
    "own": {"_target_": "drape.data.whole_file.whole_file", "path": "{mark}"},
    "logger": {"_target_": "lightning.pytorch.loggers.CSVLogger", "save_dir": "{mark}"},
    "module": {"_target_": "antigravity.fly"},
    "partial": {"_target_": "functools.partial", "_args_": ["os.mkdir", "{mark}"], "_partial_": True},
    "resolver": {"_target_": "drape.energy.law.eunet.EUNet", "potential": "${oc.env:HOME}"},
    "estimates": {"_target_": "drape.energy.law.eunet.EUNet", "potential": "${estimates:{mark}}"},
    "recursive": {"_target_": "drape.energy.law.eunet.EUNet", "_recursive_": False, "potential": None},
    "name": {"_target_": "${oc.env:HOME}"},
    "key": {"_target_": "drape.energy.law.eunet.EUNet", "${oc.env:HOME}": 1},
    "type": {"_target_": ["os.mkdir"]},
}  # fmt: skip
"""Harmless ones that leave the file ``{mark}`` behind, or read what is none of a file's business."""


def planted(plant: object, mark: Path) -> object:
    if isinstance(plant, dict):
        return {planted(key, mark): planted(value, mark) for key, value in plant.items()}
    if isinstance(plant, list):
        return [planted(value, mark) for value in plant]
    return plant.replace("{mark}", str(mark)) if isinstance(plant, str) else plant


def places(tree: dict) -> list[dict]:
    """The tree with a hole ``None`` at the root, at a nested object, and in a list."""
    nested = copy.deepcopy(tree)
    nested["potential"]["net"]["width"] = None
    listed = copy.deepcopy(tree) | {"dissipation": [None]}
    return [None, copy.deepcopy(tree) | {"potential": None}, nested, listed]


def filled(tree: object, plant: object) -> object:
    if tree is None:
        return plant
    if isinstance(tree, dict):
        return {key: filled(value, plant) for key, value in tree.items()}
    return [filled(value, plant) for value in tree] if isinstance(tree, list) else tree


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory, cloth_batch) -> dict:
    torch.manual_seed(0)
    energy, path = make_energy("mlp", "none").float(), tmp_path_factory.mktemp("whole") / "whole.ckpt"
    write_checkpoint(path, energy, PAPER, cloth_batch)
    return torch.load(path, weights_only=True)


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("place", range(len(places(PAPER))))
def test_nothing_is_called(name, place, tmp_path: Path):
    tree = filled(places(PAPER)[place], planted(PLANTS[name], tmp_path / "mark"))
    with pytest.raises(DrapeError, match=r"^a\.ckpt: model.*; the file was written by another"):
        build_from_file(tree, ("model", "net"), "a.ckpt: model")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", PLANTS)
def test_no_checkpoint_runs_code(name, checkpoint, tmp_path: Path):
    content, mark = dict(checkpoint), tmp_path / "mark"
    plant = planted(PLANTS[name], mark)
    content["drape"] = checkpoint["drape"] | {"config": {"model": plant}}
    content["drape"]["simulator"] = {"network": plant, "cloths": plant}
    torch.save(content, tmp_path / "planted.ckpt")
    for load in (load_energy, load_simulator):
        with pytest.raises(DrapeError, match=r"planted\.ckpt: "):
            load(tmp_path / "planted.ckpt")
    assert not mark.exists()


@pytest.mark.parametrize("name", PLANTS)
def test_no_config_of_an_animation_runs_code(name, tmp_path: Path):
    made = yaml.safe_load(yaml.safe_dump({"scene": planted(PLANTS[name], tmp_path / "mark")}))
    with pytest.raises(DrapeError):
        build_from_file(made["scene"], BUILT, "animation.h5: config.scene")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", PLANTS)
def test_no_estimates_run_code(name, tmp_path: Path):
    mark, path = tmp_path / "mark", tmp_path / "estimates.json"
    path.write_text(json.dumps({"estimates": {"silk": planted(PLANTS[name], mark)}}))
    with pytest.raises(Exception, match="expected the estimates.json"):
        OmegaConf.to_container(OmegaConf.create({"a": f"${{estimates:{path}}}"}), resolve=True)
    path.write_text(json.dumps({"estimates": {"${oc.env:HOME}": {"density": 1.0}}}))
    with pytest.raises(Exception, match="found what is no name"):
        OmegaConf.to_container(OmegaConf.create({"a": f"${{estimates:{path}}}"}), resolve=True)
    assert not mark.exists()


def test_what_this_program_stores_is_built(checkpoint, tmp_path: Path):
    torch.save(checkpoint, tmp_path / "whole.ckpt")
    assert load_energy(tmp_path / "whole.ckpt").potential.stretch_scale == 0.01


def test_yaml_that_grows_without_end():
    tree: list = [0] * 10
    for _ in range(18):
        tree = [tree] * 10
    with pytest.raises(DrapeError, match="more than 20 levels or 10000 values"):
        build_from_file({"_target_": "drape.energy.law.eunet.EUNet", "potential": tree}, ("model",), "a")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"stretch_scale": "wide"}, "model.potential.stretch_scale: found 'wide'"),
        ({"stretch": 1.0}, "MLPPotential has no argument 'stretch'"),
    ],
)
def test_arguments_are_checked_as_those_of_a_command(change, sentence):
    with pytest.raises(DrapeError, match=sentence):
        build_from_file(PAPER | {"potential": PAPER["potential"] | change}, ("model", "net"), "a.ckpt: model")
