"""Results of a measurement: rows of numbers, printed as a table and kept as CSV and Markdown."""

from __future__ import annotations

import csv
import os
import platform
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import torch
from omegaconf import DictConfig

from drape.data.whole_file import whole_file
from drape.report.table import Table, number

Row = Mapping[str, str | int | float]
"""Column -> value; names of columns end in their unit."""


@dataclass(frozen=True)
class Measured:
    """Rows with the same columns, and how they came about."""

    name: str
    """Of the files."""
    title: str
    rows: Sequence[Row]
    note: str = ""
    figures: Mapping[str, Callable[[Path], Path]] = field(default_factory=dict)
    """Draw pictures to a path, by what follows the name in theirs."""

    def table(self) -> Table:
        """The rows as text; a column that says the same everywhere stands in the note instead."""
        names = list(self.rows[0])
        same = [name for name in names if len(self.rows) > 1 and len({row[name] for row in self.rows}) == 1]
        columns = tuple(name for name in names if name not in same)
        everywhere = [f"{name.replace('_', ' ')} {_text(self.rows[0][name])}" for name in same]
        return Table(
            title=self.title,
            columns=tuple(name.replace("_", " ") for name in columns),
            rows=tuple(tuple(_text(row[name]) for name in columns) for row in self.rows),
            note="; ".join([*everywhere, self.note]),
        )

    def save(self, folder: Path | str) -> list[Path]:
        """Write ``<name>.csv``, ``<name>.md`` and pictures, ``<name>.png`` and others, into ``folder``."""
        paths = [Path(folder) / f"{self.name}{ending}" for ending in (".csv", ".md")]
        with whole_file(paths[0]) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(self.rows[0]))
            writer.writeheader()
            writer.writerows(self.rows)
        with whole_file(paths[1]) as temporary:
            temporary.write_text(self.table().markdown(), encoding="utf-8")
        return paths + [draw(Path(folder) / f"{self.name}{ending}.png") for ending, draw in self.figures.items()]


class Measure(Protocol):
    """One thing to measure, built from the node ``measure`` of a config."""

    def measure(self, config: DictConfig) -> Measured:
        """Measure it, with energies, scenes and solvers as ``config`` composes them."""
        ...


class Circumstances:
    """On what and how a measurement ran, for its note: command, threads, load, time."""

    def __init__(self) -> None:
        self.began = time.perf_counter()
        self.load = os.getloadavg()[0]

    def text(self) -> str:
        """A sentence, at the end of the measurement."""
        command = shlex.join(["python", os.path.relpath(sys.argv[0]), *sys.argv[1:]])
        minutes = (time.perf_counter() - self.began) / 60
        return (
            f"`{command}`: {minutes:.1f} minutes, {torch.get_num_threads()} threads of {os.cpu_count()} cores "
            f"({platform.machine()}), load {self.load:.1f} before and {os.getloadavg()[0]:.1f} after, "
            f"torch {torch.__version__}"
        )


def _text(value: str | int | float) -> str:
    if isinstance(value, str | int):
        return str(value)
    return number(value)
