"""Tables of animated garments: the kinds of one evaluation, and several evaluations side by side with the paper."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from drape.metrics.fabric_metric import OVERALL
from drape.metrics.record import EvaluationRecord
from drape.report.garment_rows import PAPER, GarmentRow, by_data, garment_rows, published, scales
from drape.report.labels import FLOOR, row_label
from drape.report.table import Table, number
from drape.report.tables import OVER_SEEDS, spread_cell

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
    "hem_times": "hems",
    "ms_per_frame": "ms/frame",
}
"""Score -> column of the table of one evaluation."""
SHOWN = ("collision_percent", "inside_percent", "hem_times", "ms_per_frame")
"""Columns of the comparison, after the errors."""
WITH_SPREAD = ("error_mm", "floor_mm", "collision_percent")
"""Scores that the paper gives with their standard deviation."""


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
        "percentile; hems: angle between neighbouring edges of the boundary, over the recorded one."
    )
    return Table(str(record.method["name"]), columns, rows, note)


def comparison_tables(records: Sequence[EvaluationRecord]) -> list[Table]:
    """A table for each choice of sequences: evaluations of it by kinds, the noise floor, and the paper's numbers."""
    return [comparison_table(group, with_paper=k == 0) for k, group in enumerate(by_data(records))]


def garment_tables(records: Sequence[EvaluationRecord]) -> list[Table]:
    """For each choice of sequences the paper's tables and that of all evaluations; never two choices in one table."""
    groups = by_data(records)
    return [
        table
        for k, group in enumerate(groups)
        for table in (*animation_tables(group), comparison_table(group, with_paper=k == 0))
    ]


def comparison_table(records: Sequence[EvaluationRecord], *, with_paper: bool = False) -> Table:
    """All evaluations of the same sequences, seeds averaged, in the order of :func:`garment_rows`."""
    rows, names = garment_rows(records), _names(records)
    seeded = any(row.seeds for row in rows)
    cells = [_comparison_cells(row, names, seeded) for row in rows]
    floors = next((record.metrics for record in records if f"floor_mm/{OVERALL}" in record.metrics), None)
    if floors is not None and not any(row.is_twin for row in rows):
        empty = [""] * (len(SHOWN) + seeded)
        cells.append((FLOOR, *(_cell(floors, "floor_mm", name) for name in names), "1", *empty))
    if with_paper:
        empty = [""] * (len(SHOWN) - 1 + seeded)
        cells += [
            (f"{row}{PAPER}", *_published(row, names), "", _published(row, ["collision"])[0], *empty)
            for row in published()["rows"]
        ]
    columns = ("method", *names, "floors", *(COLUMNS[score] for score in SHOWN), *["seeds"] * seeded)
    note = f"{_described(records)} Floors: error in units of the noise floor.{_of_several(rows)}"
    note += f" {_of_paper()}" if with_paper else ""
    title = f"Garments: Euclidean error, {records[0].data['split']}"
    return Table(title, columns, tuple(cells), note, tuple(filter(None, (row.footnote() for row in rows))))


def animation_tables(records: Sequence[EvaluationRecord]) -> list[Table]:
    """Both tables of the paper for evaluations of the same sequences, ours above the paper's; then the solvers.

    Nothing where no simulator of the paper was evaluated on them.
    """
    rows, tables = garment_rows(records), []
    names = [*arranged({*_names(records)[:-1], *published()["kinds"]}), OVERALL]
    for table in published()["tables"]:
        ours = {
            name: [row for row in rows if row.training and row_label(row.records[0]) == name] for name in table["rows"]
        }
        if not any(ours.values()):
            continue
        cells = []
        for name, found in ours.items():
            cells += [_animation_cells(row, names) for row in found]
            cells.append((f"{name}{PAPER}", "", *_published(name, [*names, "collision"])))
        others = [row for row in rows if row.is_solver]
        cells += [_animation_cells(row, names) for row in others]
        shown = [*(row for found in ours.values() for row in found), *others]
        note = f"{_described(records)}{_of_several(shown)} {_of_paper(table)}"
        title = f"{table['title']}: Euclidean error [mm], ours beside the paper's"
        columns = ("method", "seeds", *names, COLUMNS["collision_percent"])
        tables.append(Table(title, columns, tuple(cells), note, tuple(filter(None, (r.footnote() for r in shown)))))
    return tables


def _names(records: Sequence[EvaluationRecord]) -> list[str]:
    return [*arranged(kind for record in records for kind in record.kinds), OVERALL]


def _described(records: Sequence[EvaluationRecord]) -> str:
    data = records[0].data
    return (
        f"Mean over vertices and frames, then mean ± standard deviation over sequences [mm]. {len(data['sequences'])} "
        f"sequences of {data['path']} ({data['source']}), split {data['split']}, {_frames(records[0])} each from two "
        "recorded ones."
    )


def _of_several(rows: Sequence[GarmentRow]) -> str:
    averaged, found = any(len(row.records) > 1 for row in rows), scales(rows)
    several = f" {OVER_SEEDS} The deviation over sequences is then a mean over seeds." if averaged else ""
    differ = f" Trained at different scales ({', '.join(found)}): compare rows of one scale." if len(found) > 1 else ""
    return several + differ


def _of_paper(table: Mapping[str, str] | None = None) -> str:
    about = published()
    place = f", {table['place']} ({table['label']})" if table else ", its tables of animation"
    other = f"Rows marked{PAPER} are of other garments, {about['frames']} frames of {about['data']}"
    return f"{other}: {about['source']}{place}."


def _comparison_cells(row: GarmentRow, names: Sequence[str], seeded: bool) -> tuple[str, ...]:
    errors = [_spread(row, "error_mm", name) for name in names]
    shown = [_spread(row, score) for score in SHOWN]
    seeds = [str(len(row.seeds) or "")] * seeded
    return (row.label, *errors, _spread(row, "error_in_floors"), *shown, *seeds)


def _animation_cells(row: GarmentRow, names: Sequence[str]) -> tuple[str, ...]:
    errors = [_spread(row, "error_mm", name) for name in names]
    return (row.label, str(len(row.seeds) or ""), *errors, _spread(row, "collision_percent"))


def _published(name: str, columns: Sequence[str]) -> list[str]:
    row = published()["rows"][name]
    return ["{:.2f} ± {:.2f}".format(*row[column]) if column in row else "" for column in columns]


def _spread(row: GarmentRow, score: str, name: str = OVERALL) -> str:
    """Mean over seeds, the mean of the deviations over sequences where they are shown, the range over seeds."""
    mean, deviation = row.over_seeds(score, name), row.over_seeds(f"{score}_std", name)
    return spread_cell(mean, deviation if score in WITH_SPREAD else None)


def _frames(record: EvaluationRecord) -> str:
    least, most = min(record.data["frames"]), max(record.data["frames"])
    return f"{most} frames" if least == most else f"{least} to {most} frames"


def _cell(metrics: Mapping[str, float], score: str, name: str) -> str:
    mean, deviation = metrics.get(f"{score}/{name}"), metrics.get(f"{score}_std/{name}")
    if mean is None:
        return ""
    return number(mean) + (f" ± {number(deviation)}" if score in WITH_SPREAD and deviation is not None else "")
