"""Continuation of a training: one process in a folder, from the newest checkpoint that is whole."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path

from lightning.pytorch.utilities.rank_zero import rank_zero_only

from drape.data.folder_lock import locked
from drape.energy.law.checkpoint import read_checkpoint
from drape.errors import DrapeError

LOCK = "training.lock"


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keep other trainings out of ``folder`` for as long as the block runs, or the process lives.

    Raises:
        DrapeError: another training is at work there.
    """
    if vars(rank_zero_only)["rank"]:  # a process of the same training; Lightning keeps it with the function
        yield
        return
    taken = f"{folder}: another training is at work there; wait for it, or give this one another name=..."
    with locked(folder / LOCK, taken):
        yield


def newest(folder: Path) -> Path | None:
    """The checkpoint of ``folder`` to go on from: ``last.ckpt``, or where that is torn, the newest that is whole."""
    others = sorted(folder.glob("*.ckpt"), key=lambda path: path.stat().st_mtime, reverse=True)
    last = folder / "last.ckpt"
    for path in [*filter(Path.is_file, [last]), *(path for path in others if path != last)]:
        try:
            read_checkpoint(path)
        except DrapeError as error:
            print(f"{error}; going on from the one before", file=sys.stderr)
        else:
            return path
    return None
