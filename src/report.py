"""Tables and figures of finished runs and evaluations: ``python src/report.py runs=runs``."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from drape import config as conf
from drape.metrics.record import EvaluationRecord
from drape.report.document import garment_document
from drape.report.garment_rows import by_data, garment_rows
from drape.report.garment_sizes import Size, blender_costs, draw_sizes, size_tables, sizes
from drape.report.garment_tables import garment_tables
from drape.report.garment_trade import draw_garment_trade, write_garment_trade
from drape.report.names import data_name
from drape.report.runs import find_evaluations, find_runs, has_runs
from drape.report.table import Table
from drape.report.trainings import write_trainings


@conf.main("report")
def main(config: DictConfig) -> None:
    console, folder, page = Console(), Path(config.folder), conf.instantiate(config.page)
    folder.mkdir(parents=True, exist_ok=True)
    evaluations = find_evaluations(config.runs)
    found = sizes(evaluations, blender_costs(config.runs))
    laws: list[Table] = []
    maps: list[Path] = []
    if evaluations:
        garments(evaluations, found, console, folder)
    if has_runs(config.runs) or not evaluations:
        settings = {name: config[name] for name in ("ablations", "seeds", "map_fabrics")}
        makers = list(conf.instantiate(config.tables).values())
        laws, maps = write_trainings(find_runs(config.runs), folder, console, **settings, makers=makers)
    written = page.write(evaluations, found, config.runs, laws, maps)
    console.print(f"page: {written}", soft_wrap=True)


def garments(evaluations: list[EvaluationRecord], found: list[Size], console: Console, folder: Path) -> None:
    tables = [*garment_tables(evaluations), *size_tables(found)]
    for table in tables:
        console.print(table.terminal(), "")
    (folder / "garments.md").write_text(garment_document(tables, evaluations), encoding="utf-8")
    written: list[Path | None] = [folder / "garments.md"]
    for k, group in enumerate(by_data(evaluations)):
        path = folder / (f"garments_trade_{data_name(group[0])}.png" if k else "garments_trade.png")
        written += [draw_garment_trade(garment_rows(group), path), write_garment_trade(garment_rows(group), path)]
    written.append(draw_sizes(found, folder / "garments_sizes.png"))
    console.print(f"{len(evaluations)} evaluations:", *(str(path) for path in written if path), soft_wrap=True)


if __name__ == "__main__":
    main()
