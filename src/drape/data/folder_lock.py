"""A folder that one process at a time works in."""

from __future__ import annotations

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path

from drape.errors import DrapeError


@contextlib.contextmanager
def locked(path: Path, taken: str) -> Iterator[None]:
    """Hold the lock file ``path`` for as long as the block runs, or the process lives; its folder is made.

    Raises:
        DrapeError: another process holds it; the sentence ``taken``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DrapeError(taken) from None
        yield
