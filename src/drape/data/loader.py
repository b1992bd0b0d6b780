"""Batches of windows straight from the file, in an order that can be continued after an interruption."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar

import lightning
import numpy as np

Batch = TypeVar("Batch")


class WindowLoader(Generic[Batch]):
    """An iterable over batches of windows; ``build(indices)`` reads one batch.

    With ``seed`` the order is a permutation that depends on the seed and the epoch only, and every iteration starts
    the next epoch; without, it is the order of the file. With ``groups`` each batch has one window of each member of a
    group, a member being the numbers of its windows; a group has as many batches as its members have windows on
    average. An iteration may be left before its end, as Lightning does.
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
        groups: Sequence[Sequence[np.ndarray]] = (),
    ):
        self._build = build
        self._num_windows = num_windows
        self._batch_size = batch_size
        self._seed = seed
        self._groups = groups
        self._rank = rank
        self._world_size = world_size
        self._epoch = 0
        self._next = 0
        self._in_place = True
        """Whether the next iteration starts at the position given by epoch and next; afterwards, at the next epoch."""

    def __len__(self) -> int:
        if self._seed is None:
            batches = -(-self._num_windows // self._batch_size)
            return len(range(self._rank, batches, self._world_size))
        batches = sum(map(_batches_of, self._groups)) if self._groups else self._num_windows // self._batch_size
        return batches // self._world_size

    def __iter__(self) -> Iterator[Batch]:
        if not self._in_place or self._next >= len(self):
            self._epoch, self._next = self._epoch + 1, 0
        self._in_place = False
        order = self._order()
        while self._next < len(self):
            batch = self._next * self._world_size + self._rank
            self._next += 1
            yield self._build(np.sort(order[batch * self._batch_size : (batch + 1) * self._batch_size]))

    def _order(self) -> np.ndarray:
        """The windows of this epoch, batch after batch."""
        if self._seed is None:
            return np.arange(self._num_windows)
        rng = np.random.default_rng([self._seed, self._epoch])
        if not self._groups:
            return rng.permutation(self._num_windows)
        batches = [
            np.stack([np.resize(rng.permutation(member), _batches_of(group)) for member in group], 1)
            for group in self._groups
        ]
        return rng.permutation(np.concatenate(batches)).reshape(-1)

    def state_dict(self) -> dict[str, int]:
        """Epoch and number of batches given out in it."""
        return {"epoch": self._epoch, "next": self._next}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Go on from where :meth:`state_dict` was taken."""
        self._epoch, self._next, self._in_place = state["epoch"], state["next"], True


def _batches_of(group: Sequence[np.ndarray]) -> int:
    return max(round(sum(map(len, group)) / len(group)), 1)


def share_of(trainer: lightning.Trainer | None) -> dict[str, int]:
    """Number of this process among those of ``trainer``, as :class:`WindowLoader` takes it; alone without one."""
    return {} if trainer is None else {"rank": trainer.global_rank, "world_size": trainer.world_size}
