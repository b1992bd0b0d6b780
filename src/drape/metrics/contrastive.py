"""Share of small displacements of a vertex that lower the energy, where the true motion should be a minimum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.energy.law.step_energies import StepEnergies
from drape.metrics.fabric_metric import FabricMetric


@runtime_checkable
class VertexInequalities(Protocol):
    """Inequalities of the contrastive loss at a step."""

    def rise(self, step: StepEnergies) -> tuple[Int[Tensor, " disturbed"], Float[Tensor, " disturbed"]]:
        """Vertices of a fresh draw, and ``E(x_i + δ) - E(x_i)`` [J] of each."""


class ContrastiveViolations(FabricMetric):
    """Share of disturbed vertices with ``E(x_i + δ) < E(x_i)`` (paper, eq. 15), E and δ those of ``loss``.

    An energy whose gradient explains the motion has 0 where δ is not too large, an arbitrary gradient 0.5. Vertices
    and displacements are drawn from ``seed`` and the number of the batch; the generators of the training stay as they
    were. It is an estimate: other batches draw other displacements.
    """

    count: Tensor
    violated: Tensor

    def __init__(self, fabrics: Sequence[str], loss: VertexInequalities, seed: int = 0):
        super().__init__(fabrics)
        self.loss = loss
        self.seed = seed
        self.add_sum("count")
        self.add_sum("violated")

    def update(self, step: StepEnergies) -> None:
        window = step.window
        with torch.random.fork_rng([window.x.device] if window.x.is_cuda else []):
            torch.manual_seed(self.seed + self._update_count)
            vertices, rise = self.loss.rise(step)
        fabric = window.fabric[window.mesh.mesh_of_vertex[vertices]]
        self.count.index_add_(0, fabric, torch.ones_like(rise, dtype=torch.float64))
        self.violated.index_add_(0, fabric, (rise < 0).double())

    def compute(self) -> dict[str, float]:
        return self.means("violated_share", self.violated, self.count)
