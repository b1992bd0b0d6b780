"""The generator's side of the worker processes: hand out sequence numbers, collect answers, notice crashes."""

from __future__ import annotations

import selectors
from collections.abc import Iterable, Iterator
from pathlib import Path

from drape.blender.process import BlenderProcess


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
            selector.register(worker.process.stdout, selectors.EVENT_READ, worker)
            worker.start(waiting.pop())
        while selector.get_map():
            for key, _ in selector.select():
                worker = key.data
                attempts = worker.answer()
                index = worker.index
                if waiting:
                    worker.start(waiting.pop())
                else:
                    selector.unregister(worker.process.stdout)
                yield index, attempts
    finally:
        selector.close()
        for worker in workers:
            worker.stop()
        for worker in workers:
            worker.join()
