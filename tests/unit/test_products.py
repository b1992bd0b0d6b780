"""Products of matrices by another library have the bits of float32, or stay where they were."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from drape.errors import DrapeError
from drape.nets import products
from drape.training import run


@pytest.fixture(autouse=True)
def as_before():
    with products.products_of_training():
        torch.set_float32_matmul_precision("highest")
        yield


@pytest.mark.parametrize(
    ("rows", "inputs", "outputs"), [(5548, 128, 128), (3000, 10, 128), (1001, 64, 32), (128, 5548, 64)]
)
def test_products_keep_the_bits_of_float32(rows, inputs, outputs):
    products.multiply_by_onednn()
    generator = torch.Generator().manual_seed(0)
    a, b = (torch.randn(shape, generator=generator) for shape in ((rows, inputs), (inputs, outputs)))
    exact = a.double() @ b.double()
    assert ((a @ b - exact).abs().max() / exact.abs().max()).item() < 3e-6, "rounded to bfloat16 it is 2e-3"


def test_a_library_that_keeps_them_is_asked_from_now_on():
    assert products.multiply_by_onednn() == (torch.get_float32_matmul_precision() == "medium")


def test_a_library_that_rounds_is_not_asked_again(monkeypatch):
    monkeypatch.setattr(torch, "equal", lambda a, b: False)
    assert not products.multiply_by_onednn()
    assert torch.get_float32_matmul_precision() == "highest"


def test_what_comes_next_has_the_products_of_before(monkeypatch, tmp_path):
    """After a training that failed, too: a sweep goes on with its other runs."""

    def failing(*_: object) -> None:
        torch.set_float32_matmul_precision("medium")
        raise DrapeError("stopped")

    monkeypatch.setattr(run, "_train", failing)
    monkeypatch.setattr(run.conf, "check_config", lambda config: None)
    with pytest.raises(DrapeError, match="stopped"):
        run.train(OmegaConf.create(), tmp_path, {})
    assert torch.get_float32_matmul_precision() == "highest"


def test_weights_are_rounded_anew_after_an_update(monkeypatch, tmp_path):
    """Rollouts have several updates in one training step, graphs are replayed after updates: none is kept rounded."""
    torch.set_autocast_cache_enabled(True)
    layer, found = torch.nn.Linear(4, 1, bias=False), []

    def training(*_: object) -> Path:
        with torch.autocast("cpu", torch.bfloat16):  # as Lightning does around a training step
            for _ in range(2):
                found.append(layer(torch.ones(4)).detach().clone())
                layer.weight.data.zero_()
        return tmp_path

    monkeypatch.setattr(run, "_train", training)
    monkeypatch.setattr(run.conf, "check_config", lambda config: None)
    run.train(OmegaConf.create(), tmp_path, {})
    assert found[0].dtype == torch.bfloat16
    assert found[0] != 0
    assert found[1] == 0
    assert torch.is_autocast_cache_enabled()
