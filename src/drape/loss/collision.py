"""Predicted vertices that are inside the body or too near to it."""

from __future__ import annotations

from torch import Tensor

from drape.loss.prediction import Prediction, PredictionLoss


class Collision(PredictionLoss):
    """Mean of ``(max(thickness - d, 0) / thickness)²`` over the vertices with d below ``thickness`` (LayersNet's loss).

    d is the signed distance at t + dt from the plane of the face of the body that was nearest at t, as in
    :class:`drape.energy.contact.Contact`; LayersNet takes the nearest vertex (FACTS 4.5). 0 where none is near.

    Args:
        weight: of the term.
        thickness: [m]
        search_range: how far away from the body a vertex at t is looked at [m].
    """

    def __init__(self, weight: float, thickness: float, search_range: float):
        super().__init__(weight)
        self.thickness = thickness
        self.search_range = search_range

    def forward(self, prediction: Prediction) -> dict[str, Tensor]:
        near = prediction.step.nearest_faces(self.search_range)
        height = ((prediction.x_next[near.vertices] - near.end.point) * near.end.normal).sum(-1)
        depth = (self.thickness - height).clamp(min=0.0) / self.thickness
        return {"collision": depth.square().sum() / (depth.detach() > 0).sum().clamp(min=1)}
