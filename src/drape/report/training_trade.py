"""The trade between speed and accuracy: errors against the width of the network and the time of training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from drape.metrics.fabric_metric import OVERALL
from drape.metrics.record import RunRecord
from drape.report.figure_theme import save_figure, written_out
from drape.report.runs import Configuration, configurations
from drape.report.tables import BASELINES, label

ERRORS = {"energy_error_J2": "squared energy error [J²]", "force_residual_N": "force residual [N]"}
COSTS = {"width": "width of the network", "minutes": "training time [minutes]"}
STYLES = ("-", "--", ":", "-.")


def draw_training_trade(runs: Sequence[RunRecord], path: Path | str, fabric: str = OVERALL) -> Path:
    """One PNG: energy error and force residual on the test split against width and against training time.

    A point is a configuration, mean over its seeds, bars their range; points of one colour are one way to train, and
    those of the same number of steps are joined by a line, whose dashes say how many.
    """
    found = configurations(runs)
    names = list(dict.fromkeys(label(configuration) for configuration in found))
    steps = sorted({int(configuration.setting["steps"]) for configuration in found})
    styles: dict[int, Any] = {number: STYLES[k % len(STYLES)] for k, number in enumerate(steps)}
    figure = Figure(figsize=(10, 7.5), layout="constrained")
    axes = figure.subplots(len(ERRORS), len(COSTS), squeeze=False, sharex="col", sharey="row")
    for row, (key, error) in zip(axes, ERRORS.items(), strict=True):
        for axis, cost in zip(row, COSTS, strict=True):
            for k, name in enumerate(names):
                of_name = [configuration for configuration in found if label(configuration) == name]
                _draw_points(axis, of_name, f"{key}/{fabric}", cost, styles, {"color": f"C{k}", "label": name})
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.grid(alpha=0.3, linewidth=0.4)
        row[0].set_ylabel(f"{error}, {fabric}")
    _draw_baselines(list(axes[1]), runs, fabric)
    for ticks in (axes[0][0].yaxis, axes[1][0].yaxis, axes[1][1].xaxis):
        written_out(ticks)
    widths = sorted({int(run.setting["width"]) for run in runs})
    axes[1][0].set_xticks(widths, [str(width) for width in widths])
    axes[1][0].minorticks_off()
    axes[0][0].legend(
        handles=[Line2D([], [], color="black", linestyle=s, label=f"{n} steps") for n, s in styles.items()]
    )
    for axis, text in zip(axes[-1], COSTS.values(), strict=True):
        axis.set_xlabel(text)
    axes[0][1].legend(fontsize=8)
    return save_figure(figure, Path(path))


def _cost(configuration: Configuration, cost: str) -> float:
    if cost == "width":
        return float(configuration.setting["width"])
    seconds = [float(run.provenance["seconds"]) for run in configuration.runs]
    return sum(seconds) / len(seconds) / 60


def _draw_points(
    axis: Axes, found: Sequence[Configuration], key: str, cost: str, styles: Mapping[int, Any], look: Mapping[str, Any]
) -> None:
    for steps, style in styles.items():
        same = [c for c in found if c.setting["steps"] == steps and c.over_seeds(key) is not None]
        points = sorted(((_cost(c, cost), c.over_seeds(key)) for c in same), key=lambda point: point[0])
        if not points:
            continue
        x, values = zip(*points, strict=True)
        y = [value.mean for value in values]
        bars = [[max(v.mean - v.lowest, 0.0) for v in values], [max(v.highest - v.mean, 0.0) for v in values]]
        axis.errorbar(x, y, bars, marker="o", markersize=4, linewidth=1, linestyle=style, capsize=2, **look)
        look = {**look, "label": "_nolegend_"}


def _draw_baselines(row: Sequence[Axes], runs: Sequence[RunRecord], fabric: str) -> None:
    for style, (key, name) in zip(("--", ":"), BASELINES.items(), strict=True):
        values = [run.metrics[f"{key}/{fabric}"] for run in runs if f"{key}/{fabric}" in run.metrics]
        for axis in row:
            if values:
                axis.axhline(sum(values) / len(values), color="black", linestyle=style, linewidth=0.8, label=name)
    lines = [line for line in row[1].get_lines() if line.get_label() in BASELINES.values()]
    if lines:
        row[1].legend(handles=lines, fontsize=7)
