"""The trade between speed and accuracy of animations: error against time per frame."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drape.report.figure_theme import save_figure, written_out

CURVE = ("energy", "precision", "steps", "resolution")
"""Columns that make a curve; its points are the budgets of iterations."""
STYLES = {("float64", 1): "-", ("float32", 1): "--", ("float64", 2): "-.", ("float64", 4): (0, (1, 1))}
"""By precision and time steps in a frame."""
SAME = 0.02
"""Relative difference of error up to which a budget is not written beside its point: a larger one is not used up."""
MARKERS = "osv^D"
"""One for each resolution."""


def draw_trade(rows: Sequence[Mapping[str, str | float]], path: Path | str) -> Path:
    """One PNG, a panel for each fabric: error [mm] against time per frame [ms], both logarithmic.

    ``rows`` are those of :class:`drape.benchmark.held_out.HeldOut`. Each curve is an energy in a precision on a mesh
    with a number of time steps in a frame, its points are budgets of iterations, written beside them where they change
    the error. Dotted: 5 % of the distance that the cloth travelled.
    """
    fabrics = list(dict.fromkeys(str(row["fabric"]) for row in rows))
    columns = 2 if len(fabrics) > 1 else 1
    figure = Figure(figsize=(6.5 * columns, 5 * math.ceil(len(fabrics) / columns) + 0.6), layout="constrained")
    panels = figure.subplots(math.ceil(len(fabrics) / columns), columns, squeeze=False).reshape(-1)
    colours = {k: f"C{n}" for n, k in enumerate(dict.fromkeys((row["energy"], row["resolution"]) for row in rows))}
    resolutions = sorted({row["resolution"] for row in rows}, key=str)
    markers = {resolution: MARKERS[k % len(MARKERS)] for k, resolution in enumerate(resolutions)}
    for axis, fabric in zip(panels, fabrics, strict=False):
        _draw_panel(axis, [row for row in rows if row["fabric"] == fabric], colours, markers)
        axis.set_title(fabric)
    for axis in panels[len(fabrics) :]:
        axis.set_visible(False)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)
    return save_figure(figure, Path(path))


def _draw_panel(axis: Axes, rows: Sequence[Mapping], colours: Mapping, markers: Mapping) -> None:
    for curve in dict.fromkeys(tuple(row[name] for name in CURVE) for row in rows):
        energy, precision, steps, resolution = curve
        cut = f", {steps} steps a frame" if steps > 1 else ""
        points = sorted((row for row in rows if tuple(row[n] for n in CURVE) == curve), key=lambda r: r["iterations"])
        axis.plot(
            [row["ms_per_frame"] for row in points],
            [row["error_mm"] for row in points],
            color=colours[energy, resolution],
            linestyle=STYLES.get((precision, steps), ":"),
            marker=markers[resolution],
            markersize=4,
            linewidth=1,
            label=f"{energy}, {precision}{cut}, {_mesh(resolution)}",
        )
        written = math.inf
        for row in points:
            if abs(row["error_mm"] / written - 1.0) > SAME:
                place, written = (row["ms_per_frame"], row["error_mm"]), row["error_mm"]
                axis.annotate(f"{row['iterations']}", place, (3, 3), textcoords="offset points", fontsize=7)
    axis.axhline(0.05 * rows[0]["travelled_mm"], color="black", linestyle=":", linewidth=0.8)
    axis.set(xscale="log", yscale="log", xlabel="time per frame [ms]", ylabel="mean vertex error [mm]")
    axis.grid(alpha=0.3, linewidth=0.4)
    for ticks in (axis.xaxis, axis.yaxis):
        written_out(ticks)


def _mesh(resolution: int | str) -> str:
    return f"{resolution} mesh" if isinstance(resolution, str) else f"{resolution} x {resolution} vertices"
