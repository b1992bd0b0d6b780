"""Tables of animated garments: the kinds of one evaluation, and several evaluations side by side with the paper."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from drape.metrics.evaluation_record import EvaluationRecord
from drape.metrics.fabric_metric import OVERALL
from drape.report.table import Table, number
from drape.report.tables import paper

KINDS = ("tshirt", "top", "jumpsuit", "dress", "skirt", "trousers")
"""In the order of tables; others come after them."""
COLUMNS = {
    "error_mm": "error [mm]",
    "error_in_floors": "floors",
    "collision_percent": "collision [%]",
    "inside_percent": "inside [%]",
    "self_intersection_percent": "crossed [%]",
    "stretch": "stretch",
    "stretch_p99": "99 %",
    "ms_per_frame": "ms/frame",
}
"""Score -> column of the table of one evaluation."""
SHOWN = ("collision_percent", "inside_percent", "ms_per_frame")
"""Columns of the comparison beside the errors."""
WITH_SPREAD = ("error_mm", "floor_mm", "collision_percent")
"""What the paper gives with its standard deviation."""
FLOOR = "noise floor (twin)"
TWIN = "drape.simulators.twin.Twin"


def arranged(kinds: Iterable[str]) -> list[str]:
    """Kinds in the order of tables."""
    return sorted(set(kinds), key=lambda kind: (KINDS.index(kind) if kind in KINDS else len(KINDS), kind))


def kinds_table(record: EvaluationRecord) -> Table:
    """One evaluation: a row for each kind of garment and one for all."""
    names = [*arranged(record.kinds), OVERALL]
    scores = [score for score in COLUMNS if any(f"{score}/{name}" in record.metrics for name in names)]
    rows = tuple(
        (
            f"{name} ({record.metrics[f'sequences/{name}']:.0f})",
            *(_cell(record.metrics, score, name) for score in scores),
        )
        for name in names
    )
    columns = ("garment", *(COLUMNS[score] for score in scores))
    note = (
        f"{record.data['path']}, {record.data['split']}, {_frames(record)} from two recorded ones. Mean over vertices "
        "and frames of a sequence, then mean ± standard deviation over sequences (their number in brackets). Floors: "
        "error in units of the noise floor; collision: behind the nearest vertex of the body, as the paper counts; "
        "inside: by signed distance; crossed: faces that pass through others; stretch: of edges, mean and 99th "
        "percentile."
    )
    return Table(str(record.method["name"]), columns, rows, note)


def comparison_tables(records: Sequence[EvaluationRecord]) -> list[Table]:
    """A table for each choice of sequences: evaluations of it by kinds, the noise floor, and the paper's numbers."""
    groups: dict[str, list[EvaluationRecord]] = {}
    for record in records:
        groups.setdefault(repr(sorted(record.data.items())), []).append(record)
    largest_first = sorted(groups.values(), key=lambda group: (-len(group[0].data["sequences"]), -len(group)))
    return [_comparison(group, with_paper=k == 0) for k, group in enumerate(largest_first)]


def _comparison(records: Sequence[EvaluationRecord], *, with_paper: bool) -> Table:
    names = [*arranged(kind for record in records for kind in record.kinds), OVERALL]
    worst_first = sorted(records, key=lambda record: -record.metrics[f"error_mm/{OVERALL}"])
    rows = [
        (
            FLOOR if _is_twin(record) else str(record.method["name"]),
            *(_cell(record.metrics, "error_mm", name) for name in names),
            _cell(record.metrics, "error_in_floors", OVERALL),
            *(_cell(record.metrics, score, OVERALL) for score in SHOWN),
        )
        for record in worst_first
    ]
    floors = next((record.metrics for record in records if f"floor_mm/{OVERALL}" in record.metrics), None)
    if floors is not None and not any(map(_is_twin, records)):
        rows.append((FLOOR, *(_cell(floors, "floor_mm", name) for name in names), "1", *("" for _ in SHOWN)))
    rows += _paper_rows(names) if with_paper else []
    data = records[0].data
    note = (
        f"Mean over vertices and frames, then mean ± standard deviation over sequences [mm]. {len(data['sequences'])} "
        f"sequences of {data['path']} ({data['source']}), {_frames(records[0])} each from two recorded ones. "
        "Floors: error in units of the noise floor."
    )
    if with_paper:
        note += f" Numbers in the paper, of other garments: {paper()['garments']['source']}."
    columns = ("method", *names, "floors", *(COLUMNS[score] for score in SHOWN))
    return Table(f"Garments: Euclidean error, {data['split']}", columns, tuple(rows), note)


def _paper_rows(names: Sequence[str]) -> list[tuple[str, ...]]:
    rows = []
    for method, published in paper()["garments"]["rows"].items():
        cells = ["{:.2f} ± {:.2f}".format(*published[name]) if name in published else "" for name in names]
        collision = "{:.2f} ± {:.2f}".format(*published["collision"])
        rows.append((f"{method} (paper)", *cells, "", collision, *("" for _ in SHOWN[1:])))
    return rows


def _is_twin(record: EvaluationRecord) -> bool:
    return record.method["simulator"].get("_target_") == TWIN


def _frames(record: EvaluationRecord) -> str:
    least, most = min(record.data["frames"]), max(record.data["frames"])
    return f"{most} frames" if least == most else f"{least} to {most} frames"


def _cell(metrics: Mapping[str, float], score: str, name: str) -> str:
    mean, deviation = metrics.get(f"{score}/{name}"), metrics.get(f"{score}_std/{name}")
    if mean is None:
        return ""
    return number(mean) + (f" ± {number(deviation)}" if score in WITH_SPREAD and deviation is not None else "")
