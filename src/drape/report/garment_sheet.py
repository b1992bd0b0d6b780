"""A few sequences of a data set of garments at a glance, as one PNG: body and garment, one kind a row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from drape.data.hdf5 import GarmentFile, GarmentSequence
from drape.data.look import fabric_colour
from drape.data.whole_file import whole_file
from drape.report.preview import BODY_COLOUR
from drape.report.raster import Surface, draw
from drape.scene.camera import Camera

FRAMES = 7
ROWS = 12
WIDTH, HEIGHT = 150, 210
"""Pixels of a frame."""


def draw_garment_sheet(file: GarmentFile, path: Path, names: Sequence[str] | None = None) -> Path:
    """Draw sequences (default: the first of each kind, fabrics in turn), one a row, at even times; returns ``path``."""
    rows = [file.sequence(name) for name in names or one_of_each_kind(file)][:ROWS]
    figure, axes = plt.subplots(
        len(rows), FRAMES, figsize=(FRAMES * WIDTH / 100 + 0.3, len(rows) * (HEIGHT / 100 + 0.03)), squeeze=False
    )
    for line, sequence in zip(axes, rows, strict=True):
        frames = np.linspace(0, sequence.num_frames - 1, FRAMES).round().astype(int).tolist()
        camera = Camera.framing([sequence.body_positions[frames].reshape(-1, 3)], WIDTH / HEIGHT)
        for axis, frame in zip(line, frames, strict=True):
            axis.imshow(draw(_surfaces(sequence, frame), camera, WIDTH, HEIGHT), interpolation="nearest")
            axis.text(4, 12, f"{frame * file.dt:.2f} s", fontsize=5, color="#555555")
            axis.set(xticks=[], yticks=[])
            axis.spines[:].set_visible(False)
        words = f"{sequence.kind}, {sequence.fabric}, {sequence.motion}\n({sequence.split}, no. {sequence.name})"
        line[0].set_ylabel(words, fontsize=6)
    width = figure.get_size_inches()[0]
    figure.subplots_adjust(0.3 / width, 0.0, 1.0, 1.0, wspace=0.02, hspace=0.02)
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=100)
    plt.close(figure)
    return path


def one_of_each_kind(file: GarmentFile) -> list[str]:
    """The first sequence of each kind whose fabric the rows before show least often."""
    rows: dict[str, GarmentSequence] = {}
    for kind in dict.fromkeys(file.sequence(name).kind for name in file.names):
        shown = [row.fabric for row in rows.values()]
        moves = [row.motion for row in rows.values()]
        choice = [file.sequence(name) for name in file.names if file.sequence(name).kind == kind]
        rows[kind] = min(choice, key=lambda s: (shown.count(s.fabric) + moves.count(s.motion), s.name))
    return [row.name for row in rows.values()]


def _surfaces(sequence: GarmentSequence, frame: int) -> list[Surface]:
    body = Surface(sequence.body_positions[frame], sequence.body_faces, BODY_COLOUR)
    return [body, Surface(sequence.positions[frame], sequence.mesh.faces, fabric_colour(sequence.fabric))]
