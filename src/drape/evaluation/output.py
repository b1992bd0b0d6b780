"""The output files of an evaluation: numbers for people, spreadsheets and reports."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from drape.energy.law.checkpoint import versions
from drape.evaluation.board import write_board
from drape.evaluation.method import Method
from drape.evaluation.scored_sequence import OF_SEQUENCE, ScoredSequence, write_rows
from drape.metrics.fabric_metric import OVERALL
from drape.metrics.garment_metric import GarmentMetric
from drape.metrics.garment_scores import SCORES
from drape.metrics.record import EvaluationRecord


def save(
    scored: Sequence[ScoredSequence], method: Method, name: str, split: str, command: str, folder: Path
) -> EvaluationRecord:
    """Write ``sequences.csv`` (a row for each), ``by_frame.csv`` (a row for each of their frames), ``metrics.json``.

    ``tensorboard/`` has the means by frame as curves.
    """
    write_rows(folder / "sequences.csv", [each.row() for each in scored])
    write_rows(folder / "by_frame.csv", [row for each in scored for row in each.frame_rows()])
    settings = method.settings(method.file.sequence(scored[0].name))
    record = EvaluationRecord(
        method={"name": name} | {node: values for node, values in settings.items() if node not in ("data", "fabric")},
        data={
            "path": str(method.file.path),
            "source": method.file.source,
            "split": split,
            "sequences": [each.name for each in scored],
            "frames": [each.num_frames for each in scored],
        },
        metrics=summarised(scored),
        provenance={"command": command, "versions": versions()},
    )
    record.save(folder)
    write_board(scored, folder)
    return record


def summarised(scored: Sequence[ScoredSequence]) -> dict[str, float]:
    """Means and deviations over sequences by :class:`GarmentMetric`, ``sequences/<kind>``, ``error_in_floors/<kind>``.

    An error in units of the noise floor is the mean error over the mean error of the twins.
    """
    kinds = list(dict.fromkeys(each.kind for each in scored))
    metric = GarmentMetric(kinds, [*SCORES, *OF_SEQUENCE])
    for each in scored:
        metric.update(each.kind, each.scores)
    found = metric.compute()
    for kind in (*kinds, OVERALL):
        found[f"sequences/{kind}"] = float(sum(kind in (each.kind, OVERALL) for each in scored))
        if found.get(f"floor_mm/{kind}"):
            found[f"error_in_floors/{kind}"] = found[f"error_mm/{kind}"] / found[f"floor_mm/{kind}"]
    return found
