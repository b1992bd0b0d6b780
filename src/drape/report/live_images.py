"""Energy maps and curves of a training so far, as images in its loggers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import lightning

from drape.report.energy_map import draw_energy_map, energy_of
from drape.report.logged_images import log_image

KEY = "figures/energy_map"
"""Of the image in the loggers; also where it lies in the run directory."""


class EnergyMapImages(lightning.Callback):
    """Draw the map of the energy being trained after each validation, a panel for each fabric.

    Args:
        fabrics: names; those that the training does not use are left out.
        folder: run directory; has the newest map in ``figures/energy_map.png``.
    """

    def __init__(self, fabrics: Sequence[str], folder: str):
        self._fabrics = tuple(fabrics)
        self._path = Path(folder) / f"{KEY}.png"

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
        log_image(trainer.loggers, KEY, self._path, trainer.global_step)
