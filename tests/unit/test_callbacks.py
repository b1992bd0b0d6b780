"""Callbacks of every training."""

from __future__ import annotations

from pathlib import Path

import lightning
import torch
from lightning.pytorch.callbacks import ModelCheckpoint

from drape.training.callbacks import ProgressBar

BATCHES = 6


class Line(lightning.LightningModule):
    """One number, and the bar at each of its steps: epoch, ``n``, ``initial``, ``total``."""

    def __init__(self) -> None:
        super().__init__()
        self.slope = torch.nn.Parameter(torch.ones(()))
        self.seen: list[tuple[str, int, int, int | None]] = []

    def training_step(self, batch: torch.Tensor) -> torch.Tensor:
        bar = self.trainer.progress_bar_callback.train_progress_bar
        self.seen.append((bar.desc, bar.n, bar.initial, bar.total))
        return (self.slope * batch).square().sum()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), 0.1)


def trained(folder: Path, steps: int, checkpoint: Path | None = None) -> list[tuple[str, int, int, int | None]]:
    """What the bar said while a line was trained up to so many steps; ``last.ckpt`` is left in ``folder``."""
    kept = ModelCheckpoint(folder, every_n_train_steps=1, save_last=True)
    trainer = lightning.Trainer(
        max_steps=steps, callbacks=[ProgressBar(refresh_rate=1), kept], logger=False, accelerator="cpu",
        enable_model_summary=False,
    )  # fmt: skip
    line = Line()
    trainer.fit(line, torch.utils.data.DataLoader(torch.ones(BATCHES)), ckpt_path=checkpoint, weights_only=True)
    return line.seen


def test_the_bar_goes_on_where_an_epoch_was_interrupted(tmp_path: Path):
    assert trained(tmp_path, 8)[-1] == ("Epoch 1: ", 1, 0, 2)
    first, *_, last = trained(tmp_path, 13, tmp_path / "last.ckpt")
    assert first == ("Epoch 1: ", 2, 2, BATCHES)
    assert last == ("Epoch 2: ", 0, 0, 1)


def test_the_bar_of_a_training_that_ended_with_an_epoch_begins_the_next_one(tmp_path: Path):
    trained(tmp_path, BATCHES)
    assert trained(tmp_path, 8, tmp_path / "last.ckpt") == [("Epoch 1: ", k, 0, 2) for k in range(2)]
