"""Predicted vertices that are inside the body or too near to it."""

from __future__ import annotations

from torch import Tensor

from drape.geometry.fixed_size import counted
from drape.loss.prediction import Prediction, PredictionLoss


class Collision(PredictionLoss):
    """Mean of ``(max(thickness - d, 0) / thickness)²`` over the vertices with d below ``thickness`` (LayersNet's loss).

    d is the signed distance at t + dt from the plane of the face of the body that was nearest at t, as in
    :class:`drape.energy.terms.contact.PaperContact`; LayersNet takes the nearest vertex (docs/sources.md, LayersNet).
    0 where none is near.

    Args:
        weight: of the term.
        thickness: [m]
        reach: vertices farther from the body at t are left out [m].
    """

    def __init__(self, weight: float, thickness: float, reach: float):
        super().__init__(weight)
        self.thickness = thickness
        self.reach = reach

    def forward(self, prediction: Prediction) -> dict[str, Tensor]:
        near = prediction.step.near_vertices(self.reach)
        height = ((prediction.x_next[near.points] - near.end.point) * near.end.normal).sum(-1)
        depth = counted((self.thickness - height).clamp(min=0.0) / self.thickness, near.there)
        return {"collision": depth.square().sum() / (depth.detach() > 0).sum().clamp(min=1)}
