"""The generator's side of the worker processes: hand out sequence numbers, collect answers, notice crashes."""

from __future__ import annotations

import os
import selectors
from collections.abc import Iterable, Iterator
from pathlib import Path

from drape.blender.process import BlenderProcess
from drape.errors import DrapeError


class Worker(BlenderProcess):
    """One process and the sequence that it is busy with."""

    def __init__(self, parts: Path, number: int) -> None:
        super().__init__("drape.blender.worker", [str(parts)], parts / f"worker_{number}.log")
        self.index = -1

    def start(self, index: int) -> None:
        self.index = index
        self.send(index)

    def answer(self) -> int:
        """The number of attempts that the sequence took; raises what :meth:`receive` does."""
        return self.receive(f"sequence {self.index}")


def processes_of(workers: int | str) -> int:
    """The number of worker processes: as given, or one per CPU for ``auto``.

    Raises:
        DrapeError: neither a whole number from 1 on nor ``auto``.
    """
    if workers == "auto":
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not isinstance(workers, int) or isinstance(workers, bool) or workers < 1:
        raise DrapeError(f"workers: found {workers!r}; expected auto or a whole number from 1 on")
    return workers


def run_workers(parts: Path, indices: Iterable[int], count: int) -> Iterator[tuple[int, int]]:
    """Simulate the sequences ``indices`` in ``count`` processes; yields (index, attempts) in order of completion.

    Raises:
        DrapeError, OSError: see :meth:`BlenderProcess.receive`; the finished sequences stay in ``parts``.
    """
    waiting = list(indices)[::-1]
    workers = [Worker(parts, number) for number in range(min(count, len(waiting)))]
    selector = selectors.DefaultSelector()
    try:
        for worker in workers:
            selector.register(worker.answers, selectors.EVENT_READ, worker)
            worker.start(waiting.pop())
        while selector.get_map():
            for key, _ in selector.select():
                worker = key.data
                attempts = worker.answer()
                index = worker.index
                if waiting:
                    worker.start(waiting.pop())
                else:
                    selector.unregister(worker.answers)
                yield index, attempts
    finally:
        selector.close()
        for worker in workers:
            worker.stop()
        for worker in workers:
            worker.join()
