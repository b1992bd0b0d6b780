"""The report of a set of finished runs: one Markdown document, one section for each setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drape.metrics.record import EvaluationRecord, RunRecord
from drape.report.runs import Configuration, by_setting, configurations
from drape.report.table import Table
from drape.report.tables import TableOf, arranged, energy_error_table, force_table, is_papers, label, paper

COMMAND = "python src/train.py"


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


def describe_setting(setting: Mapping[str, str | int]) -> str:
    """``data=cloth, scale=cpu, …`` in a fixed order, for headings."""
    first = [name for name in ("data", "material", "scale", "width", "steps") if name in setting]
    return ", ".join(f"{name}={setting[name]}" for name in (*first, *sorted(set(setting) - set(first))))


def provenance(found: Sequence[Configuration]) -> str:
    """Markdown: data, size, time, versions and commands of each configuration."""
    lines = ["### Provenance", ""]
    for configuration in found:
        run = configuration.runs[0]
        known = run.provenance
        minutes = sorted({f"{float(r.provenance['seconds']) / 60:.1f}" for r in configuration.runs}, key=float)
        versions = ", ".join(f"{name} {version}" for name, version in known["versions"].items())
        parameters = f", {known['parameters']} parameters" if "parameters" in known else ""
        lines += [
            f"* **{label(configuration)}**: seeds {', '.join(map(str, configuration.seeds))}; {known['data']} "
            f"({known['train_sequences']} training and {known['test_sequences']} test sequences); "
            f"{run.setting['steps']} steps of width {run.setting['width']}{parameters}; "
            f"{'–'.join(dict.fromkeys((minutes[0], minutes[-1])))} minutes a run; {versions}.",
            f"  `{command(run, run.ablation, '<seed>' if len(configuration.seeds) > 1 else str(run.seed))}`",
        ]
    return "\n".join(lines) + "\n"


def command(run: RunRecord, ablation: str, seed: str) -> str:
    """The command of a run with another ablation and seed."""
    words = str(run.provenance["command"]).split()
    words = [word for word in words if word.partition("=")[0].lstrip("+") not in ("ablation", "seed")]
    return " ".join([*words, f"ablation={ablation}", f"seed={seed}"])


def missing(found: Sequence[Configuration], ablations: Sequence[str], seeds: Sequence[int]) -> list[str]:
    """Commands of the runs that the paper's table still lacks, of comparable settings."""
    ours = {c.ablation: c for c in found if is_papers(c)}
    sibling = next(iter(ours.values())).runs[0] if ours else None
    commands = []
    for ablation in ablations:
        for seed in seeds:
            if ablation in ours and seed in ours[ablation].seeds:
                continue
            default = f"{COMMAND} model={paper()['model']} ablation={ablation} seed={seed}"
            commands.append(command(sibling, ablation, str(seed)) if sibling else default)
    return commands
