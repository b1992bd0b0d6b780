"""Both ends of a process that imports bpy: one JSON line for each request, one for each answer. Does not import bpy."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any, cast

import drape
from drape.errors import DrapeError

PATIENCE = 20.0
"""Seconds that a process has to end by itself."""


class BlenderProcess:
    """``python -m <module> <arguments>``, which runs :func:`serve`; what Blender prints goes to the file ``log``."""

    def __init__(self, module: str, arguments: Sequence[str], log: Path) -> None:
        self.log = log
        source = str(Path(drape.__file__).parents[1])
        path = os.pathsep.join([source, *filter(None, [os.environ.get("PYTHONPATH")])])
        with open(self.log, "wb") as file:
            self.process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=file,
                env={**os.environ, "PYTHONPATH": path},
            )
        self.requests = cast(IO[bytes], self.process.stdin)  # as both are pipes
        self.answers = cast(IO[bytes], self.process.stdout)

    def send(self, request: object) -> None:
        """Hand over a request; its answer is :meth:`receive`."""
        with contextlib.suppress(BrokenPipeError):  # a dead process is noticed when its answer is read
            self.requests.write(f"{json.dumps(request)}\n".encode())
            self.requests.flush()

    def receive(self, what: str) -> Any:
        """The answer to the request; ``what`` it is about opens the sentence if it fails.

        Raises:
            DrapeError: it could not be done, or the process died.
            OSError: a file could not be written.
        """
        line = self.answers.readline()
        if not line:
            code = self.process.wait()
            tail = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-3:]
            raise DrapeError(
                f"{what}: its Blender process died (exit status {code}): {' | '.join(tail) or 'no output'}; what is "
                "finished is kept, the same command goes on"
            )
        answer = json.loads(line)
        if answer["errno"] is not None:
            raise OSError(answer["errno"], os.strerror(answer["errno"]))
        if answer["error"] is not None:
            raise DrapeError(f"{what}: {answer['error']}")
        return answer["result"]

    def stop(self) -> None:
        """Ask the process to end after the request in flight, so that Blender removes its temporary files."""
        with contextlib.suppress(BrokenPipeError):
            self.requests.close()
        self.answers.close()

    def join(self) -> None:
        """Wait for the end; kill where it does not come."""
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def __enter__(self) -> BlenderProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self.join()


def serve(start: Callable[[], Callable[[Any], Any]]) -> None:
    """The other end: answer the requests on standard input with the function that ``start`` (imports bpy) returns.

    It ends with its input, so it never outlives whoever started it by more than one request.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # whatever Blender prints belongs to the log
    handle = start()
    for line in sys.stdin:
        answer: dict[str, Any] = {"result": None, "error": None, "errno": None}
        try:
            answer["result"] = handle(json.loads(line))
        except (DrapeError, OSError) as error:
            answer |= {"error": str(error), "errno": getattr(error, "errno", None)}
        try:
            print(json.dumps(answer), file=answers)
        except BrokenPipeError:
            return
