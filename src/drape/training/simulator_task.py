"""One step that a network has to take, and how it is judged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.step import Step
from drape.energy.term import EnergyTerm
from drape.geometry.nearest_faces import NearestFaces
from drape.loss.prediction import Prediction, PredictionLoss
from drape.simulators.advance import advance


@dataclass(frozen=True, eq=False)
class Task:
    """A step that a network has to take."""

    step: Step
    near: NearestFaces | None
    """Of the step, searched before: a search asks the device. None: by who needs it."""
    target: Float[Tensor, "vertices 3"]
    """Positions of the data at t + dt [m]."""
    progress: Float[Tensor, ""]
    """Of the training, from 0 to 1."""

    @property
    def started(self) -> Step:
        """The step, of which nothing but the nearest faces is known."""
        return self.step if self.near is None else self.step.with_near(self.near, self.step.surface)


def task_values(network: nn.Module, losses: Iterable[PredictionLoss], task: Task) -> dict[str, Tensor]:
    """The ``total`` of the losses, their summands as they are and as energies, and ``x_next``, which is predicted.

    Only the total has a graph.
    """
    step, totals = task.started, []
    x_next = advance(network, step)
    prediction = Prediction(x_next, step, task.target, cast(Sequence[EnergyTerm], step.fabric), task.progress)
    shown = {"x_next": x_next.detach()}
    for loss in losses:
        values = loss(prediction)
        shown |= {f"loss/{name}": value.detach() for name, value in values.items()}
        shown |= {f"energy_J/{name}": value for name, value in loss.joules(values, prediction).items()}
        totals.append(loss.total(values))
    return shown | {"total": torch.stack(totals).sum()}
