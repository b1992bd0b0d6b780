"""What every training does besides minimising."""

from __future__ import annotations

import time
from typing import Any

import lightning

from drape.data.windows import Window
from drape.energy.checkpoint import describe


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
    """Put the resolved config, versions and an evaluated example into every checkpoint (energy/checkpoint.py)."""

    def __init__(self, config: dict[str, Any], example: Window):
        self._config = config
        self._example = example

    def on_save_checkpoint(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Add the entry ``drape``."""
        example = self._example.to(pl_module.device)
        checkpoint["drape"] = describe(self._config, pl_module.energy, example)
