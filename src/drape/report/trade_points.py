"""Points of a trade of error against time: named where they stand, joined, and the best of them."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from adjustText import adjust_text
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.sparse.csgraph import connected_components

from drape.report.figure_theme import written_out
from drape.report.garment_rows import FAMILIES, NETWORKS, WITHOUT, GarmentRow

BLENDER = "Blender's own cloth"
"""Label and family of what the recordings are made by. Its error is the noise floor: that of recording once more."""
COLOURS = dict(zip((*FAMILIES, BLENDER), ("#7d8793", "#d9822b", "#2f6fd0", "#3f9c5a", "#a34fb5"), strict=True))
"""By family."""
ROUNDS = 300
"""Of moving names apart."""
PUSHES = {"expand": (1.15, 1.5), "force_text": (0.3, 0.5), "force_static": (0.3, 0.5), "force_pull": (0.005, 0.005)}
"""By which names leave each other and the points (adjustText): with its own they stay over them in a full figure."""
WIDEST = 34
"""Letters in a line."""
UNBROKEN = "\N{NO-BREAK SPACE}"
HIDDEN = np.log([1.25, 1.06])
"""Points whose times and errors differ by less than these ratios hide each other."""
DENSE = 1e3
"""Ratio of the ends of an axis up to which there is room for numbers between powers of ten."""


class Point(NamedTuple):
    """A way to animate garments."""

    time: float
    """Per frame [ms]."""
    error: float
    """Mean vertex error [mm]."""
    family: str
    """A key of :data:`COLOURS`."""


def point_of(row: GarmentRow) -> Point | None:
    """Means over the seeds of a row; None where no evaluation has both numbers."""
    time, error = row.over_seeds("ms_per_frame"), row.over_seeds("error_mm")
    return None if time is None or error is None else Point(time.mean, error.mean, row.family)


def draw_points(axis: Axes, points: Mapping[str, Point], marker: str, ink: str) -> None:
    """Points of a size by label; those of a solver with one law joined in the order of time; the frontier of all."""
    rows: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for label, point in points.items():
        rows.setdefault((point.family, _law(label)), []).append(point[:2])
    for (family, _), own in rows.items():
        joined = "-" if family not in (WITHOUT, NETWORKS) else "none"
        times, errors = zip(*sorted(own), strict=True)
        axis.plot(times, errors, marker, color=COLOURS[family], linestyle=joined, linewidth=1, markersize=6)
    best, frontier = float("inf"), []
    for time, error, _ in sorted(point for point in points.values() if point.family != BLENDER):
        if error < best:
            frontier.append((time, error))
            best = error
    axis.step(*zip(*frontier, strict=True), where="post", color=ink, alpha=0.25, linewidth=3, zorder=0)


def finish_trade(figure: Figure, axis: Axes, named: Sequence[tuple[str, Point]], beside: Sequence[Point] = ()) -> None:
    """Axes, the families, and a name at each of the ``named`` points, a solver's by its budget.

    Points that hide each other have one text with all their names. Texts keep off each other and off all points, those
    ``beside`` too.
    """
    axis.set(xscale="log", yscale="log", xlabel="time per frame [ms], one core", ylabel="mean vertex error [mm]")
    axis.margins(0.25)
    axis.grid(alpha=0.25, linewidth=0.5)
    for ticks in (axis.xaxis, axis.yaxis):
        low, high = ticks.get_view_interval()
        written_out(ticks, (1, 2, 5) if high < DENSE * low else (1,))
    every = [point for _, point in named] + list(beside)
    for family in (family for family in COLOURS if any(point.family == family for point in every)):
        axis.plot([], [], color=COLOURS[family], label=family, linewidth=2)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()  # names are moved on the axes that there will be
    texts = [
        axis.text(point.time, point.error, text, fontsize=7, color=COLOURS[point.family])
        for text, point in name_points(named)
    ]
    places = {"x": [point.time for point in every], "y": [point.error for point in every]}
    arrows = {"arrowstyle": "-", "color": "0.6", "linewidth": 0.5}
    adjust_text(texts, **places, ax=axis, iter_lim=ROUNDS, **PUSHES, arrowprops=arrows)


def name_points(named: Sequence[tuple[str, Point]]) -> list[tuple[str, Point]]:
    """A text for each point, and where; one for all points of a family that hide each other, the nearest first.

    The law that most rows of a solver have goes without saying.
    """
    places = np.log([point[:2] for _, point in named]).reshape(-1, 2)
    families = np.array([point.family for _, point in named])
    hidden = (abs(places[:, None] - places) < HIDDEN).all(-1) & (families[:, None] == families)
    laws = Counter(_law(label) for label, point in named if point.family not in (WITHOUT, NETWORKS))
    usual = max(laws, key=laws.__getitem__, default="")
    groups: dict[int, list[tuple[str, Point]]] = {}
    for group, (label, point) in zip(connected_components(hidden)[1], named, strict=True):
        groups.setdefault(int(group), []).append((label.removeprefix(f"{usual}, "), point))
    found = []
    for group in groups.values():
        group.sort(key=lambda each: each[1].error)
        names = [text.replace(" ", UNBROKEN) if len(text) < WIDEST else text for text, _ in group]
        text = textwrap.fill("; ".join(names), WIDEST, break_long_words=False, break_on_hyphens=False)
        found.append((text, group[len(group) // 2][1]))
    return found


def _law(label: str) -> str:
    """Of a solver: what its label says before its budget."""
    return label.partition(", ")[0]
