"""Tables as users make them: from a checkpoint, whole or not at all, and refused where they would be wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from drape.energy.law.baked.file import read_baked
from drape.energy.law.load_law import load_law
from tests.energies import PAPER, make_energy, write_checkpoint
from tests.integration.conftest import ROOT, Run, in_process

SHIPPED = ROOT / "src" / "drape" / "checkpoints" / "eunet_hinge.ckpt"


@pytest.fixture
def bake(monkeypatch, tmp_path):
    """``python src/bake.py path=<tmp_path>/law.npz overrides`` in this process."""
    monkeypatch.chdir(ROOT)
    return lambda *overrides: in_process("bake", f"path={tmp_path}/law.npz", f"hydra.run.dir={tmp_path}", *overrides)


def refused(done: Run, path: Path, sentence: str) -> None:
    assert done.code == 2, done.out
    assert sentence in done.err
    assert "Traceback" not in done.err
    assert not list(path.glob("*.npz"))


@pytest.mark.parametrize("fabric", ["silk", "denim"])
def test_the_law_that_comes_with_the_program(bake, tmp_path, fabric):
    """The table says what its certificate says on the screen, and what the checkpoint's network says."""
    done = bake(f"fabric={fabric}")
    assert done.code == 0, done.err
    table = read_baked(tmp_path / "law.npz")
    assert table.certificate.text() in done.out
    assert (table.fabric.name, table.certificate.fabric, table.certificate.checkpoint) == (fabric, fabric, SHIPPED.name)
    law, attributes = load_law(str(SHIPPED), table.fabric)
    assert torch.equal(table.attributes, attributes)
    q = torch.tensor([[1e-3, 0.1], [-0.05, -2.0]], dtype=torch.float64)
    torch.testing.assert_close(table.potential(q), law.potential(q), rtol=1e-3, atol=0.0)
    assert (table.damper, table.drag, table.face_area) == pytest.approx((law.damper, law.drag, law.face_area))


def test_mistakes_get_a_sentence(bake, tmp_path):
    refused(bake("table.step=8.0"), tmp_path, "from the network; expected at most")
    refused(bake("table.step=0.0"), tmp_path, "table.step: found 0.0; expected a number above 0")
    refused(bake("checkpoint=nowhere.ckpt"), tmp_path, "nowhere.ckpt: no such checkpoint")
    refused(bake(f"path={tmp_path}/law.txt"), tmp_path, "expected a name that ends in .npz")


def test_the_law_of_the_paper_is_not_baked(bake, tmp_path, cloth_batch):
    """It sees twist and bend, of which a table would have one dimension more; it runs by its networks."""
    write_checkpoint(tmp_path / "paper.ckpt", make_energy("mlp", "none").float(), PAPER, cloth_batch)
    done = bake(f"checkpoint={tmp_path}/paper.ckpt")
    refused(done, tmp_path, "found a law of the paper's (stretch, twist, bend); expected one of stretch and hinge")
