"""A body for tests, built once."""

from __future__ import annotations

from functools import cache

from drape.figure.figure import Figure, make_figure
from drape.figure.shape import FigureShape


@cache
def usual_figure() -> Figure:
    """Of usual shape, with coarse edges of 3 cm."""
    return make_figure(FigureShape(), edge=0.03)
