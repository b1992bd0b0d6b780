"""Tables of a set of finished runs, with the paper's numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any

import yaml

from drape.metrics.fabric_metric import OVERALL
from drape.report.labels import departing, row, row_name, settings
from drape.report.runs import Configuration, Spread
from drape.report.table import Table, number

OVER_SEEDS = "Means over seeds, in brackets the range over seeds of the mean."
OF_PAPER = "– in the paper"
"""Label of the row below ours with the paper's numbers."""
BASELINES = {"inertial_force_N": "no internal force", "spring_hinge_residual_N": "fitted spring-hinge law"}
"""Rows that a force residual is compared with."""
TableOf = Callable[[Sequence[Configuration]], Table]
"""Makes a table of configurations that share their setting; ``conf/tables/`` lists them."""


@cache
def paper() -> Mapping[str, Any]:
    """The published numbers (``paper.yaml``)."""
    return yaml.safe_load((resources.files("drape.report") / "paper.yaml").read_text(encoding="utf-8"))


def departures(configuration: Configuration) -> dict[str, str]:
    """Choices in which a configuration differs from what its row is made of."""
    expected = row(configuration.model, configuration.ablation)
    made_of = expected.options if expected else {}
    return {name: choice for name, choice in configuration.variant.items() if made_of.get(name) != choice}


def is_papers(configuration: Configuration) -> bool:
    """Whether the paper has a number for this configuration."""
    return label(configuration) in paper()["rows"]


def label(configuration: Configuration) -> str:
    """Name of a configuration: what ``label=...`` has called it, or that of its row, and what else differs."""
    run = configuration.runs[-1]
    name = row_name(run.label, configuration.model, configuration.ablation)
    return departing(name, {} if "label" in settings(run.provenance) else departures(configuration))


def arranged(found: Sequence[Configuration], ablations: Sequence[str]) -> list[Configuration]:
    """The paper's way first, the ablations of a model together and in the given order."""
    rank = {name: place for place, name in enumerate(ablations)}

    def place(configuration: Configuration) -> tuple:
        other = departures(configuration)
        others = configuration.model != paper()["model"]
        return others, configuration.model, sorted(other.items()), rank.get(configuration.ablation, len(rank))

    return sorted(found, key=place)


def columns(found: Sequence[Configuration], key: str) -> list[str]:
    """Overall, then the fabrics of ``key``: the paper's in its order, then others."""
    names = {k.partition("/")[2] for c in found for run in c.runs for k in run.metrics if k.startswith(f"{key}/")}
    known = [name for name in (OVERALL, *paper()["fabrics"]) if name in names]
    return known + sorted(names - set(known))


def energy_error_table(found: Sequence[Configuration]) -> Table:
    """The paper's table: configurations by fabrics, our rows and the paper's."""
    names = columns(found, "energy_error_J2")
    rows = []
    for configuration in found:
        means = [configuration.over_seeds(f"energy_error_J2/{name}") for name in names]
        spreads = [configuration.over_seeds(f"energy_error_J2_std/{name}") for name in names]
        cells = [spread_cell(m, s) for m, s in zip(means, spreads, strict=True)]
        rows.append((label(configuration), str(len(configuration.seeds)), *cells))
        if is_papers(configuration):
            published = paper()["rows"][label(configuration)]
            cells = [f"{published[n][0]:.2f} ± {published[n][1]:.2f}" if n in published else "" for n in names]
            rows.append((OF_PAPER, "", *cells))
    note = f"Mean ± standard deviation over all test windows. {OVER_SEEDS}"
    title = "Energy: squared error of the change of energy of the cloth [J²]"
    return Table(title, ("configuration", "seeds", *names), tuple(rows), note)


def force_table(found: Sequence[Configuration]) -> Table:
    """Mean force residual [N], compared with predicting nothing and with the fitted spring-hinge law."""
    names = columns(found, "force_residual_N")
    rows = []
    for key, title in BASELINES.items():
        runs = Configuration(tuple(run for c in found for run in c.runs))
        cells = [runs.over_seeds(f"{key}/{name}") for name in names]
        if any(cells):
            rows.append((title, "", *(number(cell.mean) if cell else "" for cell in cells)))
    rows += _rows(found, "force_residual_N", names)
    title = "Force: what is left of the equation of motion, |m a − m g + ∂Φ/∂x| [N]"
    note = f"Mean over free vertices and test windows. {OVER_SEEDS}"
    return Table(title, ("configuration", "seeds", *names), tuple(rows), note)


def quantity_table(found: Sequence[Configuration], key: str, title: str) -> Table:
    """One metric ``key`` by fabrics; without rows where no run has it."""
    names = columns(found, key)
    rows = tuple(_rows(found, key, names)) if names else ()
    return Table(title, ("configuration", "seeds", *names), rows, OVER_SEEDS)


def orderings(found: Sequence[Configuration]) -> Table:
    """Claims of the paper "a is better than b" against the runs, by their energy error."""
    ours = {label(c): c for c in found if is_papers(c)}
    names = columns(list(ours.values()), "energy_error_J2") if ours else []
    rows = [
        (f"{first} < {second}", *_verdicts(ours[first], ours[second], names))
        for first, second in paper()["orderings"]
        if first in ours and second in ours
    ]
    note = (
        "Mean over seeds of the first / of the second. yes: all seeds of the first below all of the second; "
        "no: all above; open: the seeds overlap, or there is only one."
    )
    return Table("Orderings of the paper", ("claim", *names), tuple(rows), note)


def _verdicts(first: Configuration, second: Configuration, names: Sequence[str]) -> list[str]:
    cells = []
    for name in names:
        a, b = (c.over_seeds(f"energy_error_J2/{name}") for c in (first, second))
        if a is None or b is None:
            cells.append("")
            continue
        several = min(len(first.seeds), len(second.seeds)) > 1
        verdict = "yes" if a.highest < b.lowest else "no" if a.lowest > b.highest else "open"
        verdict = verdict if several else "open"
        cells.append(f"{verdict} ({number(a.mean)} / {number(b.mean)})")
    return cells


def _rows(found: Sequence[Configuration], key: str, names: Sequence[str]) -> list[tuple[str, ...]]:
    return [
        (label(c), str(len(c.seeds)), *(spread_cell(c.over_seeds(f"{key}/{name}")) for name in names)) for c in found
    ]


def spread_cell(value: Spread | None, deviation: Spread | None = None) -> str:
    """Mean, deviation and, where it is more than a point, the range over seeds: ``9.00 ± 3.00 (8.00…10.0)``."""
    if value is None:
        return ""
    text = number(value.mean) + (f" ± {number(deviation.mean)}" if deviation else "")
    return text if value.lowest == value.highest else f"{text} ({number(value.lowest)}…{number(value.highest)})"
