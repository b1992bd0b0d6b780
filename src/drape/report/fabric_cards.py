"""Fabric cards as a picture: how each fabric drapes and bends, compared with published numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drape.report.figure_theme import save_figure
from drape.report.raster import Surface, draw
from drape.scene.camera import Camera

SIZE = 480, 300
"""Pixels of a draped disc."""
COLOURS = {"silk": "#c1446b", "cotton": "#c99a2e", "denim": "#34547a", "leather": "#7a4a2b"}
OTHER = "#4c7a5a"
"""Of a fabric that has none of its own."""
REACH = 1.9
"""Powers of ten that are drawn."""
PLANE = 41.5
"""Of the plane that a strip's tip touches [degrees]."""


class Compared(NamedTuple):
    """A property of a fabric with its published range."""

    name: str
    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Pictured:
    """The numbers of a card that are drawn."""

    fabric: str
    profile: Float[np.ndarray, "columns 2"]
    """Of the strip, along and up from the edge [m]."""
    x: Float[np.ndarray, "vertices 3"]
    """Of the draped disc [m]."""
    faces: Int[np.ndarray, "faces 3"]
    compared: Sequence[Compared]

    @property
    def colour(self) -> str:
        return COLOURS.get(self.fabric, OTHER)


def draw_cards(cards: Sequence[Pictured], path: Path | str) -> Path:
    """One PNG, a column for each fabric: the draped disc, the strip in the cantilever test, law, published."""
    figure = Figure(figsize=(3.4 * len(cards), 7.4), layout="constrained")
    axes = figure.subplots(3, len(cards), squeeze=False, gridspec_kw={"height_ratios": [2.2, 2.4, 2.8]})
    longest = max(card.profile[:, 0].max() for card in cards)
    for card, (disc, strip, numbers) in zip(cards, axes.T, strict=True):
        disc.imshow(_draped(card))
        disc.axis("off")
        disc.set_title(card.fabric, fontsize=13)
        _draw_strip(strip, card, longest)
        _draw_numbers(numbers, card)
    axes[1, 0].set_ylabel("cantilever test [cm]")
    axes[2, 0].set_ylabel("law beside published")
    return save_figure(figure, Path(path))


def _draped(card: Pictured) -> np.ndarray:
    red, green, blue = (int(card.colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return draw([Surface(card.x, card.faces, (red, green, blue))], Camera.framing([card.x], SIZE[0] / SIZE[1]), *SIZE)


def _draw_strip(axis: Axes, card: Pictured, longest: float) -> None:
    away = np.array([0.0, longest]) * 105.0
    axis.plot(away, -np.tan(np.radians(PLANE)) * away, color="0.7", linestyle=":")
    axis.fill_between([-30.0 * longest, 0.0], [0.0, 0.0], [-4.0 * longest, -4.0 * longest], color="0.85")
    axis.plot(*(1e2 * card.profile.T), color=card.colour, linewidth=2.5)
    axis.set_aspect("equal")
    axis.set_xlim(-30.0 * longest, 105.0 * longest)
    axis.set_ylim(-95.0 * longest, 15.0 * longest)


def _draw_numbers(axis: Axes, card: Pictured) -> None:
    """Each published range as a bar around its middle, the law as a point, in powers of ten from the middle."""
    for k, each in enumerate(card.compared):
        middle = np.sqrt(each.low * each.high)
        width = max(np.log10(each.high / each.low), 0.03)
        axis.barh(k, width, left=np.log10(each.low / middle), height=0.5, color="0.8")
        place = np.log10(each.value / middle) if np.isfinite(each.value) else REACH
        axis.plot(np.clip(place, -REACH, REACH), k, "o" if abs(place) < REACH else ">", color=card.colour)
    names = [each.name.partition(",")[0] for each in card.compared]
    axis.set_yticks(range(len(names)), names, fontsize=8)
    axis.set_xlim(-1.05 * REACH, 1.05 * REACH)
    axis.set_xticks([-1, 0, 1], ["÷ 10", "published", "× 10"], fontsize=8)
    axis.set_ylim(max(len(names), 1) - 0.4, -0.6)
    axis.spines[["top", "right"]].set_visible(False)
