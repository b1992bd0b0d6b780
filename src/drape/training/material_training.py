"""Train EST: which material of PHYS balances the forces in recorded frames of a fabric best."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import lightning
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import DataLoader

from drape.data.garment_frames import GarmentFrames
from drape.energy.force_balance import ForceBalance, force_balance, material_ratios
from drape.energy.phys_material import material_numbers
from drape.errors import DrapeError
from drape.nets.material_net import MaterialNet


class FabricBalance(NamedTuple):
    """A training batch: the attributes of the fabric of each garment, and its balance of forces."""

    attributes: Float[Tensor, "meshes attributes"]
    balance: ForceBalance


class MaterialTraining(lightning.LightningModule):
    """Minimises the mean of ``|m a - m g + ∂(StVK + bending)/∂x| / (m |g|)`` over vertices of recorded frames.

    The paper names no objective (FACTS 8). This one asks what the simulators that PHYS trains are asked too: to balance
    forces. Of a frame only the vertices count that :func:`drape.energy.force_balance.force_balance` keeps; the
    residual is not squared, as a few violent vertices would outweigh all others. m is the estimated density times the
    area of a vertex. The equation is homogeneous in (ρ, μ, λ, k): only the ratios to the density can be identified, and
    the density itself is where the training leaves it. That is just as well: a fabric of the data weighs 0.15 to 1 kg
    for each vertex, about 100 kg/m² or more, far beyond HOOD's range; a garment of the same ratios moves the same, and
    the density fixes only the scale, which contact forces are measured against.

    Args:
        net: what is trained.
        learning_rate: of Adam in the first epoch.
        decay: factor of the learning rate from one epoch to the next.
    """

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

    def configure_optimizers(self) -> dict:
        """Adam, its rate decayed with every epoch."""
        optimizer = torch.optim.Adam(self.net.parameters(), lr=self._learning_rate)
        return {"optimizer": optimizer, "lr_scheduler": torch.optim.lr_scheduler.ExponentialLR(optimizer, self._decay)}


def material_loader(frames: Iterable[GarmentFrames], batch_size: int, seed: int) -> DataLoader:
    """Batches for :class:`MaterialTraining`, in another order in every epoch; each frame is read once, here.

    Frames in which no vertex can be judged are left out.

    Raises:
        DrapeError: there is no other frame.
    """
    judged = [one for batch in frames for one in _garments(batch) if len(one.balance.mesh_of_vertex)]
    if not judged:
        raise DrapeError(
            "material training: found no vertex that is free and away from contact in any frame; expected some to "
            "learn from; use looser garments, or more frames"
        )
    order = torch.Generator().manual_seed(seed)
    return DataLoader(judged, batch_size, shuffle=True, generator=order, collate_fn=_collated)


def _garments(frames: GarmentFrames) -> list[FabricBalance]:
    columns, owner = force_balance(frames)
    counts = owner.bincount(minlength=frames.window.mesh.num_meshes).tolist()
    parts = zip(frames.window.attributes, columns.split(counts, 1), strict=True)
    return [FabricBalance(a[None], ForceBalance(c, owner.new_zeros(c.shape[1]))) for a, c in parts]


def _collated(garments: list[FabricBalance]) -> FabricBalance:
    columns = [one.balance.columns for one in garments]
    sizes = torch.tensor([part.shape[1] for part in columns])
    balance = ForceBalance(torch.cat(columns, 1), torch.arange(len(garments)).repeat_interleave(sizes))
    return FabricBalance(torch.cat([one.attributes for one in garments]), balance)


def fit(
    loader: DataLoader, epochs: int = 4, learning_rate: float = 2e-4, decay: float = 0.5, seed: int = 0
) -> MaterialNet:
    """A network trained on the batches of ``loader`` (the paper: 4 epochs of 10 000 frames in batches of 4)."""
    torch.manual_seed(seed)
    training = MaterialTraining(MaterialNet(), learning_rate, decay)
    quiet = {"logger": False, "enable_checkpointing": False, "enable_progress_bar": False}
    trainer = lightning.Trainer(accelerator="cpu", max_epochs=epochs, enable_model_summary=False, **quiet)
    trainer.fit(training, loader)
    return training.net
