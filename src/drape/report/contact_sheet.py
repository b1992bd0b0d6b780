"""A few sequences of a data set at a glance, as one PNG: garments on their bodies, or sheets."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drape.data.hdf5 import GarmentFile, GarmentSequence
from drape.data.look import fabric_colour
from drape.report.picture_sheet import Line, draw_pictures
from drape.report.preview import BODY_COLOUR
from drape.report.raster import Surface, draw
from drape.scene.camera import Camera

FRAMES = 7
ROWS = 12
OF_EACH_FABRIC = 2
"""Sheets of it."""
HEIGHT, UPRIGHT = 210, 150
"""Height of a picture, and its width where people stand in it [pixels]; sheets are shown in squares."""


def draw_contact_sheet(file: GarmentFile, path: Path) -> Path:
    """Draw one garment of each kind, or the first sheets of each fabric, at even times; returns ``path``.

    The vertices that are pinned are black.
    """
    shown = [file.sequence(name) for name in (one_of_each_kind(file) or _of_each_fabric(file))[:ROWS]]
    return draw_pictures([_line(sequence) for sequence in shown], path)


def one_of_each_kind(file: GarmentFile) -> list[str]:
    """The first garment on a body of each kind whose fabric and motion the ones before show least often."""
    rows: dict[str, GarmentSequence] = {}
    dressed = [sequence for sequence in file.sequences if sequence.body]
    for kind in dict.fromkeys(sequence.kind for sequence in dressed):
        shown = [row.fabric for row in rows.values()]
        moves = [row.motion for row in rows.values()]
        choice = [sequence for sequence in dressed if sequence.kind == kind]
        rows[kind] = min(choice, key=lambda s: (shown.count(s.fabric) + moves.count(s.motion), s.name))
    return [row.name for row in rows.values()]


def _of_each_fabric(file: GarmentFile) -> list[str]:
    named = [[each.name for each in file.sequences if each.fabric == fabric] for fabric in file.fabrics]
    return [name for names in named for name in names[:OF_EACH_FABRIC]]


def _line(sequence: GarmentSequence) -> Line:
    frames = np.unique(np.linspace(0, sequence.num_frames - 1, FRAMES).round().astype(int)).tolist()
    seen = sequence.body_positions[frames] if sequence.body else sequence.positions
    width = UPRIGHT if sequence.body else HEIGHT
    camera = Camera.framing([seen.reshape(-1, 3)], width / HEIGHT)
    pictures = [draw(_surfaces(sequence, frame), camera, width, HEIGHT) for frame in frames]
    kind = f"{sequence.kind}, " if sequence.body else ""
    motion = f", {sequence.motion}" if sequence.motion else ""
    words = f"{kind}{sequence.fabric}{motion}\n({sequence.split}, no. {sequence.name})"
    return Line(pictures, [frame * sequence.file.dt for frame in frames], words)


def _surfaces(sequence: GarmentSequence, frame: int) -> list[Surface]:
    colours = np.tile(fabric_colour(sequence.fabric), (sequence.mesh.num_vertices, 1))
    colours[sequence.pinned] = 0.0
    garment = Surface(sequence.positions[frame], sequence.mesh.faces, colours)
    if not sequence.body:
        return [garment]
    return [Surface(sequence.body_positions[frame], sequence.body_faces, BODY_COLOUR), garment]
