"""Batches of windows straight from the file, in an order that can be continued after an interruption."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

import lightning
import numpy as np

Batch = TypeVar("Batch")


class WindowLoader(Generic[Batch]):
    """An iterable over batches of windows; ``build(indices)`` reads one batch.

    With ``seed`` the order is a permutation that depends on the seed and the epoch only, and every iteration starts
    the next epoch; without, it is the order of the file. An iteration may be left before its end, as Lightning does.
    ``state_dict`` says how far it is: Lightning stores it in checkpoints, and a resumed training continues with the
    batch that would have come next. ``rank`` of
    ``world_size`` processes takes every ``world_size``-th batch.
    """

    def __init__(
        self,
        build: Callable[[np.ndarray], Batch],
        num_windows: int,
        batch_size: int,
        *,
        seed: int | None = None,
        rank: int = 0,
        world_size: int = 1,
    ):
        self._build = build
        self._num_windows = num_windows
        self._batch_size = batch_size
        self._seed = seed
        self._rank = rank
        self._world_size = world_size
        self._epoch = 0
        self._next = 0
        self._in_place = True
        """Whether the next iteration starts at the position given by epoch and next; afterwards, at the next epoch."""

    def __len__(self) -> int:
        batches = -(-self._num_windows // self._batch_size)
        if self._seed is None:
            return len(range(self._rank, batches, self._world_size))
        return self._num_windows // self._batch_size // self._world_size

    def __iter__(self) -> Iterator[Batch]:
        if not self._in_place or self._next >= len(self):
            self._epoch, self._next = self._epoch + 1, 0
        self._in_place = False
        order = np.arange(self._num_windows)
        if self._seed is not None:
            order = np.random.default_rng([self._seed, self._epoch]).permutation(self._num_windows)
        while self._next < len(self):
            batch = self._next * self._world_size + self._rank
            self._next += 1
            yield self._build(np.sort(order[batch * self._batch_size : (batch + 1) * self._batch_size]))

    def state_dict(self) -> dict[str, int]:
        """Epoch and number of batches given out in it."""
        return {"epoch": self._epoch, "next": self._next}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Go on from where :meth:`state_dict` was taken."""
        self._epoch, self._next, self._in_place = state["epoch"], state["next"], True


def share_of(trainer: lightning.Trainer | None) -> dict[str, int]:
    """Number of this process among those of ``trainer``, as :class:`WindowLoader` takes it; alone without one."""
    return {} if trainer is None else {"rank": trainer.global_rank, "world_size": trainer.world_size}
