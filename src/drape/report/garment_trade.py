"""The trade between speed and accuracy of animated garments: error against time per frame, as figure and as rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drape.evaluation.scored_sequence import write_rows
from drape.report.figure_theme import INK, save_figure, themed
from drape.report.garment_rows import GarmentRow, noise_floor
from drape.report.trade_points import COLOURS, draw_points, finish_trade, point_of

COLUMNS = ("ms_per_frame", "error_mm", "error_mm_std", "floor_mm", "collision_percent", "inside_percent")
FAR = 10
"""Rows with an error of more than so many times the smallest are in the CSV, and not in the picture."""


def trade_rows(rows: Sequence[GarmentRow]) -> list[dict[str, Any]]:
    """For each row with a time and an error: label, scale, seeds, and the means over seeds of :data:`COLUMNS`.

    The twin is no way to animate anything: it is the noise floor, and no row.
    """
    found = []
    for row in rows:
        means = {name: row.over_seeds(name) for name in COLUMNS}
        if row.is_twin or means["ms_per_frame"] is None or means["error_mm"] is None:
            continue
        about = {"method": row.label, "scale": row.training.get("scale", ""), "seeds": len(row.records)}
        about["sequences"] = len(row.records[0].data["sequences"])
        found.append(about | {name: "" if mean is None else mean.mean for name, mean in means.items()})
    return found


def write_garment_trade(rows: Sequence[GarmentRow], picture: Path) -> Path | None:
    """:func:`trade_rows` as CSV next to a picture of the same name; None where there are none."""
    found, path = trade_rows(rows), picture.with_suffix(".csv")
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_rows(path, found) if found else None


def draw_garment_trade(rows: Sequence[GarmentRow], path: Path, *, dark: bool = False) -> Path | None:
    """Error [mm] against time per frame [ms], both logarithmic: a named point for each of ``rows``, and the floor.

    Bars: the range over seeds. Without those farther than :data:`FAR`. None where no row has both numbers.
    """
    found = trade_rows(rows)
    if not found:
        return None
    nearest = min(float(each["error_mm"]) for each in found)
    shown = {str(each["method"]) for each in found if float(each["error_mm"]) <= FAR * nearest}
    with themed(dark=dark):
        figure = Figure(figsize=(7.6, 6.2), layout="constrained")
        axis = figure.subplots()
        points = {row.label: point for row in rows if row.label in shown and (point := point_of(row)) is not None}
        draw_points(axis, points, "o", INK[dark])
        for row in (row for row in rows if row.label in points):
            _draw_range(axis, row)
        floor = noise_floor(rows)
        if floor is not None:
            axis.axhline(floor, color=INK[dark], linestyle=":", linewidth=1)
            axis.annotate(
                f"noise floor {floor:.2g} mm", (0.0, floor), (4, 4), xycoords=("axes fraction", "data"),
                textcoords="offset points", fontsize=8,
            )  # fmt: skip
        finish_trade(figure, axis, list(points.items()))
        return save_figure(figure, path)


def _draw_range(axis: Axes, row: GarmentRow) -> None:
    """Bars over the seeds of a row, where there are several."""
    time, error = row.over_seeds("ms_per_frame"), row.over_seeds("error_mm")
    if len(row.records) > 1 and time is not None and error is not None:
        for x, y in (([time.mean] * 2, [error.lowest, error.highest]), ([time.lowest, time.highest], [error.mean] * 2)):
            axis.plot(x, y, color=COLOURS[row.family], linewidth=1)
