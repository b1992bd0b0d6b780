"""Length and start of the rollouts over a training."""

from __future__ import annotations

from typing import NamedTuple

from drape.errors import DrapeError


class Curriculum(NamedTuple):
    """Rollouts of ``min(last, first + iteration // every)`` steps (published: 1, one more every 5000, up to 5).

    A rollout begins at rest with probability ``at_rest``: no velocity, and the body stands still for one step, so that
    a garment that was fitted to another pose may settle first (HOOD's first frame). Both: docs/sources.md.
    """

    first: int
    every: int
    last: int
    at_rest: float

    def length(self, iteration: int) -> int:
        """Steps of the rollout of this iteration."""
        return min(self.last, self.first + iteration // self.every)


def curriculum(first: int, every: int, last: int, at_rest: float) -> Curriculum:
    """A :class:`Curriculum`, checked.

    Raises:
        DrapeError: rollouts without a step, or a probability that is none.
    """
    if not (1 <= first <= last and every >= 1 and 0.0 <= at_rest <= 1.0):
        raise DrapeError(
            f"curriculum: found first {first}, every {every}, last {last}, at_rest {at_rest}; expected "
            "1 <= first <= last, every >= 1 and at_rest from 0 to 1"
        )
    return Curriculum(first, every, last, at_rest)
