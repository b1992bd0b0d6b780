"""The generator's side of the worker processes: hand out sequence numbers, collect answers, notice crashes."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import drape
from drape.errors import DrapeError


PATIENCE = 20.0
"""Seconds that a worker has to end by itself."""


class Worker:
    """One process and the sequence that it is busy with."""

    def __init__(self, parts: Path, number: int) -> None:
        self.log = parts / f"worker_{number}.log"
        source = str(Path(drape.__file__).parents[1])
        path = os.pathsep.join([source, *filter(None, [os.environ.get("PYTHONPATH")])])
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "drape.blender.worker", str(parts)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env={**os.environ, "PYTHONPATH": path},
            )
        self.index = -1

    def start(self, index: int) -> None:
        self.index = index
        with contextlib.suppress(BrokenPipeError):  # a dead worker is noticed when its answer is read
            self.process.stdin.write(f"{index}\n".encode())
            self.process.stdin.flush()

    def answer(self) -> int:
        """The number of attempts that the sequence took.

        Raises:
            DrapeError: the sequence could not be made or stored, or the process died.
        """
        line = self.process.stdout.readline()
        if not line:
            code = self.process.wait()
            tail = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-3:]
            raise DrapeError(
                f"sequence {self.index}: its Blender process died (exit status {code}): {' | '.join(tail) or 'no output'}"
            )
        answer = json.loads(line)
        if "error" in answer:
            raise DrapeError(f"sequence {answer['index']}: {answer['error']}")
        return answer["attempts"]

    def close(self) -> None:
        """End the process: it stops by itself after the sequence in flight, and Blender removes its temporary files."""
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        self.process.stdout.close()
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


def run_workers(parts: Path, indices: Iterable[int], count: int) -> Iterator[tuple[int, int]]:
    """Simulate the sequences ``indices`` in ``count`` processes; yields (index, attempts) in order of completion.

    Raises:
        DrapeError: see :meth:`Worker.answer`; the finished sequences stay in ``parts``.
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
            worker.process.stdin.close()
        for worker in workers:
            worker.close()
