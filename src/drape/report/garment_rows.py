"""Evaluations as rows of a table: what a row is called, its seeds averaged, how it was trained."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import yaml

from drape.errors import DrapeError
from drape.metrics.fabric_metric import OVERALL
from drape.metrics.record import EvaluationRecord
from drape.report.rows import row_name
from drape.report.runs import Spread, seed_of
from drape.simulators.choice import chosen_budget

FLOOR = "noise floor (twin)"
TWIN = "drape.simulators.baselines.Twin"
PAPER = " (paper)"
"""After the label of a row whose numbers are the paper's."""
OF_SEED = re.compile(r"[\s_/-]*(seed|s)[_=-]?\d+$")
"""The end of a name that says the seed."""
OF_BUDGET = re.compile(r"(_\d+)?(_x\d+)?$")
"""The end of a name that says what a solver may spend."""
SPENT = {"iterations": "{} evaluations", "steps": "{} steps a frame"}
"""Words of labels for that."""
TOLD_APART_BY = ("scale", "iterations", "name")
"""Additions to labels that would be the same, in this order."""


@cache
def published() -> Mapping[str, Any]:
    """The paper's numbers of animated garments (``paper_animation.yaml``)."""
    return yaml.safe_load((resources.files("drape.report") / "paper_animation.yaml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class GarmentRow:
    """Evaluations on the same sequences that differ by the seed of their training only."""

    label: str
    records: tuple[EvaluationRecord, ...]
    """One for each seed, in their order."""

    @property
    def training(self) -> Mapping[str, Any]:
        """Training of its simulator; empty where there was none."""
        return training_of(self.records[0])

    @property
    def seeds(self) -> list[int]:
        """Of the trainings, sorted; empty where none is known."""
        return [seed for seed in map(seed_of, self.records) if seed is not None]

    @property
    def is_twin(self) -> bool:
        """Whether it is the noise floor."""
        return is_twin(self.records[0])

    @property
    def is_solver(self) -> bool:
        """Whether energies are minimised."""
        return "energy" in self.records[0].method and not self.training

    def over_seeds(self, score: str, name: str = OVERALL) -> Spread | None:
        """Mean and range over seeds of one score of one kind of garment; None where no record has it."""
        values = [float(r.metrics[f"{score}/{name}"]) for r in self.records if f"{score}/{name}" in r.metrics]
        return Spread(statistics.fmean(values), min(values), max(values)) if values else None

    def footnote(self) -> str:
        """One line: how it was trained; empty where nothing is known of that."""
        found, seeds = self.training, ", ".join(map(str, self.seeds))
        seconds = [float(t["seconds"]) for t in map(training_of, self.records) if "seconds" in t]
        parts = [
            f"scale {found['scale']}" if "scale" in found else "",
            f"{'seeds' if len(self.seeds) > 1 else 'seed'} {seeds}" if seeds else "",
            f"{found['iterations']} training steps" if "iterations" in found else "",
            f"{duration(statistics.fmean(seconds))} of training{' each' * (len(seconds) > 1)}" if seconds else "",
            f"{found['parameters']} parameters" if "parameters" in found else "",
            f"by {found['command']}" if "command" in found else "",
        ]
        told = ", ".join(filter(None, parts))
        return f"{self.label}: {told}" if told else ""


def duration(seconds: float) -> str:
    """In seconds, minutes or hours, whichever can be read."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def is_twin(record: EvaluationRecord) -> bool:
    """Whether an evaluation is that of the perturbed twins."""
    simulator = record.method["simulator"]
    return isinstance(simulator, Mapping) and simulator.get("_target_") == TWIN


def training_of(record: EvaluationRecord) -> Mapping[str, Any]:
    """``method["training"]``: row, label, ablation, scale, seed, iterations, seconds, parameters, command; or nothing.

    Raises:
        DrapeError: it is no mapping, or does not say which row it is.
    """
    found = record.method.get("training") or {}
    if not isinstance(found, Mapping) or (found and not isinstance(found.get("row"), str)):
        raise DrapeError(
            f"{record.folder}: method/training: found {found!r}; expected a mapping with at least the name of its row; "
            "evaluate again"
        )
    return found


def row_label(record: EvaluationRecord) -> str:
    """The label of a trained simulator, solver and energy, or else the name of the evaluation."""
    if is_twin(record):
        return FLOOR
    training = training_of(record)
    if not training:
        name = str(record.method["name"])
        return _solver(record) or (OF_SEED.sub("", name) if seed_of(record) is not None else name)
    return row_name(str(training.get("label", "")), training["row"], str(training.get("ablation", "none")))


def _solver(record: EvaluationRecord) -> str | None:
    """The label of a solver, with what it might spend, where the evaluation was not given a name."""
    label = published()["solvers"].get(OF_BUDGET.sub("", str(record.method["name"])))
    budget = chosen_budget(record.method["simulator"])
    return label and ", ".join([label, *(SPENT[name].format(value) for name, value in budget.items())])


def by_data(records: Sequence[EvaluationRecord]) -> list[list[EvaluationRecord]]:
    """Evaluations that may be compared, together: same file, split, sequences, frames; the most sequences first."""
    groups: dict[str, list[EvaluationRecord]] = {}
    for record in records:
        groups.setdefault(repr(sorted(record.data.items())), []).append(record)
    return sorted(groups.values(), key=lambda group: (-len(group[0].data["sequences"]), -len(group)))


def garment_rows(records: Sequence[EvaluationRecord]) -> list[GarmentRow]:
    """Rows of evaluations on the same data, the largest error first; labels say what rows do not share.

    Where their scales differ, each label of a trained simulator says its own.
    """
    groups: dict[tuple, list[EvaluationRecord]] = {}
    for record in records:
        training = training_of(record)
        kept = (training.get("row"), training.get("ablation"), training.get("scale"), training.get("iterations"))
        name = str(record.method["name"])
        groups.setdefault((*kept, OF_SEED.sub("", name) if seed_of(record) is not None else name), []).append(record)
    rows = []
    for group in groups.values():
        seeds = list(map(seed_of, group))
        parts = [group] if len(set(seeds)) == len(seeds) else [[record] for record in group]
        rows += [GarmentRow(row_label(part[0]), tuple(sorted(part, key=lambda r: seed_of(r) or 0))) for part in parts]
    return sorted(_told_apart(rows), key=_error, reverse=True)


def noise_floor(rows: Sequence[GarmentRow]) -> float | None:
    """Mean error of the noise floor [mm], which every row on the same data says; None where the data have none."""
    return next((floor.mean for row in rows if (floor := row.over_seeds("floor_mm")) is not None), None)


def _error(row: GarmentRow) -> float:
    """Overall [mm]; infinite where no frame of it was finite."""
    error = row.over_seeds("error_mm")
    return math.inf if error is None else error.mean


def scales(rows: Sequence[GarmentRow]) -> list[str]:
    """Different scales of trained simulators among ``rows``."""
    return sorted({str(row.training["scale"]) for row in rows if "scale" in row.training})


def _told_apart(rows: Sequence[GarmentRow]) -> list[GarmentRow]:
    told = []
    for row in rows:
        same = [_marks(other) for other in rows if other.label == row.label]
        differing = [key for key in TOLD_APART_BY if len({marks[key] for marks in same}) > 1]
        if len(scales(rows)) > 1 and row.training.get("scale") is not None:
            differing = ["scale", *(key for key in differing if key != "scale")]
        marks = ", ".join(f"{key} {_marks(row)[key]}" for key in differing if _marks(row)[key])
        told.append(GarmentRow(f"{row.label} [{marks}]" if marks else row.label, row.records))
    return told


def _marks(row: GarmentRow) -> dict[str, str]:
    name = OF_SEED.sub("", str(row.records[0].method["name"]))
    return {key: str(row.training.get(key, "")) for key in TOLD_APART_BY[:-1]} | {"name": name}
