"""Provenance of the numbers of a report: commands of its runs, and of those that are missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drape.metrics.record import RunRecord
from drape.report.runs import Configuration
from drape.report.tables import is_papers, label, paper

COMMAND = "python src/train.py"


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
