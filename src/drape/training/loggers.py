"""Loggers of a training: each gets the resolved config, and keeps what it wrote before an interruption."""

from __future__ import annotations

import uuid
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger, TensorBoardLogger, WandbLogger
from lightning.pytorch.utilities import rank_zero_only
from omegaconf import OmegaConf

from drape import config as conf
from drape.training import metrics_csv

WANDB_ID = "wandb_id.txt"
"""In the run directory: what Weights & Biases calls the run."""


def open_loggers(config: dict[str, Any], folder: Path) -> list[Logger]:
    """Build the loggers of ``config``, which is resolved, in the run directory ``folder``, and log the config.

    With ``fast_dev_run`` they stay silent and write nothing.
    """
    loggers = [conf.instantiate(OmegaConf.create(_continued(node, folder))) for node in config["logger"].values()]
    if not config["trainer"].get("fast_dev_run"):
        rank_zero_only(metrics_csv.set_aside)(folder / metrics_csv.FILE)
        for logger in loggers:
            logger.log_hyperparams(config)
            if isinstance(logger, TensorBoardLogger):  # shows of these only what comes with a metric
                logger.experiment.add_text("config", f"```yaml\n{OmegaConf.to_yaml(OmegaConf.create(config))}```", 0)
    return loggers


def _continued(node: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Give Weights & Biases the same name for all parts of a training, so that they are one run."""
    if not node["_target_"].endswith(".WandbLogger") or node.get("id"):
        return node
    path = folder / WANDB_ID
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(uuid.uuid4().hex[:12], encoding="utf-8")
    return node | {"id": path.read_text(encoding="utf-8").strip(), "resume": "allow"}


def close_loggers(loggers: Iterable[Logger]) -> None:
    """End what would go on in the next training of a multirun."""
    if any(isinstance(logger, WandbLogger) for logger in loggers):
        import wandb

        wandb.finish()
