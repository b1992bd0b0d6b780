"""The record of a finished evaluation: ``metrics.json``, written once and read by reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from drape.errors import DrapeError
from drape.metrics.fabric_metric import OVERALL
from drape.metrics.record import FILE, read_json, write_json

FORMAT = "drape evaluation"
VERSION = 1
MAPPINGS = ("method", "data", "metrics", "provenance")


@dataclass(frozen=True)
class EvaluationRecord:
    """Scores of one way to animate garments, and how they came about."""

    method: Mapping[str, Any]
    """``name`` (of the row of a table), and the settings ``simulator`` and, unless it is a baseline, ``energy``."""
    data: Mapping[str, Any]
    """What two evaluations must share to be compared: ``path``, ``source``, ``split``, ``sequences`` (their names),
    ``frames`` (simulated of each)."""
    metrics: Mapping[str, float]
    """``score_unit/kind`` and ``score_unit/overall``, with ``_std`` over sequences; ``sequences/kind``: how many;
    ``error_in_floors/kind`` where the data have a noise floor."""
    provenance: Mapping[str, Any]
    """``command``, ``seconds``, ``versions``, and whatever else helps."""
    folder: Path = field(default=Path(), compare=False)
    """Where it was read from; not stored."""

    @property
    def kinds(self) -> list[str]:
        """Kinds of garments that were animated."""
        names = [key.partition("/")[2] for key in self.metrics if key.startswith("sequences/")]
        return [name for name in names if name != OVERALL]

    def save(self, folder: Path | str) -> Path:
        """Write ``metrics.json``; the file is either whole or as it was."""
        content = {"format": FORMAT, "version": VERSION} | asdict(self)
        del content["folder"]
        return write_json(Path(folder) / FILE, content)

    @classmethod
    def load(cls, folder: Path | str) -> EvaluationRecord:
        """Read ``metrics.json`` of a folder.

        Raises:
            DrapeError: no such file, not JSON, another format, or an entry that is missing or of the wrong kind.
        """
        path = Path(folder) / FILE
        content = read_json(path)
        found = content.get("format"), content.get("version")
        if found != (FORMAT, VERSION):
            raise DrapeError(f"{path}: format and version are {found}; expected {(FORMAT, VERSION)}; evaluate again")
        for name in MAPPINGS:
            if not isinstance(content.get(name), dict):
                raise DrapeError(f"{path}: {name} is {content.get(name)!r}; expected a dict; evaluate again")
        return cls(**{name: content[name] for name in MAPPINGS}, folder=Path(folder))
