"""Colours of ways to animate garments, the same in every figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from drape.report.garment_rows import GarmentRow, row_label

OF_ROWS = {
    "MGN": "#d9822b",
    "LayersNet": "#b89b1d",
    "MGN-S+PHYS": "#3f9c5a",
    "MGN-S+PHYS+F": "#86b34a",
    "HOOD w/o EST": "#b48ae0",
    "HOOD": "#7a5ad6",
    "MGN-S+EUNet": "#2f8fd8",
    "MGN-S+EUNet w/o bending": "#7fbbe6",
    "MGN-H+EUNet": "#d6457f",
}
OF_SOLVERS = ("#e04b3a", "#1fa7a0", "#a8522d", "#c25ab0", "#6b8e23", "#4c6fb1")
OF_OTHERS = ("#7d8793", "#b08d57", "#6f9a7a", "#a07fa8")
"""Baselines that know nothing of the fabric."""
STYLES = ("-", "--", ":", "-.")


def row_styles(rows: Sequence[GarmentRow]) -> dict[str, dict[str, Any]]:
    """Colour and dashes by label; rows of one name share the colour, and baselines are never solid. No twins."""
    shown = sorted((row for row in rows if not row.is_twin), key=lambda row: row.label)
    names = {row.label: row_label(row.records[0]) for row in shown}
    colours: dict[str, str] = {}
    for palette, of_palette in (
        (OF_SOLVERS, [row for row in shown if row.is_solver or (row.training and names[row.label] not in OF_ROWS)]),
        (OF_OTHERS, [row for row in shown if not row.is_solver and not row.training]),
    ):
        for place, name in enumerate(dict.fromkeys(names[row.label] for row in of_palette)):
            colours[name] = palette[place % len(palette)]
    styles = {}
    for k, row in enumerate(shown):
        name, same = names[row.label], [names[other.label] for other in shown[:k]].count(names[row.label])
        dashes = same if row.is_solver or row.training else 1 + OF_OTHERS.index(colours[name])
        colour = OF_ROWS[name] if row.training and name in OF_ROWS else colours[name]
        styles[row.label] = {"color": colour, "linestyle": STYLES[dashes % len(STYLES)]}
    return styles
