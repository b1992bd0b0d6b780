"""Rows of pictures of the same size as one PNG: what they are on the left, the time in the corner of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from drape.data.whole_file import whole_file

MARGIN = 0.45
"""Left of pictures with words [inches]."""
GAP = 0.03
"""Between pictures [inches]."""
DPI = 100


class Line(NamedTuple):
    """Pictures of one motion, of 8 bits or from 0 to 1."""

    pictures: Sequence[np.ndarray]
    times: Sequence[float] = ()
    """Of the pictures [s]; as many, or none."""
    words: str = ""


def draw_pictures(lines: Sequence[Line], path: Path) -> Path:
    """Draw ``lines`` below each other; the file is whole or as it was. Returns ``path``."""
    height, width = lines[0].pictures[0].shape[:2]
    columns, margin = max(len(line.pictures) for line in lines), MARGIN if any(line.words for line in lines) else 0.0
    size = (margin + columns * (width / DPI + GAP), len(lines) * (height / DPI + GAP))
    figure = Figure(figsize=size)
    axes = figure.subplots(len(lines), columns, squeeze=False)
    for axis in axes.flat:
        axis.set(xticks=[], yticks=[])
        axis.spines[:].set_visible(False)
    for row, line in zip(axes, lines, strict=True):
        row[0].set_ylabel(line.words, fontsize=6)
        for axis, picture in zip(row, line.pictures, strict=False):
            axis.imshow(picture, interpolation="nearest")
        for axis, time in zip(row, line.times, strict=False):
            axis.text(4, 12, f"{time:.2f} s", fontsize=7, color="#555555")
    figure.subplots_adjust(margin / size[0], 0.0, 1.0, 1.0, wspace=0.02, hspace=0.02)
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=DPI)
    return path
