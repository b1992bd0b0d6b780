"""Learn an energy from trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import lightning
import numpy as np
import torch
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor, nn
from torchmetrics import MetricCollection

from drape.data.datamodule import TrajectoryDataModule
from drape.data.windows import Window
from drape.energy.law.checkpoint import describe, versions
from drape.energy.law.eunet import EUNet
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.law.step_energies import StepEnergies
from drape.errors import DrapeError
from drape.loss.term import LossTerm, loss_values
from drape.metrics import record
from drape.metrics.fabric_metric import FabricMetric
from drape.metrics.family import energy_metrics
from drape.nets.products import multiply_by_onednn
from drape.training.captured_step import CHECKED_EVERY, CapturedStep
from drape.training.schedule import Schedule

LAW_WINDOWS = 1024
"""Training windows that the spring-hinge law is fitted on, evenly spaced."""


class EnergyTraining(lightning.LightningModule):
    """Minimises ``Σ weight · term`` over the parameters of ``energy``; wiring only.

    Args:
        energy: the energy to learn.
        loss: terms by name; the names are the log keys ``train/loss/<name>``.
        optimizer: makes the optimiser from the parameters.
        schedule: learning rate over the progress of the training.
        metrics: make those of validation and test, logged as ``val/...`` and ``test/...``.
        known: what they may ask of the data; see :func:`drape.metrics.family.energy_metrics`.
        seed: random disturbances depend on it and on the number of the step only.

    Raises:
        DrapeError: no loss term, or a term that is not finite (the term and the step are named).
    """

    RECORD = record.FILE
    """Name of the file that is left in the end."""

    def __init__(
        self,
        energy: EUNet,
        loss: Mapping[str, LossTerm],
        optimizer: Callable[..., torch.optim.Optimizer],
        schedule: Schedule,
        metrics: Mapping[str, Callable[..., FabricMetric]],
        known: Mapping[str, object],
        seed: int,
    ):
        super().__init__()
        if not loss:
            raise DrapeError("loss: no term is left to train on; choose one, for example loss/energy_balance=squared")
        self.energy = energy
        self.loss = nn.ModuleDict(loss)
        self.val_metrics = energy_metrics(metrics, known)
        self.test_metrics = self.val_metrics.clone()
        self._make_optimizer = optimizer
        self._schedule = schedule
        self._seed = seed
        self._captured: CapturedStep | None = None
        self._replayed = False
        """Whether the last step was a replay, which leaves the slopes of the parameters behind."""

    @staticmethod
    def supplied(data: TrajectoryDataModule) -> dict[str, object]:
        """Arguments of the constructor from the data: those that metrics may ask for."""
        law = SpringHingeLaw.fit(data.windows_apart(LAW_WINDOWS, data.eval_batch_size, ()), len(data.file.fabrics))
        tension = {name: float(material["tension_stiffness"]) for name, material in data.file.materials.items()}
        return {"known": {"fabrics": data.file.fabrics, "tension": tension, "law": law}}

    def described(
        self, config: dict[str, Any], choices: Mapping[str, str], data: TrajectoryDataModule, seconds: float
    ) -> dict[str, Any]:
        """Self-description of a checkpoint; its example is the first window of validation."""
        return describe(config, self.energy, data.windows(data.validation_sequences, np.arange(1)).to(self.device))

    def on_fit_start(self) -> None:
        """See :func:`multiply_by_onednn`."""
        if self.device.type == "cpu":
            multiply_by_onednn()

    def on_train_batch_start(self, batch: Window, batch_idx: int) -> None:
        """Seed the disturbances, so that a resumed training draws what the uninterrupted one would."""
        torch.manual_seed((self._seed * 1_000_003 + self.global_step) * 64 + self.global_rank)

    def training_step(self, window: Window, batch_idx: int) -> Tensor:
        """The weighted sum of the loss terms of one window; on a GPU, its slopes as well."""
        captured = self._captured if self._captures(window) else None
        self._replayed = captured is not None
        values = self.losses(window) if captured is None else captured.replay(window)
        if not window.x.is_cuda or (self.global_step + 1) % CHECKED_EVERY == 0:
            self._check(values)
        logged = {f"train/loss/{name}": value.detach() for name, value in values.items()}
        self.log_dict(logged, batch_size=window.mesh.num_meshes)
        return values["total"]

    def losses(self, window: Window) -> dict[str, Tensor]:
        """The loss terms by name, and their weighted sum ``total``."""
        return loss_values(self.energy, self.loss, window)

    def _captures(self, window: Window) -> bool:
        """Whether this window is replayed: one process, slopes of one batch, the mesh of the first window."""
        if not window.x.is_cuda or self.trainer.world_size > 1 or self.trainer.accumulate_grad_batches > 1:
            return False
        if self._captured is None:
            self._captured = CapturedStep(self.losses, list(self.energy.parameters()), window)
            self.on_train_batch_start(window, 0)  # the capture has drawn disturbances of its own
        return self._captured.fits(window)

    def _check(self, values: Mapping[str, Tensor]) -> None:
        for name, value in values.items():
            if not torch.isfinite(value):
                raise DrapeError(
                    f"training stopped at step {self.global_step}: loss term {name} is {float(value)}; the last "
                    "checkpoint is from before; lower the learning rate or look at the data"
                )

    def backward(self, loss: Tensor, *args: Any, **kwargs: Any) -> None:
        """Nothing after a replay."""
        if not self._replayed:
            super().backward(loss, *args, **kwargs)

    def optimizer_zero_grad(self, epoch: int, batch_idx: int, optimizer: torch.optim.Optimizer) -> None:
        """Nothing after a replay, which replaces the slopes."""
        if not self._replayed:
            super().optimizer_zero_grad(epoch, batch_idx, optimizer)

    def validation_step(self, window: Window, batch_idx: int) -> None:
        """Update the metrics."""
        self._evaluate(window, self.val_metrics)

    def test_step(self, window: Window, batch_idx: int) -> None:
        """Update the metrics."""
        self._evaluate(window, self.test_metrics)

    def on_validation_epoch_end(self) -> None:
        """Log the metrics."""
        self._report("val", self.val_metrics)

    def on_test_epoch_end(self) -> None:
        """Log the metrics."""
        self._report("test", self.test_metrics)

    def _evaluate(self, window: Window, metrics: MetricCollection) -> None:
        step = StepEnergies(self.energy, window, training=False)
        for metric in metrics.values():
            metric.update(step)

    def _report(self, stage: str, metrics: MetricCollection) -> None:
        for metric in metrics.values():
            self.log_dict({f"{stage}/{name}": value for name, value in metric.compute().items()})
            metric.reset()

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """The optimiser, and the schedule stepped with every batch."""
        optimizer = self._make_optimizer(self.energy.parameters())
        total = self.trainer.estimated_stepping_batches
        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: self._schedule(step / total))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def finish(
        self, config: dict[str, Any], choices: Mapping[str, str], data: TrajectoryDataModule, seconds: float
    ) -> record.RunRecord:
        """Test, and what there is to say of the training afterwards."""
        results = self.trainer.test(self, data, verbose=False)[0]
        return record.RunRecord(
            model=choices["model"],
            label=choices["label"],
            ablation=choices["ablation"],
            seed=config["seed"],
            variant={name: choices[name] for name in record.VARIANT if name in choices},
            setting={
                "data": config["data"]["name"],
                "material": choices["material"],
                "scale": choices["scale"],
                "width": config["scale"]["width"],
                "steps": self.global_step,
            },
            metrics={name.removeprefix("test/"): float(value) for name, value in results.items()},
            provenance={
                "command": choices["command"],
                "data": config["data"]["path"],
                "train_sequences": len(data.train_sequences),
                "test_sequences": len(data.test_sequences),
                "seconds": round(seconds, 1),
                "parameters": sum(p.numel() for p in self.energy.parameters()),
                "versions": versions(),
            },
        )
