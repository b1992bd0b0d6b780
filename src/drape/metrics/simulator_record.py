"""The record of a simulator's finished training: ``simulator.json``; evaluations quote it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drape.metrics.record import write_json

FILE = "simulator.json"
FORMAT = "drape simulator"
VERSION = 1


@dataclass(frozen=True)
class SimulatorRecord:
    """How a simulator came about, and how its last validation went."""

    training: Mapping[str, Any]
    """``row`` (option of the group ``model``), ``ablation``, ``scale``, ``seed``, ``iterations``, ``seconds``,
    ``parameters``, ``command``, ..."""
    watched: Mapping[str, float]
    """Scores of the sequences that were watched; see :func:`drape.metrics.rollout_scores.rollout_scores`."""

    def save(self, folder: Path | str) -> Path:
        """Write ``simulator.json``; the file is either whole or as it was."""
        return write_json(Path(folder) / FILE, {"format": FORMAT, "version": VERSION} | asdict(self))
