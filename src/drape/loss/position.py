"""Position loss: distance of predicted positions from the recorded ones."""

from __future__ import annotations

from torch import Tensor

from drape.loss.prediction import Prediction, PredictionLoss


class Position(PredictionLoss):
    """Mean of ``|x' - x*|² / (dt² scale)²`` over the free vertices, x* the recorded positions (paper: MSE).

    ``scale`` [m/s²] is the typical acceleration, so that a network that predicts none starts near 1.
    """

    def __init__(self, weight: float, scale: float):
        super().__init__(weight)
        self.scale = scale

    def forward(self, prediction: Prediction) -> dict[str, Tensor]:
        step = prediction.step
        error = (prediction.x_next - prediction.target) / (step.dt**2 * self.scale)
        return {"position": (error.square().sum(-1) * step.free).sum() / step.free.sum()}
