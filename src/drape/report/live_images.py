"""Images of a training so far in its loggers: energy maps, and recorded garments as a simulator animates them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, cast

import lightning
from lightning.pytorch.loggers import Logger, TensorBoardLogger, WandbLogger
from matplotlib.image import imread

from drape.metrics.rollout_scores import ScoredRollout
from drape.report.energy_map import draw_energy_map, energy_of
from drape.report.rollout_sheet import draw_rollout_sheet

ENERGY_MAP, ROLLOUTS = "figures/energy_map", "figures/rollouts"
"""Of the images in the loggers; also where they lie in the run directory."""


class EnergyMapImages(lightning.Callback):
    """Draw the map of the energy being trained after each validation, a panel for each fabric.

    Args:
        fabrics: names; those that the training does not use are left out.
        folder: run directory; has the newest map in ``figures/energy_map.png``.
    """

    def __init__(self, fabrics: Sequence[str], folder: str):
        self._fabrics = tuple(fabrics)
        self._path = Path(folder) / f"{ENERGY_MAP}.png"

    def on_validation_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Draw, save, and log to every logger that takes images."""
        session: Any = trainer  # Lightning does not say what it has while it fits
        data, module = session.datamodule, cast(Any, pl_module)
        fabrics = {name: data.attributes_of(name) for name in self._fabrics if name in data.fabrics}
        if session.fast_dev_run or not trainer.is_global_zero or not fabrics:
            return
        attributes = {name: vector.to(pl_module.device) for name, vector in fabrics.items()}
        energies = {f"step {trainer.global_step}": energy_of(module.energy.potential)}
        draw_energy_map(energies, attributes, self._path)
        log_image(trainer.loggers, ENERGY_MAP, self._path, trainer.global_step)


class RolloutImages(lightning.Callback):
    """Draw the sequences that were watched after each validation, recorded above predicted, at a few times.

    Args:
        folder: run directory; has the newest picture in ``figures/rollouts.png``.
    """

    def __init__(self, folder: str):
        self._path = Path(folder) / f"{ROLLOUTS}.png"

    def on_validation_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Draw, save, and log to every logger that takes images."""
        session: Any = trainer  # Lightning does not say what it has while it fits
        watched = cast(Sequence[ScoredRollout], pl_module.watched)
        if session.fast_dev_run or not trainer.is_global_zero or not watched:
            return
        draw_rollout_sheet(watched, self._path)
        log_image(trainer.loggers, ROLLOUTS, self._path, trainer.global_step)


def log_image(loggers: Iterable[Logger], key: str, path: Path, step: int) -> None:
    """Send the PNG at ``path`` to TensorBoard and W&B, those of them that are among ``loggers``, under ``key``."""
    for logger in loggers:
        if isinstance(logger, TensorBoardLogger):
            logger.experiment.add_image(key, imread(path)[..., :3], step, dataformats="HWC")
        elif isinstance(logger, WandbLogger):
            logger.log_image(key, [str(path)], step=step)
