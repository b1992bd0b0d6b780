"""Figures of the errors of animated garments over time: the kinds of one evaluation, and several ways to animate."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.optimize import isotonic_regression

from drape.evaluation.scored_sequence import UNREADABLE, ScoredSequence, by_frame, mean_by_frame
from drape.report.figure_theme import INK, save_figure, themed, written_out
from drape.report.garment_rows import WITHOUT, GarmentRow
from drape.report.garment_tables import arranged
from drape.report.trade_points import COLOURS, Point, name_points

FILE = "by_frame.csv"
FLOOR = "noise floor"
ROOM = 1.02
"""Left end of the names, as a share of the frames."""
GAP = 1.15
"""Least distance of names, in their heights."""


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
    """Mean vertex error [mm] against the frame, a named curve for each of ``rows``; None where no frame was kept.

    Colours are those of the trade; curves of a family that end together have one text with all their names.
    """
    curves = {row.label: curve for row in rows if (curve := error_by_frame(row)) is not None and not row.is_twin}
    if not curves:
        return None
    families = {row.label: row.family for row in rows}
    with themed(dark=dark):
        figure = Figure(figsize=(7.6, 6.2), layout="constrained")
        axis = figure.subplots()
        floor = next((f for row in rows if (f := error_by_frame(row, "floor_mm")) is not None), None)
        dashes = {label: "--" if families[label] == WITHOUT else "-" for label in curves}
        styles = {k: {"color": COLOURS[families[k]], "linestyle": dashes[k], "linewidth": 1.2} for k in curves}
        _draw(axis, curves, styles, floor, INK[dark])
        _name_ends(figure, axis, curves | ({} if floor is None else {FLOOR: floor}), families)
        return save_figure(figure, path)


def _name_ends(
    figure: Figure, axis: Axes, curves: Mapping[str, Float[np.ndarray, " frames"]], families: Mapping[str, str]
) -> None:
    """Names to the right of the axis where curves end, moved up and down until each can be read."""
    ends = {label: curve[np.isfinite(curve) & (curve > 0)] for label, curve in curves.items()}
    frames = max(map(len, curves.values()))
    named = [(k, Point(frames, end[-1], families.get(k, FLOOR))) for k, end in ends.items() if len(end)]
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()  # heights on the axis that there will be
    texts = [
        axis.text(ROOM * frames, point.error, text, color=COLOURS.get(point.family), fontsize=7, va="center")
        for text, point in sorted(name_points(named), key=lambda each: each[1].error)
    ]
    heights = [text.get_window_extent().height for text in texts]
    own = axis.transData.transform([text.get_position() for text in texts])
    own[:, 1] = apart(own[:, 1], GAP * np.array(heights))
    for text, place in zip(texts, axis.transData.inverted().transform(own), strict=True):
        text.set_position(place)


def apart(middles: Float[np.ndarray, " texts"], heights: Float[np.ndarray, " texts"]) -> Float[np.ndarray, " texts"]:
    """Middles of texts, from the lowest up, none over another: those nearest to ``middles`` by least squares."""
    touching = np.cumsum(heights) - 0.5 * heights
    return isotonic_regression(middles - touching).x + touching


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
        axis.plot(np.arange(1, len(floor) + 1), floor, label=FLOOR, color=ink, linestyle=":", linewidth=1.2)
    axis.set(xlabel="frame", ylabel="mean vertex error [mm]", yscale="log")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    written_out(axis.yaxis)
    axis.grid(alpha=0.25, linewidth=0.5)
