"""A few sequences of a data set at a glance, as one PNG."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.collections import PolyCollection

from drape.data.hdf5 import GarmentFile
from drape.data.sequence import GarmentSequence

FRAMES = 6
PER_FABRIC = 2
COLOURS = ("#c98bb9", "#a9744f", "#4f74b3", "#d9b44a", "#6aa786", "#8d8d8d")
LIGHT = np.array([-0.40, 0.58, 0.71])
"""Direction of the light: right, up, towards the viewer."""
AZIMUTH, ELEVATION = np.radians(35.0), np.radians(18.0)
"""Direction of view: turned about the vertical from the y axis, and from above."""


def draw_contact_sheet(file: GarmentFile, path: Path) -> Path:
    """Draw the first sequences of each fabric, one a row, at evenly spaced times; returns ``path``.

    Orthographic, the same scale and place within a row; dots are pins, the back of the cloth is darker.
    """
    numbered = list(enumerate(file.sequences))
    rows = [row for name in file.fabrics for row in [row for row in numbered if row[1].fabric == name][:PER_FABRIC]]
    longest = max(sequence.num_frames for _, sequence in rows)
    frames = np.unique(np.linspace(0, longest - 1, FRAMES).round().astype(int))
    figure, axes = plt.subplots(
        len(rows), len(frames), figsize=(1.6 * len(frames) + 0.3, 1.6 * len(rows) + 0.3), squeeze=False
    )
    for line, (number, sequence) in zip(axes, rows, strict=True):
        screen = sequence.positions @ _view()
        centre = 0.5 * (screen.min((0, 1)) + screen.max((0, 1)))[:2]
        half = 0.53 * np.ptp(screen, axis=(0, 1))[:2].max() * np.array([-1.0, 1.0])
        fabric = file.fabrics.index(sequence.fabric)
        for axis, frame in zip(line, frames, strict=True):
            if frame < len(screen):
                _draw(axis, screen[frame], sequence, COLOURS[fabric % len(COLOURS)])
            axis.set(xlim=centre[0] + half, ylim=centre[1] + half, aspect="equal", xticks=[], yticks=[])
            axis.spines[:].set_color("#dddddd")
        line[0].set_ylabel(f"{file.fabrics[fabric]} (no. {number})", fontsize=8)
    for axis, frame in zip(axes[0], frames, strict=True):
        axis.set_title(f"{frame * file.dt:.2f} s", fontsize=8)
    width, height = figure.get_size_inches()
    figure.subplots_adjust(0.3 / width, 0.06 / height, 0.995, 1 - 0.3 / height, wspace=0.04, hspace=0.04)
    figure.savefig(path, dpi=90)
    plt.close(figure)
    return path


def _view() -> Float[np.ndarray, "3 3"]:
    """Columns: to the right, up, and towards the viewer."""
    cos, sin = np.cos(AZIMUTH), np.sin(AZIMUTH)
    right = np.array([cos, sin, 0.0])
    viewer = np.array([sin * np.cos(ELEVATION), -cos * np.cos(ELEVATION), np.sin(ELEVATION)])
    return np.stack([right, np.cross(viewer, right), viewer], axis=1)


def _draw(axis: plt.Axes, screen: np.ndarray, sequence: GarmentSequence, colour: str) -> None:
    """Triangles from back to front, shaded by the angle to the light."""
    triangles = screen[sequence.mesh.faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
    shade = (0.2 + 0.8 * np.abs(normals @ LIGHT)) * np.where(normals[:, 2] > 0, 1.0, 0.72)
    base = np.array(matplotlib.colors.to_rgb(colour))
    order = np.argsort(triangles[:, :, 2].mean(axis=1))
    colours = np.clip(shade[:, None] * base, 0.0, 1.0)[order]
    axis.add_collection(PolyCollection(triangles[order, :, :2], facecolors=colours, edgecolors=colours, linewidths=0.3))
    across, up = screen[sequence.pinned, :2].T
    axis.scatter(across, up, s=6, color="black", zorder=3)
