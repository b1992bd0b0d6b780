"""Loggers of a training: each gets the resolved config, and keeps what it wrote before an interruption."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger, TensorBoardLogger, WandbLogger
from lightning.pytorch.utilities import rank_zero_only
from omegaconf import OmegaConf

from drape import config as conf
from drape.training import metrics_csv


def open_loggers(config: dict[str, Any], folder: Path) -> list[Logger]:
    """Build the loggers of ``config``, which is resolved, in the run directory ``folder``, and log the config.

    With ``fast_dev_run`` they stay silent and write nothing.
    """
    loggers = [conf.instantiate(OmegaConf.create(node)) for node in config["logger"].values()]
    if not config["trainer"].get("fast_dev_run"):
        rank_zero_only(metrics_csv.set_aside)(folder / metrics_csv.FILE)
        for logger in loggers:
            logger.log_hyperparams(config)
            if isinstance(logger, TensorBoardLogger):  # shows of these only what comes with a metric
                logger.experiment.add_text("config", f"```yaml\n{OmegaConf.to_yaml(OmegaConf.create(config))}```", 0)
    return loggers


def close_loggers(loggers: Iterable[Logger]) -> None:
    """End what would go on in the next training of a multirun."""
    if any(isinstance(logger, WandbLogger) for logger in loggers):
        import wandb

        wandb.finish()
