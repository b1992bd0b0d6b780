"""Figures for light and for dark pages: one drawing, colours of text and lines by the page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

INK = {False: "#24292f", True: "#d8dee6"}
"""Of text and frames on a light, on a dark page."""
FORMATS = {".svg": {"Date": None}, ".png": {}}
"""Metadata of a file by its ending: nothing that differs from run to run."""


@contextmanager
def themed(*, dark: bool) -> Iterator[None]:
    """Text and lines of figures made inside are legible on a light or a ``dark`` page."""
    names = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color", "legend.labelcolor")
    settings: dict[Any, Any] = dict.fromkeys(names, INK[dark]) | {
        "axes.facecolor": "none",
        "legend.framealpha": 0.0,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "font.size": 10,
        "svg.hashsalt": "drape",
    }
    with matplotlib.rc_context(settings):
        yield


def written_out(axis: Axis, subs: Sequence[int] = (1, 2, 5)) -> None:
    """Numbers of a logarithmic axis as they are, at these multiples of powers of ten."""
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_formatter(NullFormatter())


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a PNG on white, or an SVG without background."""
    path.parent.mkdir(parents=True, exist_ok=True)
    background = {"transparent": True} if path.suffix == ".svg" else {"dpi": 130}
    figure.savefig(path, metadata=FORMATS[path.suffix], **background)
    return path
