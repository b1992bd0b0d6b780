"""Evaluations as rows of a table: what a row is called, its seeds averaged, how it was trained."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import yaml

from drape.metrics.fabric_metric import OVERALL
from drape.metrics.record import EvaluationRecord
from drape.report.labels import (
    budget_of,
    is_twin,
    plain_name,
    row_label,
    seed_of,
    settings,
    solver_label,
    training_key,
    training_of,
)
from drape.report.runs import Spread

PAPER = " (paper)"
"""After the label of a row whose numbers are the paper's."""
WITHOUT, NETWORKS, SOLVER, NO_CROSSING = "without dynamics", "networks", "solver", "solver, nothing crosses"
FAMILIES = (WITHOUT, NETWORKS, SOLVER, NO_CROSSING)
"""Kinds of ways to animate garments, in the order of tables."""
TOLD_APART_BY = ("scale", "iterations", "material", "name")
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

    @property
    def family(self) -> str:
        """One of :data:`FAMILIES`."""
        if self.training:
            return NETWORKS
        if not self.is_solver:
            return WITHOUT
        return NO_CROSSING if solver_label(self.records[0]).endswith("contact=ipc") else SOLVER

    @property
    def error(self) -> float:
        """Overall [mm]; infinite where no frame of it was finite."""
        error = self.over_seeds("error_mm")
        return math.inf if error is None else error.mean

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


def by_data(records: Sequence[EvaluationRecord]) -> list[list[EvaluationRecord]]:
    """Evaluations that may be compared, together: same file, split, sequences, frames; the most sequences first."""
    groups: dict[str, list[EvaluationRecord]] = {}
    for record in records:
        groups.setdefault(repr(sorted(record.data.items())), []).append(record)
    return sorted(groups.values(), key=lambda group: (-len(group[0].data["sequences"]), -len(group)))


def garment_rows(records: Sequence[EvaluationRecord]) -> list[GarmentRow]:
    """Rows of evaluations on the same data in the order of tables; labels say what rows do not share.

    Where their scales differ, each label of a trained simulator says its own.
    """
    groups: dict[tuple, list[EvaluationRecord]] = {}
    for record in records:
        groups.setdefault((training_key(training_of(record)), plain_name(record)), []).append(record)
    rows = []
    for group in groups.values():
        seeds = list(map(seed_of, group))
        parts = [group] if len(set(seeds)) == len(seeds) else [[record] for record in group]
        rows += [GarmentRow(row_label(part[0]), tuple(sorted(part, key=lambda r: seed_of(r) or 0))) for part in parts]
    return sorted(_told_apart(rows), key=place)


def place(row: GarmentRow) -> tuple:
    """Sorting key: the largest error first without dynamics, networks as the paper has them, solvers by budget."""
    family = FAMILIES.index(row.family)
    if row.is_twin:
        return len(FAMILIES), 0, row.label
    if row.training:
        return family, _papers_place(row), row.label
    if row.is_solver:
        return family, solver_label(row.records[0]), *budget_of(row.records[0]), row.label
    return family, -row.error, row.label


def _papers_place(row: GarmentRow) -> int:
    """Place in the paper's table of a trained simulator, or of that whose variant it is; the last of others."""
    names = list(published()["rows"])
    found = [name for name in names if row.label == name or row.label.startswith((f"{name} ", f"{name},"))]
    return names.index(max(found, key=len)) if found else len(names)


def noise_floor(rows: Sequence[GarmentRow]) -> float | None:
    """Mean error of the noise floor [mm], which every row on the same data says; None where the data have none."""
    return next((floor.mean for row in rows if (floor := row.over_seeds("floor_mm")) is not None), None)


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
    name = settings(row.training).get("name") or plain_name(row.records[0])
    return {key: str(row.training.get(key, "")) for key in TOLD_APART_BY[:-1]} | {"name": name}
