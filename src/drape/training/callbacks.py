"""Callbacks of every training: progress, a stopwatch, and a description of itself in each checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import lightning
from lightning.pytorch.callbacks import TQDMProgressBar


class ProgressBar(TQDMProgressBar):
    """Lightning's bar, right as well where a training goes on in the middle of an epoch.

    Lightning announces that to nobody: its own bar has no total until the next epoch, and counts steps of before into
    the steps per second.
    """

    def on_train_start(self, trainer: lightning.Trainer, *args: Any) -> None:
        """Begin where the epoch was interrupted."""
        super().on_train_start(trainer, *args)
        if trainer.global_step:
            self.on_train_epoch_start(trainer)
            bar, batches = self.train_progress_bar, trainer.num_training_batches
            bar.initial = bar.n = int((trainer.fit_loop.batch_idx + 1) % batches)
            bar.total = bar.total and min(bar.total + bar.n, batches)


class Stopwatch(lightning.Callback):
    """Seconds of training, those before an interruption included."""

    def __init__(self) -> None:
        self._before = 0.0
        self._began = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Time trained so far [s]."""
        return self._before + time.perf_counter() - self._began

    def on_train_start(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Start counting."""
        self._began = time.perf_counter()

    def state_dict(self) -> dict[str, float]:
        """For the checkpoint."""
        return {"seconds": self.seconds}

    def load_state_dict(self, state_dict: dict[str, float]) -> None:
        """Go on counting from there."""
        self._before = state_dict["seconds"]


class SelfDescription(lightning.Callback):
    """Put what ``describe`` returns, plain containers, into every checkpoint: its entry ``drape``."""

    def __init__(self, describe: Callable[[], dict[str, Any]]):
        self._describe = describe

    def on_save_checkpoint(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Add the entry."""
        checkpoint["drape"] = self._describe()
