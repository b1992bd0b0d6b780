"""The report of a set of finished runs: one Markdown document, one section for each setting."""

from __future__ import annotations

from collections.abc import Sequence

from drape.metrics.record import EvaluationRecord, RunRecord
from drape.report.provenance import describe_setting, missing, provenance
from drape.report.runs import Configuration, by_setting, configurations
from drape.report.table import Table
from drape.report.tables import TableOf, arranged, energy_error_table, force_table, is_papers, paper


def settings_of(runs: Sequence[RunRecord], ablations: Sequence[str]) -> list[list[Configuration]]:
    """Comparable configurations together; first those with the most runs of the paper's configurations."""
    groups = [arranged(found, ablations) for found in by_setting(configurations(runs))]
    return sorted(groups, key=lambda found: -sum(len(c.runs) for c in found if is_papers(c)))


def tables(found: Sequence[Configuration], makers: Sequence[TableOf]) -> list[Table]:
    """The tables of configurations that share their setting; those without rows left out."""
    return [table for table in (make(found) for make in makers) if table.rows]


def document(
    runs: Sequence[RunRecord], ablations: Sequence[str], seeds: Sequence[int], makers: Sequence[TableOf]
) -> str:
    """Markdown of all tables with what made them; for the main setting also the commands of missing runs."""
    sections = ["# The constitutive law, learned", "", f"Numbers in the paper: {paper()['source']}.", ""]
    main, *others = settings_of(runs, ablations)
    sections += _section(main, tables(main, makers))
    commands = missing(main, ablations, seeds)
    if commands:
        sections += ["### Missing runs", "", "```", *commands, "```", ""]
    for found in others:
        sections += _section(found, [energy_error_table(found), force_table(found)])
    return "\n".join(sections)


def garment_document(tables: Sequence[Table], evaluations: Sequence[EvaluationRecord]) -> str:
    """Markdown of ``tables`` of garments, with the commands that made the ``evaluations`` in them."""
    lines = ["# Garments, animated", "", *(table.markdown() for table in tables), "### Provenance", ""]
    lines += [f"* **{record.method['name']}**: `{record.provenance['command']}`" for record in evaluations]
    return "\n".join(lines) + "\n"


def _section(found: Sequence[Configuration], shown: Sequence[Table]) -> list[str]:
    heading = f"## {describe_setting(found[0].setting)}"
    return [heading, "", *(table.markdown() for table in shown), provenance(found)]
