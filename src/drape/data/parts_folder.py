"""The folder where finished sequences wait until all are there; it belongs to one plan and one process at a time."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from drape.data.difference import refuse_difference
from drape.data.folder_lock import locked

OTHERWISE = "delete it, or choose another data.path"
"""Remedy where another data set is in the way."""


def parts_of(path: Path) -> Path:
    """The folder of parts of the data set at ``path``."""
    return path.with_name(path.name + ".parts")


@contextlib.contextmanager
def claimed(parts: Path, plan: Mapping) -> Iterator[None]:
    """Make the folder of parts, or see that the one found belongs to the same plan; keep other processes out.

    Raises:
        DrapeError: another plan's folder, or another process at work.
    """
    manifest = parts / "manifest.json"
    with locked(parts / "lock", f"{parts}: another process is at work here; wait for it, or choose another data.path"):
        if manifest.exists():
            refuse_difference(json.loads(manifest.read_text(encoding="utf-8")), plan, parts, OTHERWISE)
        else:
            temporary = manifest.with_suffix(".tmp")
            temporary.write_text(json.dumps(plan, indent=1), encoding="utf-8")
            os.replace(temporary, manifest)
        yield
