"""Colours of ways to animate garments, the same in every figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.colors import LinearSegmentedColormap, to_hex

from drape.report.garment_rows import NETWORKS, WITHOUT, GarmentRow, papers_place, place
from drape.report.labels import budget_of, solver_label

OF_NETWORKS = (
    "#d9822b", "#b89b1d", "#3f9c5a", "#86b34a", "#b48ae0", "#7a5ad6", "#2f8fd8", "#d6457f", "#8a6d5a",
)  # fmt: skip
"""By place in the paper's table."""
OF_LAWS = (("#f2a33a", "#e04b3a", "#a8328f", "#4f46c9"), ("#a5c93c", "#1fa7a0", "#2f6fd0"), ("#e39ac2", "#a8522d"))
"""From the first to the last budget of a solver, for each law and contact."""
OF_OTHERS = ("#7d8793", "#b08d57", "#6f9a7a", "#a07fa8")
"""Without dynamics."""
PALE = "#c9ccd1"
"""Towards which the variants of a network go, as far as 0.7 of the way."""
STYLES = ("-", "--", ":", "-.")


def row_styles(rows: Sequence[GarmentRow]) -> dict[str, dict[str, Any]]:
    """Colour and dashes by label, no noise floor.

    A network has the colour of its row in the paper, a variant of it a paler one with dashes. Solvers of one law and
    contact go through its colours from the smallest budget to the largest, with dashes by their time steps in a frame.
    Rows without dynamics are never solid.
    """
    shown = sorted((row for row in rows if not row.is_twin), key=place)
    laws = list(dict.fromkeys(solver_label(row.records[0]) for row in shown if row.is_solver))
    steps = sorted({budget_of(row.records[0])[1] for row in shown if row.is_solver})
    styles: dict[str, dict[str, Any]] = {}
    for row in shown:
        like = [other for other in shown if other.family == row.family and _hue(other, laws) == _hue(row, laws)]
        number, hue = like.index(row), _hue(row, laws)
        share = number / max(len(like) - 1, 1)
        if row.family == NETWORKS:
            colour, dashes = _between((OF_NETWORKS[hue % len(OF_NETWORKS)], PALE), 0.7 * share), number
        elif row.family == WITHOUT:
            colour, dashes = OF_OTHERS[number % len(OF_OTHERS)], 1 + number % (len(STYLES) - 1)
        else:
            colour = _between(OF_LAWS[hue % len(OF_LAWS)], share)
            dashes = steps.index(budget_of(row.records[0])[1])
        styles[row.label] = {"color": colour, "linestyle": STYLES[dashes % len(STYLES)]}
    return styles


def _hue(row: GarmentRow, laws: Sequence[str]) -> int:
    """Number of a row's colours among those of its family."""
    if row.family == NETWORKS:
        return papers_place(row)
    return laws.index(solver_label(row.records[0])) if row.is_solver else 0


def _between(colours: Sequence[str], share: float) -> str:
    """The colour at a share of the way from the first to the last."""
    return to_hex(LinearSegmentedColormap.from_list("", list(colours))(share))
