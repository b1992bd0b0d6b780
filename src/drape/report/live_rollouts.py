"""Recorded garments as a simulator in training animates them: images in its loggers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import lightning

from drape.metrics.rollout_scores import ScoredRollout
from drape.report.logged_images import log_image
from drape.report.rollout_sheet import draw_rollout_sheet

KEY = "figures/rollouts"
"""Of the image in the loggers; also where it lies in the run directory."""


class RolloutImages(lightning.Callback):
    """Draw the sequences that were watched after each validation, recorded above predicted, at a few times.

    Args:
        folder: run directory; has the newest picture in ``figures/rollouts.png``.
    """

    def __init__(self, folder: str):
        self._path = Path(folder) / f"{KEY}.png"

    def on_validation_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Draw, save, and log to every logger that takes images."""
        session: Any = trainer  # Lightning does not say what it has while it fits
        watched = cast(Sequence[ScoredRollout], pl_module.watched)
        if session.fast_dev_run or not trainer.is_global_zero or not watched:
            return
        draw_rollout_sheet(watched, self._path)
        log_image(trainer.loggers, KEY, self._path, trainer.global_step)
