"""Animated garments below the recorded ones, at a few times, as one PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from drape.data.look import fabric_colour
from drape.data.recorded_scene import START
from drape.data.whole_file import whole_file
from drape.metrics.rollout_scores import ScoredRollout
from drape.report.stage import MOST_ERROR, Stage

TIMES = 6
"""Pictures of a sequence, at even times after the start."""
HEIGHT = 200
"""Of a picture [pixels]."""
MARGIN = 0.45
"""Left of the pictures [inches]."""


def draw_rollout_sheet(rollouts: Sequence[ScoredRollout], path: Path) -> Path:
    """Two lines of pictures for each of ``rollouts``, the animated garment in the colours of its error."""
    stages = [_stage(rollout) for rollout in rollouts]
    width, height = (size / 100 for size in (stages[0].width, HEIGHT))
    lines = 2 * len(rollouts)
    figure, axes = plt.subplots(
        lines, TIMES, figsize=(TIMES * (width + 0.03) + MARGIN, lines * (height + 0.03)), squeeze=False
    )
    for axis in axes.flat:
        axis.set(xticks=[], yticks=[])
        axis.spines[:].set_visible(False)
    for k, (rollout, stage) in enumerate(zip(rollouts, stages, strict=True)):
        _draw_pair(axes[2 * k : 2 * k + 2], rollout, stage)
    figure.subplots_adjust(MARGIN / figure.get_size_inches()[0], 0.0, 1.0, 1.0, wspace=0.02, hspace=0.02)
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=100)
    plt.close(figure)
    return path


def _draw_pair(axes: np.ndarray, rollout: ScoredRollout, stage: Stage) -> None:
    sequence, (above, below) = rollout.sequence, axes
    last = len(rollout.x) - 1
    times = np.unique(np.linspace(max(1.0, last / TIMES), last, TIMES).round().astype(int))
    for column, frame in enumerate(times.tolist()):
        body = sequence.body_positions[START + frame]
        _show(above[column], stage.picture(frame, stage.reference[frame], body))
        _show(below[column], stage.error_picture(frame, rollout.x[frame], body))
        above[column].text(4, 12, f"{frame * sequence.file.dt:.2f} s", fontsize=6, color="#555555")
    above[0].set_ylabel(f"{sequence.kind}, {sequence.fabric}, {sequence.motion}\n(no. {sequence.name})", fontsize=6)
    error = f"mean error {rollout.scores['error_mm']:.1f} mm"
    below[0].set_ylabel(f"predicted: {error}\n(red: {1e3 * MOST_ERROR:.0f} mm and more)", fontsize=6)


def _stage(rollout: ScoredRollout) -> Stage:
    sequence = rollout.sequence
    recorded, colour = sequence.positions[START : START + len(rollout.x)], fabric_colour(sequence.fabric)
    return Stage(recorded, sequence.file.dt, sequence.mesh.faces, sequence.body_faces, colour, HEIGHT)


def _show(axis: Axes, picture: np.ndarray) -> None:
    axis.imshow(picture, interpolation="nearest")
