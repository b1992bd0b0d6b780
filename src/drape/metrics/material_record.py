"""The record of a finished training of EST: ``estimates.json``; ``${estimates:<path>}`` reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from drape.metrics.record import write_json

FILE = "estimates.json"


@dataclass(frozen=True)
class MaterialRecord:
    """Materials of PHYS that stand for fabrics."""

    estimates: Mapping[str, Mapping[str, float]]
    """By fabric: the numbers of :class:`drape.energy.phys_material.PhysMaterial`."""
    residuals: Mapping[str, Mapping[str, float]]
    """By fabric: mean residual force over the weight in the test split; see ``MaterialDataModule.residuals``."""
    provenance: Mapping[str, object]
    """``command``, ``data``, ``seed``, ``frames``, ``steps``, ``seconds``, ``versions``."""

    def save(self, folder: Path | str) -> Path:
        """Write ``estimates.json``; the file is either whole or as it was."""
        return write_json(Path(folder) / FILE, asdict(self))
