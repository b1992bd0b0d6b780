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
            DrapeError: the sequence could not be made, or the process died.
            OSError: it could not be stored.
        """
        line = self.process.stdout.readline()
        if not line:
            code = self.process.wait()
            tail = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-3:]
            raise DrapeError(
                f"sequence {self.index}: its Blender process died (exit status {code}): "
                f"{' | '.join(tail) or 'no output'}; finished sequences are kept, the same command goes on"
            )
        answer = json.loads(line)
        if answer.get("errno") is not None:
            raise OSError(answer["errno"], os.strerror(answer["errno"]))
        if "error" in answer:
            raise DrapeError(f"sequence {answer['index']}: {answer['error']}")
        return answer["attempts"]

    def stop(self) -> None:
        """Ask the process to end after the sequence in flight, so that Blender removes its temporary files."""
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        self.process.stdout.close()

    def join(self) -> None:
        """Wait for the end; kill where it does not come."""
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


def run_workers(parts: Path, indices: Iterable[int], count: int) -> Iterator[tuple[int, int]]:
    """Simulate the sequences ``indices`` in ``count`` processes; yields (index, attempts) in order of completion.

    Raises:
        DrapeError, OSError: see :meth:`Worker.answer`; the finished sequences stay in ``parts``.
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
