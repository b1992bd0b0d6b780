"""Scores of animated garments over many sequences, by kind: for evaluations, and for the validation of simulators."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor
from torchmetrics import Metric

from drape.errors import DrapeError
from drape.metrics.fabric_metric import OVERALL


class GarmentMetric(Metric):
    """Mean and standard deviation over sequences of each score: ``error_mm/dress``, ``error_mm_std/overall``, ...

    The paper's way (docs/sources.md, Scores of garments): each sequence counts once, however long it is, whatever its
    number of vertices. States are float64 sums that add up over processes. A score that is not a number is not counted;
    what was never counted has no key.

    Raises:
        DrapeError: no kinds, repeated kinds, or a kind called "overall".
    """

    full_state_update = False
    higher_is_better = False
    count: Tensor
    total: Tensor
    squares: Tensor

    def __init__(self, kinds: Sequence[str], scores: Sequence[str]):
        super().__init__()
        self.kinds, self.scores = tuple(kinds), tuple(scores)
        if not kinds or len(set(kinds)) < len(kinds) or OVERALL in kinds:
            raise DrapeError(f"metrics: kinds are {list(kinds)}; expected different names, none of them {OVERALL}")
        for name in ("count", "total", "squares"):
            zeros = torch.zeros(len(self.kinds), len(self.scores), dtype=torch.float64)
            self.add_state(name, zeros, dist_reduce_fx="sum")

    def update(self, kind: str, scores: Mapping[str, float]) -> None:
        """Add one sequence with its scores, as :func:`drape.metrics.garment_scores.sequence_scores` gives them.

        Raises:
            DrapeError: another kind.
        """
        if kind not in self.kinds:
            raise DrapeError(f"metrics: found a garment of kind {kind!r}; expected one of {', '.join(self.kinds)}")
        values = torch.tensor([scores.get(name, math.nan) for name in self.scores], dtype=torch.float64)
        known = torch.isfinite(values)
        values = values.nan_to_num(0.0, 0.0, 0.0).to(self.total.device)
        row = self.kinds.index(kind)
        self.count[row] += known.to(self.count.device)
        self.total[row] += values
        self.squares[row] += values**2

    def compute(self) -> dict[str, float]:
        """Values by key; the deviation is that around the mean, divided by n."""
        names = (*self.kinds, OVERALL)
        count, total, squares = (
            torch.cat([state, state.sum(0, keepdim=True)]).tolist() for state in (self.count, self.total, self.squares)
        )
        found = {}
        for column, score in enumerate(self.scores):
            for row, name in enumerate(names):
                if number := count[row][column]:
                    mean = total[row][column] / number
                    found[f"{score}/{name}"] = mean
                    found[f"{score}_std/{name}"] = max(squares[row][column] / number - mean**2, 0.0) ** 0.5
        return found
