"""Records of what has finished: JSON files that trainings and evaluations write once and reports read."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from drape.errors import DrapeError
from drape.metrics.fabric_metric import OVERALL

FILE = "metrics.json"
"""Of trainings of energies, and of evaluations."""
VERSION = 1
VARIANT = {"potential": "model/potential", "dissipation": "model/dissipation", "loss": "loss"}
"""Name in ``variant`` of a record -> config group."""


@dataclass(frozen=True)
class RunRecord:
    """The result of one training of an energy and how it came about."""

    FORMAT: ClassVar[str] = "drape run"
    model: str
    """Option of the group ``model``, e.g. eunet."""
    ablation: str
    """Option of the group ``ablation``; several joined by ``+``."""
    seed: int
    variant: Mapping[str, str]
    """Options of the groups of :data:`VARIANT`, which make it another model or another training."""
    setting: Mapping[str, str | int]
    """Settings that comparable runs share: ``data``, ``material``, ``scale``, ``width``, ``steps`` (those done)."""
    metrics: Mapping[str, float]
    """On the test split: ``quantity_unit/fabric`` and ``quantity_unit/overall``."""
    provenance: Mapping[str, Any]
    """``command`` ("python src/train.py" and Hydra's task overrides), ``data`` (path), ``train_sequences``,
    ``test_sequences``, ``seconds`` (of training), ``parameters``, ``versions`` (by package) and whatever else helps."""
    label: str = ""
    """Name in reports; empty in records of before there were labels."""
    folder: Path = field(default=Path(), compare=False)
    """Folder that it was read from; not stored."""

    def save(self, folder: Path | str) -> Path:
        """Write ``metrics.json``; the file is either whole or as it was."""
        return _save(self, folder)

    @classmethod
    def load(cls, folder: Path | str) -> RunRecord:
        """Read ``metrics.json`` of a folder.

        Raises:
            DrapeError: no such file, not JSON, another format, or an entry that is missing or of the wrong kind.
        """
        path = Path(folder) / FILE
        kinds = {"model": str, "label": str, "ablation": str, "seed": int}
        kinds |= dict.fromkeys(("variant", "setting", "metrics", "provenance"), dict)
        content = _load(path, cls.FORMAT, kinds, "run it again", {"label": ""})
        for mapping, name in REQUIRED:
            if name not in content[mapping]:
                raise DrapeError(f"{path}: {mapping} has no {name}; it has {', '.join(content[mapping])}; run it again")
        return cls(**content, folder=Path(folder))


REQUIRED = (
    *(("setting", name) for name in ("data", "scale", "width", "steps")),
    *(("provenance", name) for name in ("command", "data", "train_sequences", "test_sequences", "seconds", "versions")),
)
"""Entries that every run has."""


@dataclass(frozen=True)
class EvaluationRecord:
    """Scores of one way to animate garments, and how they came about."""

    FORMAT: ClassVar[str] = "drape evaluation"
    method: Mapping[str, Any]
    """``name`` (of the row of a table), and the settings ``simulator`` and, unless it is a baseline, ``energy``."""
    data: Mapping[str, Any]
    """Common ground of evaluations that may be compared: ``path``, ``source``, ``split``, ``sequences`` (their names),
    ``frames`` (simulated of each)."""
    metrics: Mapping[str, float]
    """``score_unit/kind`` and ``score_unit/overall``, with ``_std`` over sequences; ``sequences/kind``: how many;
    ``error_in_floors/kind`` where the data have a noise floor."""
    provenance: Mapping[str, Any]
    """``command``, ``seconds``, ``versions``, and whatever else helps."""
    folder: Path = field(default=Path(), compare=False)
    """Folder that it was read from; not stored."""

    @property
    def kinds(self) -> list[str]:
        """Kinds of garments that were animated."""
        names = [key.partition("/")[2] for key in self.metrics if key.startswith("sequences/")]
        return [name for name in names if name != OVERALL]

    def save(self, folder: Path | str) -> Path:
        """Write ``metrics.json``; the file is either whole or as it was."""
        return _save(self, folder)

    @classmethod
    def load(cls, folder: Path | str) -> EvaluationRecord:
        """Read ``metrics.json`` of a folder.

        Raises:
            DrapeError: no such file, not JSON, another format, or an entry that is missing or of the wrong kind.
        """
        kinds = dict.fromkeys(("method", "data", "metrics", "provenance"), dict)
        return cls(**_load(Path(folder) / FILE, cls.FORMAT, kinds, "evaluate again"), folder=Path(folder))


@dataclass(frozen=True)
class MaterialRecord:
    """Materials of PHYS that stand for fabrics, as EST has estimated them; ``${estimates:<path>}`` reads it."""

    FILE: ClassVar[str] = "estimates.json"
    estimates: Mapping[str, Mapping[str, float]]
    """By fabric: the numbers of :class:`drape.energy.phys_material.PhysMaterial`."""
    residuals: Mapping[str, Mapping[str, float]]
    """By fabric: mean residual force over the weight in the test split; see ``MaterialDataModule.residuals``."""
    provenance: Mapping[str, Any]
    """``command``, ``data``, ``seed``, ``frames``, ``steps``, ``seconds``, ``versions``."""

    def save(self, folder: Path | str) -> Path:
        """Write ``estimates.json``; the file is either whole or as it was."""
        return write_json(Path(folder) / self.FILE, asdict(self))


@dataclass(frozen=True)
class SimulatorRecord:
    """Origin of a simulator and the scores of its last validation; evaluations quote it."""

    FILE: ClassVar[str] = "simulator.json"
    FORMAT: ClassVar[str] = "drape simulator"
    training: Mapping[str, Any]
    """``row`` (option of the group ``model``), ``label``, ``ablation``, ``scale``, ``seed``, ``iterations``,
    ``seconds``, ``parameters``, ``command``, ..."""
    watched: Mapping[str, float]
    """Scores of the sequences that were watched; see :func:`drape.metrics.rollout_scores.rollout_scores`."""

    def save(self, folder: Path | str) -> Path:
        """Write ``simulator.json``; the file is either whole or as it was."""
        content = {"format": self.FORMAT, "version": VERSION} | asdict(self)
        return write_json(Path(folder) / self.FILE, content)


def _save(record: RunRecord | EvaluationRecord, folder: Path | str) -> Path:
    content = {"format": record.FORMAT, "version": VERSION} | asdict(record)
    del content["folder"]
    return write_json(Path(folder) / FILE, content)


def _load(
    path: Path, form: str, kinds: Mapping[str, type], again: str, otherwise: Mapping[str, Any] | None = None
) -> dict:
    """The entries of a record that ``kinds`` names; ``otherwise``: those that older records lack."""
    content = {**(otherwise or {}), **read_json(path)}
    found = content.get("format"), content.get("version")
    if found != (form, VERSION):
        raise DrapeError(f"{path}: format and version are {found}; expected {(form, VERSION)}; {again}")
    for name, kind in kinds.items():
        if not isinstance(content.get(name), kind):
            raise DrapeError(f"{path}: {name} is {content.get(name)!r}; expected {kind.__name__}; {again}")
    return {name: content[name] for name in kinds}


def write_json(path: Path, content: Mapping) -> Path:
    """Write ``content``; the file is either whole or as it was."""
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        temporary.write_text(json.dumps(content, indent=2, default=str) + "\n")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def read_json(path: Path) -> dict:
    """The object that a finished run has left behind.

    Raises:
        DrapeError: no such file, or not JSON.
    """
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; a run has it when it is finished (python src/train.py)")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise DrapeError(f"{path}: not JSON ({error}); delete it and run the training again") from None
    if not isinstance(content, dict):
        raise DrapeError(f"{path}: holds a {type(content).__name__}; expected an object; run the training again")
    return content
