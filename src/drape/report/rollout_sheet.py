"""Animated garments below the recorded ones, at a few times, as one PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drape.data.look import fabric_colour
from drape.data.recorded_scene import START
from drape.metrics.rollout_scores import ScoredRollout
from drape.report.picture_sheet import Line, draw_pictures
from drape.report.stage import MOST_ERROR, Stage

TIMES = 6
"""Pictures of a sequence, at even times after the start."""
HEIGHT = 200
"""Of a picture [pixels]."""


def draw_rollout_sheet(rollouts: Sequence[ScoredRollout], path: Path) -> Path:
    """Two lines of pictures for each of ``rollouts``, the animated garment in the colours of its error."""
    return draw_pictures([line for rollout in rollouts for line in _pair(rollout)], path)


def _pair(rollout: ScoredRollout) -> tuple[Line, Line]:
    sequence, last = rollout.sequence, len(rollout.x) - 1
    recorded, colour = sequence.positions[START : START + len(rollout.x)], fabric_colour(sequence.fabric)
    stage = Stage(recorded, sequence.file.dt, sequence.mesh.faces, sequence.body_faces, colour, HEIGHT)
    frames = np.unique(np.linspace(max(1.0, last / TIMES), last, TIMES).round().astype(int)).tolist()
    bodies = [sequence.body_positions[START + frame] for frame in frames]
    shown = list(zip(frames, bodies, strict=True))
    error = f"mean error {rollout.scores['error_mm']:.1f} mm"
    return (
        Line(
            [stage.picture(frame, recorded[frame], body) for frame, body in shown],
            [frame * sequence.file.dt for frame in frames],
            f"{sequence.kind}, {sequence.fabric}, {sequence.motion}\n(no. {sequence.name})",
        ),
        Line(
            [stage.error_picture(frame, rollout.x[frame], body) for frame, body in shown],
            words=f"predicted: {error}\n(red: {1e3 * MOST_ERROR:.0f} mm and more)",
        ),
    )
