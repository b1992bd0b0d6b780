"""Tables and figures of finished runs and evaluations: ``python src/report.py runs=runs``."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from drape import config as conf
from drape.report.curves import draw_curves
from drape.report.document import document, garment_document, settings_of, tables
from drape.report.energy_map import draw_energy_map
from drape.report.garment_tables import comparison_tables
from drape.report.learned import learned_energies, learned_fabrics
from drape.report.provenance import describe_setting, missing
from drape.report.runs import find_evaluations, find_runs, has_runs
from drape.report.summary import summary
from drape.report.training_trade import draw_training_trade


@conf.main("report")
def main(config: DictConfig) -> None:
    console, folder = Console(), Path(config.folder)
    evaluations = find_evaluations(config.runs)
    if evaluations:
        for table in comparison_tables(evaluations):
            console.print(table.terminal(), "")
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "garments.md").write_text(garment_document(evaluations), encoding="utf-8")
        console.print(f"{len(evaluations)} evaluations: {folder / 'garments.md'}", soft_wrap=True)
    if has_runs(config.runs) or not evaluations:
        trainings(config, console, folder)


def trainings(config: DictConfig, console: Console, folder: Path) -> None:
    runs = find_runs(config.runs)
    found = settings_of(runs, config.ablations)[0]
    console.rule(describe_setting(found[0].setting))
    for table in tables(found):
        console.print(table.terminal(), "")
    for command in missing(found, config.ablations, config.seeds):
        console.print(f"missing: {command}", soft_wrap=True)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "tables.md").write_text(document(runs, config.ablations, config.seeds))
    of_main = [run for run in runs if all(run.setting[k] == found[0].setting[k] for k in ("data", "material"))]
    figures = [draw_training_trade(of_main, folder / "trade_training.png")]
    energies = learned_energies(found)
    if energies:
        fabrics = learned_fabrics(found, config.map_fabrics)
        figures.append(draw_energy_map(energies, fabrics, folder / "energy_map.png"))
    for run in (run for run in runs if (run.folder / "metrics.csv").is_file()):
        draw_curves(run.folder / "metrics.csv", run.folder / "figures" / "curves.png")
    best = min(of_main, key=lambda run: run.metrics.get("force_residual_N/overall", float("inf")))
    console.print(summary(best), soft_wrap=True, highlight=False)
    console.print(f"{len(runs)} runs:", *(str(path) for path in [folder / "tables.md", *figures]), soft_wrap=True)


if __name__ == "__main__":
    main()
