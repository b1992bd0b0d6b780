"""Cost of a training step beyond its networks: data, geometry, disturbances, losses, optimiser."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch import Tensor

from drape.data.windows import Window
from drape.energy.law.eunet import EUNet
from drape.energy.law.step_energies import StepEnergies
from drape.loss.term import LossTerm

WARM_UP = 3
"""Steps that are not counted."""


Energies = Tensor | tuple[Tensor, Tensor]
"""Of elastic units, or of dissipation units: energy and what is lost."""
Call = tuple[Callable[[Tensor, Tensor], Energies], Tensor, Tensor]
"""Call of a unit: (function, inputs, attributes)."""


class StepCost:
    """Times of one training step [s], medians over ``repeats``, phase by phase, and of its networks alone.

    The networks alone: the same units on the same inputs, ready made, forward and backward, with the slopes in the
    inputs and their second backward where a loss asks for forces. Steps and networks alternate, so that both see the
    same machine.
    """

    def __init__(self, energy: EUNet, loss: dict[str, LossTerm], windows: Iterator[Window]):
        self.energy = energy
        self.loss = loss
        self.windows = windows
        self.calls: list[Call] = []
        """Calls of the units in the last step."""
        self.optimizer = torch.optim.Adam(energy.parameters(), lr=1e-6, fused=True)

    def measure(self, repeats: int) -> dict[str, float]:
        """Seconds of ``data``, ``forward``, ``backward``, ``optimizer``, their sum ``step``, and ``networks``."""
        rows = []
        for _ in range(WARM_UP + repeats):
            row = self._step()
            row["networks"] = self._networks()
            rows.append(row)
        counted = rows[WARM_UP:]
        return {name: statistics.median(row[name] for row in counted) for name in counted[0]}

    def _step(self) -> dict[str, float]:
        marks = [time.perf_counter()]
        window = next(self.windows)
        marks.append(time.perf_counter())
        with _Recording(self.energy) as self.calls:
            step = StepEnergies(self.energy, window, training=True)
            total = sum(term.weight * term(step) for term in self.loss.values())
        self._forces = "gradient" in step.__dict__
        marks.append(time.perf_counter())
        self.optimizer.zero_grad()
        total.backward()
        marks.append(time.perf_counter())
        self.optimizer.step()
        marks.append(time.perf_counter())
        names = ("data", "forward", "backward", "optimizer")
        row = {name: end - start for name, start, end in zip(names, marks[:-1], marks[1:], strict=True)}
        return row | {"step": marks[-1] - marks[0]}

    def _networks(self) -> float:
        calls = [(e, inputs.detach().requires_grad_(inputs.requires_grad), a) for e, inputs, a in self.calls]
        leaves = [inputs for _, inputs, _ in calls if inputs.requires_grad]
        began = time.perf_counter()
        total = torch.zeros(())
        for evaluate, inputs, attributes in calls:
            found = evaluate(inputs, attributes)
            total = total + sum(part.sum() for part in (found if isinstance(found, tuple) else (found,)))
        if self._forces:
            slopes = torch.autograd.grad(total, leaves, create_graph=True)
            total = total + sum(slope.square().sum() for slope in slopes)
        total.backward()
        return time.perf_counter() - began


class _Recording:
    """While active, what the units of ``energy`` are asked: (their function, inputs, attributes)."""

    def __init__(self, energy: EUNet):
        self._units: list[Any] = list(energy.units.values())
        self._calls: list[Call] = []

    def __enter__(self) -> list[Call]:
        for unit in self._units:
            unit.energies = self._wrap(unit.energies)
        return self._calls

    def __exit__(self, *_: object) -> None:
        for unit in self._units:
            del unit.energies

    def _wrap(self, evaluate: Callable[[Tensor, Tensor], Energies]) -> Callable[[Tensor, Tensor], Energies]:
        def recorded(inputs: Tensor, attributes: Tensor) -> Energies:
            self._calls.append((evaluate, inputs, attributes))
            return evaluate(inputs, attributes)

        return recorded
