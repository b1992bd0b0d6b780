"""Images in the loggers that take some."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lightning.pytorch.loggers import Logger, TensorBoardLogger, WandbLogger
from matplotlib.image import imread


def log_image(loggers: Iterable[Logger], key: str, path: Path, step: int) -> None:
    """Send the PNG at ``path`` to TensorBoard and W&B, those of them that are among ``loggers``, under ``key``."""
    for logger in loggers:
        if isinstance(logger, TensorBoardLogger):
            logger.experiment.add_image(key, imread(path)[..., :3], step, dataformats="HWC")
        elif isinstance(logger, WandbLogger):
            logger.log_image(key, [str(path)], step=step)
