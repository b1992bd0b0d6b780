"""Callbacks of every training: a stopwatch, and a description of itself in each checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import lightning


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
