"""The scores of one animated sequence, and the file next to its frames that keeps them."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.data.whole_file import whole_file
from drape.metrics.garment_scores import SCORES, sequence_scores

OF_SEQUENCE = ("ms_per_frame", "converged_percent")
"""Scores of a sequence beside the means of its frames."""
UNREADABLE = (OSError, ValueError, KeyError, TypeError)
"""Errors that a damaged file of scores may raise; then they are computed again."""


@dataclass(frozen=True, eq=False)
class ScoredSequence:
    """Measurements of one sequence."""

    name: str
    kind: str
    fabric: str
    motion: str
    num_vertices: int
    by_frame: dict[str, Float[np.ndarray, " frames"]]
    """Each of :data:`SCORES` at frames 1, 2, ... of the scene; NaN where it was not measured."""
    ms_per_frame: float
    """Of the simulator alone, median over the frames [ms]."""
    converged_percent: float
    """Frames whose step converged [%]."""

    @property
    def num_frames(self) -> int:
        """Simulated frames."""
        return len(self.by_frame["error_mm"])

    @property
    def scores(self) -> dict[str, float]:
        """One number for each score, and for each of :data:`OF_SEQUENCE`."""
        return sequence_scores(self.by_frame) | {name: getattr(self, name) for name in OF_SEQUENCE}

    def row(self) -> dict[str, object]:
        """Of a table of sequences."""
        about = {"sequence": self.name, "kind": self.kind, "fabric": self.fabric, "motion": self.motion}
        return {**about, "vertices": self.num_vertices, "frames": self.num_frames, **self.scores}

    def frame_rows(self) -> Iterator[dict[str, object]]:
        """Of a table of frames."""
        for k in range(self.num_frames):
            about = {"sequence": self.name, "kind": self.kind, "frame": k + 1}
            yield about | {name: float(values[k]) for name, values in self.by_frame.items()}


def by_frame(scored: Sequence[ScoredSequence], score: str) -> Float[np.ndarray, "sequences frames"]:
    """One row for each sequence; NaN after its end, and where nothing was measured."""
    rows = np.full((len(scored), max(each.num_frames for each in scored)), np.nan)
    for row, each in zip(rows, scored, strict=True):
        row[: each.num_frames] = each.by_frame[score]
    return rows


def mean_by_frame(scored: Sequence[ScoredSequence], score: str) -> Float[np.ndarray, " frames"]:
    """Mean over the sequences that have a number at the frame; NaN where none has."""
    rows = by_frame(scored, score)
    known = np.isfinite(rows)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, rows, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def write_rows(path: Path, rows: list[dict[str, object]]) -> Path:
    """A CSV file of rows that have the same columns; it is whole or as it was."""
    with whole_file(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def read_by_frame(path: Path, frames: int) -> dict[str, Float[np.ndarray, " frames"]] | None:
    """Scores that :func:`write_rows` has kept; None where there are none of these frames and scores."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        found = {name: np.array([float(row[name]) for row in rows]) for name in SCORES}
    except UNREADABLE:
        return None
    return found if len(rows) == frames else None
