"""What every training does besides minimising."""

from __future__ import annotations

from typing import Any

import lightning

from drape.data.windows import Window
from drape.energy.checkpoint import describe


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
