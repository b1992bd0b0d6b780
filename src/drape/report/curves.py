"""Training curves of a run from its ``metrics.csv``, and from those of its interrupted parts."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from matplotlib.figure import Figure

from drape.errors import DrapeError
from drape.report.figure_theme import save_figure
from drape.training.metrics_csv import parts

AXES = ("step", "epoch")
COLUMNS = 3
Curve = tuple[list[int], list[float]]


def read_curves(path: Path | str) -> dict[str, Curve]:
    """Steps and finite values of every column of a ``metrics.csv`` (Lightning's CSVLogger leaves gaps).

    Rows of interrupted parts of the training, ``metrics_0.csv``, ..., come first; steps that a later part repeated
    count as it logged them.

    Raises:
        DrapeError: no such file, or no column ``step``.
    """
    path = Path(path)
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; a run writes it with logger=default or logger=csv")
    curves: dict[str, Curve] = {}
    for part in parts(path):
        for name, (steps, values) in _read_part(part).items():
            earlier = [pair for pair in zip(*curves.get(name, ([], [])), strict=True) if pair[0] < steps[0]]
            curves[name] = [s for s, _ in earlier] + steps, [v for _, v in earlier] + values
    return curves


def _read_part(path: Path) -> dict[str, Curve]:
    curves: dict[str, Curve] = {}
    with open(path, newline="") as file:
        rows = csv.DictReader(file)
        if "step" not in (rows.fieldnames or ()):
            raise DrapeError(f"{path}: columns are {rows.fieldnames}; expected one called step")
        for row in rows:
            for name, text in row.items():
                if name not in AXES and text and math.isfinite(float(text)):
                    steps, values = curves.setdefault(name, ([], []))
                    steps.append(int(float(row["step"])))
                    values.append(float(text))
    return curves


def panels(curves: dict[str, Curve]) -> dict[str, dict[str, Curve]]:
    """Curves that share a panel: ``stage/quantity/name`` under ``stage/quantity``, labelled ``name``."""
    grouped: dict[str, dict[str, Curve]] = {}
    for name, curve in sorted(curves.items()):
        quantity, _, last = name.rpartition("/") if name.count("/") >= 2 else (name, "", "")
        grouped.setdefault(quantity, {})[last] = curve
    return grouped


def draw_curves(metrics_csv: Path | str, path: Path | str) -> Path:
    """One PNG with a panel for each quantity against the training step; positive quantities on a logarithmic axis."""
    grouped = panels(read_curves(metrics_csv))
    rows = max(1, math.ceil(len(grouped) / COLUMNS))
    figure = Figure(figsize=(4.2 * COLUMNS, 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, squeeze=False).flatten()
    for axis, (quantity, lines) in zip(axes, grouped.items(), strict=False):
        for name, (steps, values) in lines.items():
            axis.plot(steps, values, marker="." if len(steps) < 20 else "", linewidth=1, label=name)
        if all(value > 0 for _, values in lines.values() for value in values):
            axis.set_yscale("log")
        axis.set_title(quantity, fontsize=9)
        axis.set_xlabel("step", fontsize=8)
        axis.tick_params(labelsize=7)
        if any(lines):
            axis.legend(fontsize=7)
    for axis in axes[len(grouped) :]:
        axis.set_axis_off()
    return save_figure(figure, Path(path))
