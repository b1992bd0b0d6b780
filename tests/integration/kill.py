"""A callback that kills its own process, as a power cut would."""

from __future__ import annotations

import os

import lightning


class KillAt(lightning.Callback):
    """Exit without any cleaning up after ``step`` steps, if the environment variable ``KILL`` is set."""

    def __init__(self, step: int):
        self._step = step

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        if "KILL" in os.environ and trainer.global_step == self._step:
            os._exit(9)
