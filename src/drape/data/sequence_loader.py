"""Whole sequences one by one, each process its share of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import lightning

from drape.data.sequence import GarmentSequence


class Watched:
    """A sequence to animate, as Lightning wants a batch."""

    def __init__(self, sequence: GarmentSequence):
        self.sequence = sequence

    def to(self, *_: object, **__: object) -> Watched:
        """Itself: what is read of it goes to a device later."""
        return self


class SequenceLoader:
    """An iterable over sequences; of several processes each takes every so many-th, and one at least."""

    def __init__(self, sequences: Sequence[GarmentSequence], trainer: lightning.Trainer | None = None):
        first, every = (0, 1) if trainer is None else (trainer.global_rank, trainer.world_size)
        self._sequences = list(sequences)[first::every] or list(sequences)[:1]

    def __len__(self) -> int:
        return len(self._sequences)

    def __iter__(self) -> Iterator[Watched]:
        return map(Watched, self._sequences)
