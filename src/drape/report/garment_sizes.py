"""Error against time per frame of the same garments in several resolutions: which way to animate them to take."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from drape.metrics.record import EvaluationRecord
from drape.report.figure_theme import INK, save_figure, themed
from drape.report.garment_rows import GarmentRow, by_data, garment_rows, noise_floor, place
from drape.report.runs import readable
from drape.report.table import Table
from drape.report.trade_points import BLENDER, Point, draw_points, finish_trade, point_of

SEQUENCES = "sequences.csv"
TIMED = "blender_time.csv"
MARKERS = list(dict.fromkeys((*"os^Dv", *Line2D.filled_markers)))
"""One for each size, the coarsest first, and again from the first."""
NEEDS = {
    "real time": "30 frames per second",
    "preview": "the fastest within 1.5 times the least error",
    "final": "the least error",
}
REAL_TIME = 1e3 / 30
"""Time per frame at 30 frames per second [ms]."""


Cost = tuple[float, float]
"""Vertices and time per frame [ms] of a sequence."""


@dataclass(frozen=True)
class Size:
    """Evaluations on one resolution of the garments."""

    vertices: float
    """Mean over the sequences."""
    rows: Mapping[str, GarmentRow]
    """By label, without the noise floor."""
    points: Mapping[str, Point]
    """Of each, and of Blender where it was timed."""
    costs: Mapping[str, Sequence[Cost]]
    """Of the same."""
    floor: float | None
    """Mean error of the noise floor [mm]."""


def sizes(
    evaluations: Sequence[EvaluationRecord], blender: Mapping[str, Sequence[Cost]] | None = None
) -> list[Size]:
    """Evaluations of as many sequences on several data sets, the coarsest first; none where there is one data set.

    Of several such lots that with the most data sets. ``blender``: see :func:`blender_costs`.
    """
    lots: dict[int, list[Size]] = {}
    for group in by_data(evaluations):
        vertices = [number for record in group for number, _ in _costs(record)]
        if vertices:
            rows, timed = garment_rows(group), (blender or {}).get(str(group[0].data["path"]))
            points = {row.label: point for row in rows if not row.is_twin and (point := point_of(row)) is not None}
            known = {row.label: row for row in rows if row.label in points}
            costs = {label: _costs(row.records[0]) for label, row in known.items()}
            floor = noise_floor(rows)
            if timed and floor is not None:
                points[BLENDER] = Point(float(np.mean([ms for _, ms in timed])), floor, BLENDER)
                costs[BLENDER] = list(timed)
            lot = lots.setdefault(len(group[0].data["sequences"]), [])
            lot.append(Size(float(np.mean(vertices)), known, points, costs, floor))
    most = max(lots.values(), key=len, default=[])
    return sorted(most, key=lambda size: size.vertices) if len(most) > 1 else []


def blender_costs(folder: Path | str) -> dict[str, list[Cost]]:
    """File of garments -> costs of Blender's own cloth, from all tables of ``measure=blender_time`` below a folder."""
    found: dict[str, list[Cost]] = {}
    for costs in readable(_timed, sorted(Path(folder).rglob(TIMED))):
        found |= costs
    return found


def _timed(path: Path) -> dict[str, list[Cost]]:
    found: dict[str, list[Cost]] = {}
    with path.open(newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            found.setdefault(row["file"], []).append((float(row["vertices"]), float(row["ms_per_frame"])))
    return found


def exponent(label: str, found: Sequence[Size]) -> float | None:
    """P of ``time ~ vertices^p``, by least squares over the sequences of all sizes; None for a row of one size."""
    pairs = [pair for size in found for pair in size.costs.get(label, ())]
    if sum(label in size.costs for size in found) < 2:
        return None
    vertices, times = np.log(np.array(pairs)).T
    return float(np.polyfit(vertices, times, 1)[0])


def recommended(size: Size) -> dict[str, str]:
    """Label of the row with the least error in real time, of the fastest within 1.5 times the least, of the least."""
    points = {label: point for label, point in size.points.items() if label != BLENDER}
    least = min(points, key=lambda label: points[label].error)
    near = [label for label in points if points[label].error <= 1.5 * points[least].error]
    found = {"preview": min(near, key=lambda label: points[label].time), "final": least}
    quick = [label for label in points if points[label].time <= REAL_TIME]
    return ({"real time": min(quick, key=lambda label: points[label].error)} if quick else {}) | found


def size_tables(found: Sequence[Size]) -> list[Table]:
    """Time per frame and error of each row in each size, the exponent of its time, and what to take for which need.

    One table, or none where ``found`` is empty.
    """
    if not found:
        return []
    named = {label: row for size in reversed(found) for label, row in size.rows.items()}
    labels = sorted(named, key=lambda label: place(named[label]))
    rows = []
    for label in (*labels, *([BLENDER] if any(BLENDER in size.points for size in found) else [])):
        cells = [" / ".join(map(_short, size.points.get(label, ())[:2])) for size in found]
        power = exponent(label, found)
        rows.append((label, *cells, "" if power is None else f"{power:.2f}"))
    notes = []
    for need, meaning in NEEDS.items():
        advised = [(size, recommended(size)) for size in found]
        taken = [f"{advice[need]} ({size.vertices:.0f} vertices)" for size, advice in advised if need in advice]
        notes.append(f"For {need} ({meaning}): {'; '.join(taken) or 'nothing is as fast'}.")
    floors = [f"{size.floor:.2g} mm at {size.vertices:.0f} vertices" for size in found if size.floor is not None]
    table = Table(
        "Which way to animate a garment",
        ("method", *(f"{size.vertices:.0f} vertices" for size in found), "time ~ vertices^p"),
        tuple(rows),
        "Time per frame [ms] / mean vertex error [mm]: the same garments in several resolutions, each compared with "
        f"its own recording. Noise floors: {', '.join(floors)}. {' '.join(notes)}",
    )
    return [table]


def draw_sizes(found: Sequence[Size], path: Path, *, dark: bool = False) -> Path | None:
    """Error [mm] against time per frame [ms]: families by colour, sizes by marker, the frontier of each size.

    A row is named at the largest size that it has. None where ``found`` is empty.
    """
    if not found:
        return None
    marked = list(zip(itertools.cycle(MARKERS), found, strict=False))
    with themed(dark=dark):
        figure = Figure(figsize=(7.6, 6.2), layout="constrained")
        axis = figure.subplots()
        for marker, size in marked:
            draw_points(axis, size.points, marker, INK[dark])
            axis.plot([], [], marker, color=INK[dark], label=f"{size.vertices:.0f} vertices", linestyle="none")
        largest = {label: (size, point) for size in found for label, point in size.points.items()}
        named = [(label, point) for label, (_, point) in largest.items()]
        others = [point for size in found for label, point in size.points.items() if largest[label][0] is not size]
        finish_trade(figure, axis, named, others)
        return save_figure(figure, path)


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _costs(record: EvaluationRecord) -> list[Cost]:
    """Of each sequence; none where the evaluation has left no list."""
    path = record.folder / SEQUENCES
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    return [(float(row["vertices"]), float(row["ms_per_frame"])) for row in rows if row.get("ms_per_frame")]
