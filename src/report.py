"""Tables and figures of finished runs and evaluations: ``python src/report.py runs=runs``."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from drape import config as conf
from drape.metrics.evaluation_record import EvaluationRecord
from drape.metrics.record import FILE
from drape.report.curves import draw_curves
from drape.report.document import document, garment_document, settings_of, tables
from drape.report.energy_map import draw_energy_map
from drape.report.garment_rows import by_data, garment_rows
from drape.report.garment_tables import garment_tables
from drape.report.garment_trade import draw_garment_trade, write_garment_trade
from drape.report.learned import learned_energies, learned_fabrics
from drape.report.names import data_name
from drape.report.provenance import describe_setting, missing
from drape.report.runs import find_evaluations, find_runs, has_runs
from drape.report.summary import summary
from drape.report.table import Table
from drape.report.training_trade import draw_training_trade


@conf.main("report")
def main(config: DictConfig) -> None:
    console, folder, page = Console(), Path(config.folder), conf.instantiate(config.page)
    folder.mkdir(parents=True, exist_ok=True)
    evaluations, laws, maps = find_evaluations(config.runs), [], []
    if evaluations:
        garments(evaluations, console, folder)
    if has_runs(config.runs) or not evaluations:
        laws, maps = trainings(config, console, folder)
    written = page.write(evaluations, config.runs, laws, maps)
    console.print(f"page: {written}", soft_wrap=True)


def garments(evaluations: list[EvaluationRecord], console: Console, folder: Path) -> None:
    for table in garment_tables(evaluations):
        console.print(table.terminal(), "")
    (folder / "garments.md").write_text(garment_document(evaluations), encoding="utf-8")
    written = [folder / "garments.md"]
    for k, group in enumerate(by_data(evaluations)):
        path = folder / (f"garments_trade_{data_name(group[0])}.png" if k else "garments_trade.png")
        written += [draw_garment_trade(garment_rows(group), path), write_garment_trade(garment_rows(group), path)]
    console.print(f"{len(evaluations)} evaluations:", *(str(path) for path in written if path), soft_wrap=True)


def trainings(config: DictConfig, console: Console, folder: Path) -> tuple[list[Table], list[Path]]:
    """Tables, and maps of energies, of the main setting."""
    runs = find_runs(config.runs)
    found = settings_of(runs, config.ablations)[0]
    console.rule(describe_setting(found[0].setting))
    laws, maps = tables(found), []
    for table in laws:
        console.print(table.terminal(), "")
    for command in missing(found, config.ablations, config.seeds):
        console.print(f"missing: {command}", soft_wrap=True)
    (folder / "tables.md").write_text(document(runs, config.ablations, config.seeds))
    of_main = [run for run in runs if all(run.setting[k] == found[0].setting[k] for k in ("data", "material"))]
    figures = [draw_training_trade(of_main, folder / "trade_training.png")]
    energies = learned_energies(found)
    if energies:
        fabrics = learned_fabrics(found, config.map_fabrics)
        maps.append(draw_energy_map(energies, fabrics, folder / "energy_map.png"))
    for run in (run for run in runs if (run.folder / "metrics.csv").is_file()):
        draw_curves(run.folder / "metrics.csv", run.folder / "figures" / "curves.png")
    best = min(of_main, key=lambda run: run.metrics.get("force_residual_N/overall", float("inf")))
    console.print(summary(best.folder / FILE), soft_wrap=True, highlight=False)
    console.print(
        f"{len(runs)} runs:", *(str(path) for path in [folder / "tables.md", *figures, *maps]), soft_wrap=True
    )
    return laws, maps


if __name__ == "__main__":
    main()
