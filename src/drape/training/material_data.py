"""Frames of recorded garments as balances of forces, for the training of EST."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, cast

import lightning
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from drape.data.garment_frames import GarmentFrames, SampledGarmentFrames
from drape.data.trajectories import open_dressed
from drape.energy.force_balance import ForceBalance, best_ratios, force_balance, material_ratios
from drape.energy.phys_material import PhysMaterial
from drape.errors import DrapeError
from drape.scene.material import attribute_vector

READ = 8
"""Garments that are read and judged at a time."""


class FabricBalance(NamedTuple):
    """A training batch: the attributes of the fabric of each garment, and its balance of forces."""

    attributes: Float[Tensor, "meshes attributes"]
    balance: ForceBalance


class MaterialDataModule(lightning.LightningDataModule):
    """Frames drawn from both splits; each is read once, when it is first asked for, and only its balance is kept.

    Args:
        path: file of recorded garments.
        fabrics: names of the fabrics to estimate.
        frames: to draw from the training split.
        test_frames: to draw from the test split.
        batch_size: garments in a batch.
        attribute_scales: divisors of the five attributes of a fabric.
        seed: of the draws.

    Raises:
        DrapeError: file missing or faulty, or a fabric that it does not have.
    """

    def __init__(
        self,
        path: str,
        fabrics: Sequence[str],
        frames: int,
        test_frames: int,
        batch_size: int,
        attribute_scales: Mapping[str, float],
        seed: int,
    ):
        super().__init__()
        self.file = open_dressed(path)
        unknown = [name for name in fabrics if name not in self.file.fabrics]
        if unknown:
            raise DrapeError(f"{path}: no fabric {', '.join(unknown)}; it has {', '.join(self.file.fabrics)}")
        self._counts, self._scales, self._seed = {"train": frames, "test": test_frames}, dict(attribute_scales), seed
        self._batch_size = batch_size
        self._loaders: dict[str, DataLoader] = {}
        vectors = {name: attribute_vector(self.file.materials[name], attribute_scales) for name in fabrics}
        self.attributes = {name: torch.tensor(vector, dtype=torch.float64) for name, vector in vectors.items()}

    def statistics(self) -> dict[str, float]:
        """None are needed."""
        return {}

    @property
    def num_judged(self) -> int:
        """Frames of the training split with vertices that can be judged."""
        return len(self._frames("train"))

    def _frames(self, split: str) -> list[FabricBalance]:
        return cast(list[FabricBalance], self.loader(split).dataset)

    def loader(self, split: str) -> DataLoader:
        """Batches of a split; see :func:`material_loader`."""
        if split not in self._loaders:
            count = self._counts[split]
            frames = SampledGarmentFrames(self.file, split, count, READ, self._scales, self._seed)
            self._loaders[split] = material_loader(frames, self._batch_size, self._seed)
        return self._loaders[split]

    def train_dataloader(self) -> DataLoader:
        return self.loader("train")

    def residuals(self, estimates: Mapping[str, PhysMaterial]) -> dict[str, dict[str, float]]:
        """Mean residual of the test split over the weight, by fabric.

        ``nothing``: without elasticity; ``default``: HOOD's material; ``fitted``: the closed form of the training
        split, :func:`best_ratios`; ``estimated``. A fabric without a frame is left out.
        """
        found = {}
        for name, estimate in estimates.items():
            train, test = (self._columns(split, name) for split in ("train", "test"))
            if train is None or test is None:
                continue
            numbers = torch.tensor([PhysMaterial.default(), estimate], dtype=torch.float64)
            ratios = {"nothing": torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64), "fitted": best_ratios(train)}
            ratios |= dict(zip(("default", "estimated"), material_ratios(numbers), strict=True))
            found[name] = {
                key: float(torch.einsum("i,ivx->vx", ratio, test).norm(dim=-1).mean()) for key, ratio in ratios.items()
            }
        return found

    def _columns(self, split: str, fabric: str) -> Tensor | None:
        own = self.attributes[fabric]
        columns = [one.balance.columns for one in self._frames(split) if torch.equal(one.attributes[0], own)]
        return torch.cat(columns, 1) if columns else None


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
    frames_of = cast("Dataset[FabricBalance]", judged)  # any sequence will do
    return DataLoader(frames_of, batch_size, shuffle=True, generator=order, collate_fn=_collated)


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
