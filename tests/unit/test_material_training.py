"""The training of EST on balances of forces that can be worked out by hand: means, splits, which material is which."""

from __future__ import annotations

import pytest
import torch
from torch.utils.data import DataLoader

from drape.energy.force_balance import ForceBalance, material_ratios
from drape.energy.phys_material import PhysMaterial, material_numbers
from drape.nets.material_net import MaterialNet
from drape.scene.material import ATTRIBUTES
from drape.training.material_data import FabricBalance, MaterialDataModule
from drape.training.material_training import MaterialTraining
from tests import garments


def balance(pull: float, attributes: torch.Tensor, vertices: int = 3) -> FabricBalance:
    """Weights along x, which a ratio μ/ρ of 1/``pull`` balances; λ and k do nothing."""
    columns = torch.zeros(4, vertices, 3, dtype=torch.float64)
    columns[0, :, 0], columns[1, :, 0] = 1.0, -pull
    return FabricBalance(attributes[None], ForceBalance(columns, torch.zeros(vertices, dtype=torch.long)))


@pytest.fixture
def data(tmp_path) -> MaterialDataModule:
    path = garments.write(tmp_path / "garments.h5", frames=8)
    return MaterialDataModule(str(path), ["silk"], 2, 5, 2, dict.fromkeys(ATTRIBUTES, 10.0), seed=0)


def test_the_loss_is_a_mean_over_vertices(monkeypatch):
    training, batch = MaterialTraining(MaterialNet().double()), balance(1e-5, torch.full((5,), 0.5).double(), 7)
    logged = {}
    monkeypatch.setattr(training, "log", lambda name, value, **_: logged.update({name: float(value)}))
    ratio = float(material_ratios(material_numbers(training.net(batch.attributes)))[0, 1].detach())
    expected = pytest.approx(abs(1.0 - 1e-5 * ratio), rel=1e-4)
    assert float(training.training_step(batch, 0).detach()) == expected
    assert logged["train/loss/force_balance"] == expected


def test_as_many_frames_of_each_split_are_drawn_as_were_asked_for(data, monkeypatch):
    """Two to train on, five to test on."""
    asked = []

    class Sampled:
        def __init__(self, file, split, count, *_):
            asked.append((split, count))

    monkeypatch.setattr("drape.training.material_data.SampledGarmentFrames", Sampled)
    monkeypatch.setattr("drape.training.material_data.material_loader", lambda *_: DataLoader([0]))
    for split in ("train", "test"):
        data.loader(split)
    assert asked == [("train", 2), ("test", 5)]


def test_residuals_are_those_of_the_test_split_and_fitted_is_by_the_other(data):
    """μ/ρ is 1e4 in training and would be 2e4 in the test split: half of the weight is left. Estimated is 2e4.

    HOOD's default has 23600/0.20022.
    """
    own = data.attributes["silk"]
    data._loaders = {name: DataLoader([balance(pull, own)]) for name, pull in (("train", 1e-4), ("test", 5e-5))}
    found = data.residuals({"silk": PhysMaterial(1.0, 2e4, 1.0, 1e-6)})["silk"]
    default = abs(1.0 - 5e-5 * 23600.0 / 0.20022)
    assert found == pytest.approx({"nothing": 1.0, "fitted": 0.5, "default": default, "estimated": 0.0}, abs=1e-6)
