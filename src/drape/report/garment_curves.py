"""Figures of the errors of animated garments over time: the kinds of one evaluation, and several ways to animate."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from drape.evaluation.scored_sequence import UNREADABLE, ScoredSequence, by_frame, mean_by_frame
from drape.report.figure_theme import INK, legend_below, save_figure, themed, written_out
from drape.report.garment_colours import row_styles
from drape.report.garment_rows import GarmentRow
from drape.report.garment_tables import arranged

FILE = "by_frame.csv"


def draw_garment_curves(scored: Sequence[ScoredSequence], path: Path | str) -> Path:
    """One PNG: mean error [mm] over the sequences of each kind against the frame, all in black, the noise floor dotted.

    The grey band is from the 10th to the 90th percentile over all sequences.
    """
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axis = figure.subplots()
    curves = {
        kind: mean_by_frame([each for each in scored if each.kind == kind], "error_mm")
        for kind in arranged(each.kind for each in scored)
    }
    styles: dict[str, dict[str, Any]] = {kind: {"linewidth": 1} for kind in curves}
    curves["overall"], styles["overall"] = mean_by_frame(scored, "error_mm"), {"color": "black", "linewidth": 2}
    if len(scored) > 2:
        low, high = np.nanpercentile(by_frame(scored, "error_mm"), [10, 90], axis=0)
        axis.fill_between(np.arange(1, len(low) + 1), low, high, color="black", alpha=0.1, linewidth=0)
    _draw(axis, curves, styles, mean_by_frame(scored, "floor_mm"), "black")
    axis.legend(fontsize=8)
    return save_figure(figure, Path(path))


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
        floor = next((f for row in rows if (f := error_by_frame(row, "floor_mm")) is not None), None)
        styles = {label: {"linewidth": 1.6, **style} for label, style in row_styles(rows).items()}
        _draw(figure.subplots(), curves, styles, floor, INK[dark])
        legend_below(figure)
        return save_figure(figure, path)


def _draw(
    axis: Axes,
    curves: Mapping[str, Float[np.ndarray, " frames"]],
    styles: Mapping[str, Mapping[str, Any]],
    floor: Float[np.ndarray, " frames"] | None,
    ink: str,
) -> None:
    for label, curve in curves.items():
        axis.plot(np.arange(1, len(curve) + 1), curve, label=label, **styles[label])
    if floor is not None and np.isfinite(floor).any():
        axis.plot(np.arange(1, len(floor) + 1), floor, label="noise floor", color=ink, linestyle=":", linewidth=1.2)
    axis.set(xlabel="frame", ylabel="mean vertex error [mm]", yscale="log")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    written_out(axis.yaxis)
    axis.grid(alpha=0.25, linewidth=0.5)
