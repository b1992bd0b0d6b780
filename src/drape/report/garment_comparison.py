"""Figure of the errors of several ways to animate the same garments over time."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from drape.evaluation.scored_sequence import UNREADABLE
from drape.report.figure_theme import INK, legend_below, save_figure, themed, written_out
from drape.report.garment_colours import row_styles
from drape.report.garment_rows import GarmentRow

FILE = "by_frame.csv"


def error_by_frame(row: GarmentRow, score: str = "error_mm") -> Float[np.ndarray, " frames"] | None:
    """Mean of a score over sequences and seeds at frames 1, 2, ...; None where it was not kept for every seed.

    NaN at a frame without a number.
    """
    found: dict[int, list[float]] = {}
    try:
        for record in row.records:
            with open(record.folder / FILE, newline="", encoding="utf-8") as file:
                for line in csv.DictReader(file):
                    found.setdefault(int(line["frame"]), []).append(float(line[score]))
    except UNREADABLE:
        return None
    if not found:
        return None
    values = [np.array(found.get(frame, [np.nan])) for frame in range(1, max(found) + 1)]
    return np.array([v[np.isfinite(v)].mean() if np.isfinite(v).any() else np.nan for v in values])


def draw_garment_comparison(rows: Sequence[GarmentRow], path: Path, *, dark: bool = False) -> Path | None:
    """Mean vertex error [mm] against the frame, a curve for each of ``rows``; None where no frame was kept."""
    curves = {row.label: curve for row in rows if (curve := error_by_frame(row)) is not None and not row.is_twin}
    if not curves:
        return None
    with themed(dark=dark):
        figure = Figure(figsize=(6.4, 5.8), layout="constrained")
        axis = figure.subplots()
        styles = row_styles(rows)
        for label, curve in curves.items():
            axis.plot(np.arange(1, len(curve) + 1), curve, label=label, linewidth=1.6, **styles[label])
        floor = next((f for row in rows if (f := error_by_frame(row, "floor_mm")) is not None), None)
        if floor is not None and np.isfinite(floor).any():
            frames = np.arange(1, len(floor) + 1)
            axis.plot(frames, floor, label="noise floor", color=INK[dark], linestyle=":", linewidth=1.2)
        axis.set(xlabel="frame", ylabel="mean vertex error [mm]", yscale="log")
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        written_out(axis.yaxis)
        axis.grid(alpha=0.25, linewidth=0.5)
        legend_below(figure)
        return save_figure(figure, path)
