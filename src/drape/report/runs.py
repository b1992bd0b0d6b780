"""Finished runs, gathered: those that differ by their seed only are one configuration."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from drape.errors import DrapeError
from drape.metrics.record import FILE, EvaluationRecord, RunRecord, read_json
from drape.report.labels import seed_of, training_key
from drape.stored import reading

Read = TypeVar("Read")


def find_runs(folder: Path | str) -> list[RunRecord]:
    """All finished runs below ``folder``; of runs that say the same of themselves, the newest.

    A record that cannot be read is named on stderr and left out.

    Raises:
        DrapeError: there are none.
    """
    folder = Path(folder)
    paths = [path for path in _newest_last(folder) if not _is_evaluation(path)]
    runs = list(readable(lambda path: RunRecord.load(path.parent), paths))
    if not runs:
        raise DrapeError(f"{folder}: no finished run below it (no {FILE}); make one with: python src/train.py")
    newest = {(*_identity(run), run.seed): run for run in runs}
    return sorted(newest.values(), key=lambda run: str(run.folder))


def has_runs(folder: Path | str) -> bool:
    """Whether a finished training is below ``folder``."""
    return any(_format(path) == RunRecord.FORMAT for path in _newest_last(Path(folder)))


def find_evaluations(folder: Path | str) -> list[EvaluationRecord]:
    """All finished evaluations of garments below ``folder``; of those of one name, seed and data, the newest.

    A record that cannot be read is named on stderr and left out.
    """
    paths = [path for path in _newest_last(Path(folder)) if _is_evaluation(path)]
    found = list(readable(lambda path: EvaluationRecord.load(path.parent), paths))
    newest = {(record.method["name"], seed_of(record), _trained(record), repr(record.data)): record for record in found}
    return sorted(newest.values(), key=lambda record: str(record.folder))


def _trained(record: EvaluationRecord) -> tuple:
    """Key in which two evaluations of one name may differ and both count."""
    training = record.method.get("training")
    return training_key(training) if isinstance(training, Mapping) else ()


def _newest_last(folder: Path) -> list[Path]:
    return sorted(folder.rglob(FILE), key=lambda path: (path.stat().st_mtime, str(path)))


def _is_evaluation(path: Path) -> bool:
    return _format(path) == EvaluationRecord.FORMAT


def _format(path: Path) -> object:
    try:
        return read_json(path).get("format")
    except (DrapeError, OSError):  # told where the record is read
        return None


def readable(load: Callable[[Path], Read], paths: Iterable[Path]) -> Iterator[Read]:
    """Results of ``load`` for each file; those that cannot be read are told, and stop nobody."""
    for path in paths:
        try:
            with reading(path, "run it again"):
                found = load(path)
        except DrapeError as error:
            print(f"left out: {error}", file=sys.stderr)
        else:
            yield found


def _identity(run: RunRecord) -> tuple:
    return run.model, run.ablation, tuple(sorted(run.variant.items())), tuple(sorted(run.setting.items()))


@dataclass(frozen=True)
class Spread:
    """A number of several runs."""

    mean: float
    lowest: float
    highest: float


@dataclass(frozen=True)
class Configuration:
    """Runs of one configuration, one for each seed."""

    runs: tuple[RunRecord, ...]

    @property
    def model(self) -> str:
        return self.runs[0].model

    @property
    def ablation(self) -> str:
        return self.runs[0].ablation

    @property
    def variant(self) -> Mapping[str, str]:
        return self.runs[0].variant

    @property
    def setting(self) -> Mapping[str, str | int]:
        return self.runs[0].setting

    @property
    def seeds(self) -> list[int]:
        return sorted(run.seed for run in self.runs)

    def over_seeds(self, key: str) -> Spread | None:
        """Mean and range over the seeds of one metric; None where no run has it."""
        values = [run.metrics[key] for run in self.runs if key in run.metrics]
        return Spread(statistics.fmean(values), min(values), max(values)) if values else None


def configurations(runs: Iterable[RunRecord]) -> list[Configuration]:
    """Group runs that differ by their seed only."""
    groups: dict[tuple, list[RunRecord]] = {}
    for run in runs:
        groups.setdefault(_identity(run), []).append(run)
    return [Configuration(tuple(group)) for _, group in sorted(groups.items(), key=lambda item: repr(item[0]))]


def by_setting(found: Iterable[Configuration]) -> list[list[Configuration]]:
    """Configurations that may be compared, together."""
    groups: dict[tuple, list[Configuration]] = {}
    for configuration in found:
        groups.setdefault(tuple(sorted(configuration.setting.items())), []).append(configuration)
    return [group for _, group in sorted(groups.items(), key=lambda item: repr(item[0]))]
