"""Figure of the accuracy of laws against the data that they were learned from."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drape.report.figure_theme import save_figure, written_out

PANELS = {
    "force_residual_N": "force residual on the test split [N]",
    "error_percent": "error of animations [% of the way]",
}
STYLES = ("-", "--", ":", "-.")


def draw_trained_laws(rows: Sequence[Mapping[str, str | float]], name: str, path: Path | str) -> Path:
    """One PNG: both measures against ``value``, all logarithmic; a colour for each fabric, dashes for each law.

    ``rows`` are those of :class:`drape.benchmark.trained_laws.TrainedLaws`. Dots are trainings, lines their means. A
    value of 0 stands a decade below the others.
    """
    figure = Figure(figsize=(12, 5.2), layout="constrained")
    places = _places(sorted({float(row["value"]) for row in rows}))
    for axis, (key, label) in zip(figure.subplots(1, len(PANELS)), PANELS.items(), strict=True):
        _draw_panel(axis, rows, key, places)
        axis.set(xscale="log", yscale="log", xlabel=name.replace("_", " "), ylabel=label)
        axis.set_xticks(list(places.values()), [f"{value:g}" for value in places])
        axis.xaxis.minorticks_off()
        written_out(axis.yaxis)
        axis.grid(alpha=0.3, linewidth=0.4)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9)
    return save_figure(figure, Path(path))


def _places(values: Sequence[float]) -> dict[float, float]:
    """Place of each value on a logarithmic axis."""
    lowest = min((value for value in values if value > 0), default=10.0)
    return {value: value if value > 0 else lowest / 10 for value in values}


def _draw_panel(axis: Axes, rows: Sequence[Mapping], key: str, places: Mapping[float, float]) -> None:
    fabrics, laws = (list(dict.fromkeys(str(row[column]) for row in rows)) for column in ("fabric", "law"))
    for law, style in zip(laws, STYLES, strict=False):
        for colour, fabric in enumerate(fabrics):
            found: dict[float, list[float]] = {}
            for row in rows:
                if (row["law"], row["fabric"]) == (law, fabric):
                    found.setdefault(places[float(row["value"])], []).append(float(row[key]))
            look: dict[str, Any] = {"color": f"C{colour}", "linewidth": 1, "linestyle": style}
            means = [statistics.fmean(values) for values in found.values()]
            axis.plot(list(found), means, label=f"{fabric}, {law}", **look)
            dots = [(place, value) for place, values in found.items() for value in values]
            axis.plot(*zip(*dots, strict=True), ".", color=f"C{colour}", markersize=4)
