"""Parts of the page of results for a table, a figure, a data set: plain values for ``page.html``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drape.report.clips import RECORDED, Lane, ShownSequence
from drape.report.garment_rows import PAPER, GarmentRow, noise_floor
from drape.report.labels import FLOOR
from drape.report.table import Table, number
from drape.report.tables import OF_PAPER

CELL = re.compile(r"(?P<number>.*?)(?: ± (?P<deviation>[^( ]*))?(?: \((?P<seeds>[^()]*…[^()]*)\))?")
"""``1.50 ± 3.00 (1.40…1.60)``: mean, standard deviation over sequences, range over seeds."""
NUMBER = re.compile(r"-?\d[\d.]*(e[+-]?\d+)?")
NO_SCORES = ("seeds",)
"""Columns of which no number is the best."""


@dataclass(frozen=True)
class Figure:
    """A picture with its caption; ``dark`` is its form for dark pages, without which it stands on white."""

    light: Path
    caption: str
    dark: Path | None = None


@dataclass(frozen=True)
class Tile:
    """A number that says much, and what it is."""

    number: str
    text: str


@dataclass(frozen=True)
class Cell:
    """A number of a table, with what comes behind it."""

    number: str
    deviation: str
    seeds: str
    is_best: bool


@dataclass(frozen=True)
class Row:
    """A row of a table; its kind is ``paper``, ``floor`` or, of our own, nothing."""

    label: str
    kind: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class ScoreTable:
    """A table with the lowest of our numbers in each column marked."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    footnotes: tuple[str, ...]

    @classmethod
    def of(cls, table: Table, *, best: bool = False) -> ScoreTable:
        """The contents of ``table``; without ``best`` nothing is marked."""
        lowest = _lowest(table) if best else {}
        rows = tuple(_row(row, lowest) for row in table.rows)
        return cls(table.title, table.note, table.columns, rows, table.footnotes)


@dataclass(frozen=True)
class GarmentSection:
    """All that is shown of one data set."""

    mark: str
    """Name of the section within the page."""
    title: str
    about: str
    tiles: Sequence[Tile]
    tables: Sequence[ScoreTable]
    charts: Sequence[Figure]
    in_motion: Sequence[ShownSequence]


def tiles(rows: Sequence[GarmentRow]) -> list[Tile]:
    """Lowest error of each kind of simulator, and the noise floor."""
    known = [(row, mean.mean) for row in rows if not row.is_twin and (mean := row.over_seeds("error_mm")) is not None]
    found = []
    for kind, choice in (
        ("trained simulator", [each for each in known if each[0].training]),
        ("solver", [each for each in known if each[0].is_solver]),
        ("baseline", [each for each in known if not each[0].training and not each[0].is_solver]),
    ):
        if choice:
            row, error = min(choice, key=lambda each: each[1])
            found.append(Tile(f"{number(error)} mm", f"best {kind}: {row.label}"))
    floor = noise_floor(rows)
    if floor is not None:
        found.append(Tile(f"{number(floor)} mm", "noise floor: the same simulation, started 1e-6 m to the side"))
    return found


def heading(sequence: ShownSequence) -> str:
    """``dress, silk, walk (no. 00007)``, as far as it is known."""
    about = ", ".join(filter(None, (sequence.kind, sequence.fabric, sequence.motion)))
    return f"{about} (no. {sequence.name})" if about else f"no. {sequence.name}"


def scores(lane: Lane) -> list[str]:
    """``12.3 mm`` and ``0.4 % collision``, as far as they are known."""
    if lane.label == RECORDED:
        return ["what the others are compared with"]
    parts = []
    if "error_mm" in lane.scores:
        parts.append(f"{lane.scores['error_mm']:.3g} mm")
    if "collision_percent" in lane.scores:
        parts.append(f"{lane.scores['collision_percent']:.2g} % collision")
    return parts


def _row(row: Sequence[str], lowest: dict[int, float]) -> Row:
    paper = row[0].endswith(PAPER) or row[0] == OF_PAPER
    kind = "paper" if paper else "floor" if row[0] == FLOOR else ""
    cells = []
    for k, text in enumerate(row[1:], 1):
        parts = CELL.fullmatch(text)
        shown = parts.groupdict("") if parts else {"number": text, "deviation": "", "seeds": ""}
        cells.append(Cell(**shown, is_best=not kind and k in lowest and _value(text) == lowest[k]))
    return Row(row[0], kind, tuple(cells))


def _lowest(table: Table) -> dict[int, float]:
    """Lowest number of each column among our rows, where there are at least two."""
    found = {}
    ours = [row for row in table.rows if not row[0].endswith(PAPER) and row[0] != FLOOR]
    for k, column in enumerate(table.columns):
        values = [value for row in ours if k and column not in NO_SCORES and (value := _value(row[k])) is not None]
        if len(values) > 1:
            found[k] = min(values)
    return found


def _value(cell: str) -> float | None:
    match = NUMBER.match(cell)
    return float(match.group()) if match else None
