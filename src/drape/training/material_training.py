"""Train EST: which material of PHYS balances the forces in recorded frames of a fabric best."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import lightning
import torch
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor
from torch.utils.data import DataLoader

from drape.energy.force_balance import material_ratios
from drape.energy.law.checkpoint import FORMAT, versions
from drape.energy.phys_material import PhysMaterial, material_numbers
from drape.metrics.record import MaterialRecord
from drape.nets.material_net import MaterialNet
from drape.training.material_data import FabricBalance, MaterialDataModule


class MaterialTraining(lightning.LightningModule):
    """Minimises the mean of ``|m a - m g + ∂(StVK + bending)/∂x| / (m |g|)`` over vertices of recorded frames.

    The paper names no objective (docs/sources.md, Stated nowhere). This one asks what the simulators that PHYS trains
    are asked too: to balance forces. Of a frame only the vertices count that
    :func:`drape.energy.force_balance.force_balance` keeps; the residual is not squared, as a few violent vertices would
    outweigh all others. m is the estimated density times the area of a vertex. The equation is homogeneous in (ρ, μ, λ,
    k): only the ratios to the density can be identified, and the density itself is where the training leaves it. That
    is just as well: a fabric of the data weighs 0.15 to 1 kg for each vertex, about 100 kg/m² or more, far beyond
    HOOD's range; a garment of the same ratios moves the same, and the density fixes only the scale, which contact
    forces are measured against.

    Args:
        net: what is trained.
        learning_rate: of Adam in the first epoch.
        decay: factor of the learning rate from one epoch to the next.
    """

    RECORD = MaterialRecord.FILE
    """Name of the file that is left in the end."""

    def __init__(self, net: MaterialNet, learning_rate: float = 2e-4, decay: float = 0.5):
        super().__init__()
        self.net = net
        self._learning_rate = learning_rate
        self._decay = decay

    def training_step(self, batch: FabricBalance, batch_idx: int) -> Tensor:
        """The mean residual of one batch of :func:`material_loader`."""
        ratios = material_ratios(material_numbers(self.net(batch.attributes)))
        loss = batch.balance.residuals(ratios).mean()
        self.log("train/loss/force_balance", loss.detach(), batch_size=len(batch.attributes))
        return loss

    @staticmethod
    def supplied(_: MaterialDataModule) -> dict[str, object]:
        """Nothing: the network reads the attributes of the batches."""
        return {}

    def described(
        self, config: dict[str, Any], choices: Mapping[str, str], data: MaterialDataModule, seconds: float
    ) -> dict[str, Any]:
        """Self-description of a checkpoint."""
        return {"format": FORMAT, "config": config, "versions": versions()}

    def finish(
        self, config: dict[str, Any], choices: Mapping[str, str], data: MaterialDataModule, seconds: float
    ) -> MaterialRecord:
        """The materials that the network makes of the fabrics, and what they leave of the forces in the test split."""
        with torch.no_grad():
            positions = {name: self.net(vector[None])[0] for name, vector in data.attributes.items()}
        return MaterialRecord(
            estimates={name: PhysMaterial.at(place)._asdict() for name, place in positions.items()},
            residuals=data.residuals({name: PhysMaterial.at(place) for name, place in positions.items()}),
            provenance={
                "command": choices["command"],
                "data": config["data"]["path"],
                "seed": config["seed"],
                "scale": choices["scale"],
                "frames": data.num_judged,
                "steps": self.global_step,
                "seconds": round(seconds, 1),
                "versions": versions(),
            },
        )

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """Adam, its rate decayed with every epoch."""
        optimizer = torch.optim.Adam(self.net.parameters(), lr=self._learning_rate)
        return {"optimizer": optimizer, "lr_scheduler": torch.optim.lr_scheduler.ExponentialLR(optimizer, self._decay)}


def fit(
    loader: DataLoader, epochs: int = 4, learning_rate: float = 2e-4, decay: float = 0.5, seed: int = 0
) -> MaterialNet:
    """A network trained on the batches of ``loader`` (the paper: 4 epochs of 10 000 frames in batches of 4)."""
    torch.manual_seed(seed)
    training = MaterialTraining(MaterialNet(), learning_rate, decay)
    quiet: dict[str, Any] = {"logger": False, "enable_checkpointing": False, "enable_progress_bar": False}
    trainer = lightning.Trainer(accelerator="cpu", max_epochs=epochs, enable_model_summary=False, **quiet)
    trainer.fit(training, loader)
    return training.net
