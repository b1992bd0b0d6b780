"""One sequence of a data set: drawn, simulated, controlled, drawn anew where it is refused. Does not import bpy.

What is drawn is a sheet (sheet_sequence) or a garment on a body (garment_sequence).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from drape.blender.choice import Choice, choose
from drape.data.stored_part import Part
from drape.errors import DrapeError


@runtime_checkable
class Simulated(Protocol):
    """A sequence after Blender has moved it."""

    def reason_to_refuse(self) -> str:
        """Reason for which it is not stored, or ''."""

    def part(self, attempt: int, refused: Sequence[str]) -> Part:
        """Stored form of attempt number ``attempt``, before which others were refused for these reasons."""


@runtime_checkable
class Drawn(Protocol):
    """A sequence before Blender moves it."""

    @property
    def steps(self) -> Sequence[int]:
        """Solver steps per frame to simulate it with, one after the other until it is not refused."""

    def simulated(self, steps: int) -> Simulated:
        """Simulate it."""


Draw = Callable[[int, Mapping, Choice, np.random.Generator], Drawn]
"""Draws sequence (index, plan, what it shows, random numbers); a DrapeError is a draw that is refused."""


def make_sequence(index: int, plan: Mapping, draw: Draw) -> Part:
    """Sequence ``index`` of a plan, which shows what :func:`~drape.blender.choice.choose` says.

    Attempt k = 1, 2, ... draws from ``numpy.random.default_rng([seed, index, k])`` and from nothing else, so the result
    depends neither on other sequences nor on who computes it. The first that is not refused is taken.

    Raises:
        DrapeError: all ``data.reject.attempts`` attempts were refused.
    """
    data, choice = plan["data"], choose(index, plan)
    refused: list[str] = []
    for attempt in range(1, data["reject"]["attempts"] + 1):
        try:
            drawn = draw(index, plan, choice, np.random.default_rng([data["seed"], index, attempt]))
        except DrapeError as error:
            refused.append(str(error))
            continue
        for steps in drawn.steps:
            simulated = drawn.simulated(steps)
            reason = simulated.reason_to_refuse()
            if not reason:
                return simulated.part(attempt, refused)
            refused.append(reason)
    raise DrapeError(
        f"refused {attempt} times, at last for {refused[-1]}; widen data.reject, draw calmer ones, or change the seed"
    )
