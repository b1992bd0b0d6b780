"""Base of all metrics of an energy: sums per fabric, in float64, that add up over batches and processes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor
from torchmetrics import Metric

from drape.data.windows import Window
from drape.energy.law.step_energies import StepEnergies
from drape.errors import DrapeError

OVERALL = "overall"
"""Stands where a fabric's name stands, for all fabrics together."""


class FabricMetric(Metric, ABC):
    """A torchmetrics metric of :class:`StepEnergies` with keys ``quantity_unit/fabric`` and ``quantity_unit/overall``.

    States are float64 sums over windows, vertices or edges, so the values depend neither on the size of the batches
    nor on how they were spread over processes. Fabrics without data have no key. ``update`` evaluates the step
    without keeping its graph: call it after the losses.

    Raises:
        DrapeError: no fabrics, repeated fabrics, or a fabric called "overall".
    """

    full_state_update = False
    higher_is_better = False

    def __init__(self, fabrics: Sequence[str]):
        super().__init__()
        self.fabrics = tuple(fabrics)
        if not fabrics or len(set(fabrics)) < len(fabrics) or OVERALL in fabrics:
            raise DrapeError(f"metrics: fabrics are {list(fabrics)}; expected different names, none of them {OVERALL}")

    @abstractmethod
    def update(self, step: StepEnergies) -> None:
        """Add one batch."""

    @abstractmethod
    def compute(self) -> dict[str, float]:
        """Values by key."""

    def add_sum(self, name: str, *shape: int) -> None:
        """A state ``(fabrics, *shape)`` that starts at zero and adds up over processes."""
        self.add_state(name, torch.zeros(len(self.fabrics), *shape, dtype=torch.float64), dist_reduce_fx="sum")

    def per_fabric(self, window: Window, per_mesh: Float[Tensor, " meshes"]) -> Float[Tensor, " fabrics"]:
        """Sum a quantity of the meshes over each fabric, in float64."""
        total = torch.zeros(len(self.fabrics), dtype=torch.float64, device=per_mesh.device)
        return total.index_add(0, window.fabric, per_mesh.detach().double())

    def means(self, key: str, total: Float[Tensor, " fabrics"], count: Float[Tensor, " fabrics"]) -> dict[str, float]:
        """``total / count`` per fabric, and of both summed over the fabrics."""
        names = (*self.fabrics, OVERALL)
        totals, counts = [*total.tolist(), total.sum().item()], [*count.tolist(), count.sum().item()]
        return {f"{key}/{name}": t / n for name, t, n in zip(names, totals, counts, strict=True) if n > 0}
