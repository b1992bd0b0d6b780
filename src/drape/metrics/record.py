"""The record of a finished run: ``metrics.json``, written by training and read by reports."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from drape.errors import DrapeError

FILE = "metrics.json"
FORMAT = "drape run"
VERSION = 1


@dataclass(frozen=True)
class RunRecord:
    """The result of one training and how it came about."""

    model: str
    """Option of the group ``model``, e.g. eunet."""
    ablation: str
    """Option of the group ``ablation``; several joined by ``+``."""
    seed: int
    variant: Mapping[str, str]
    """Other choices that make it another model or another training: ``{"potential": "mlp", "loss": "paper"}``."""
    setting: Mapping[str, str | int]
    """What two runs must share to be compared: ``data``, ``material``, ``scale``, ``width``, ``steps`` (those done)."""
    metrics: Mapping[str, float]
    """On the test split: ``quantity_unit/fabric`` and ``quantity_unit/overall``."""
    provenance: Mapping[str, Any]
    """``command`` ("python src/train.py" and Hydra's task overrides), ``data`` (path), ``train_sequences``,
    ``test_sequences``, ``seconds`` (of training), ``parameters``, ``versions`` (by package) and whatever else helps."""
    folder: Path = field(default=Path(), compare=False)
    """Where it was read from; not stored."""

    def save(self, folder: Path | str) -> Path:
        """Write ``metrics.json``; the file is either whole or as it was."""
        content = {"format": FORMAT, "version": VERSION} | asdict(self)
        del content["folder"]
        return write_json(Path(folder) / FILE, content)

    @classmethod
    def load(cls, folder: Path | str) -> RunRecord:
        """Read ``metrics.json`` of a folder.

        Raises:
            DrapeError: no such file, not JSON, another format, or an entry that is missing or of the wrong kind.
        """
        path = Path(folder) / FILE
        content = read_json(path)
        found = content.get("format"), content.get("version")
        if found != (FORMAT, VERSION):
            raise DrapeError(f"{path}: format and version are {found}; expected {(FORMAT, VERSION)}; run it again")
        kinds = {"model": str, "ablation": str, "seed": int} | dict.fromkeys(MAPPINGS, dict)
        for name, kind in kinds.items():
            if not isinstance(content.get(name), kind):
                raise DrapeError(f"{path}: {name} is {content.get(name)!r}; expected {kind.__name__}; run it again")
        for mapping, name in REQUIRED:
            if name not in content[mapping]:
                raise DrapeError(f"{path}: {mapping} has no {name}; it has {', '.join(content[mapping])}; run it again")
        return cls(**{name: content[name] for name in kinds}, folder=Path(folder))


MAPPINGS = ("variant", "setting", "metrics", "provenance")
REQUIRED = (
    *(("setting", name) for name in ("data", "scale", "width", "steps")),
    *(("provenance", name) for name in ("command", "data", "train_sequences", "test_sequences", "seconds", "versions")),
)


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
