"""``metrics.csv`` of a training that was interrupted: Lightning's CSVLogger begins a new one and deletes the old."""

from __future__ import annotations

import itertools
from pathlib import Path

FILE = "metrics.csv"


def parts(path: Path) -> list[Path]:
    """``metrics_0.csv``, ``metrics_1.csv``, ..., as far as they are there, and ``metrics.csv``: in order of writing."""
    earlier = (path.with_stem(f"{path.stem}_{number}") for number in itertools.count())
    return [*itertools.takewhile(Path.is_file, earlier), path]


def set_aside(path: Path) -> None:
    """Make room for the rows of a continued training: ``metrics.csv`` becomes the next ``metrics_<number>.csv``."""
    if path.is_file():
        path.rename(path.with_stem(f"{path.stem}_{len(parts(path)) - 1}"))
