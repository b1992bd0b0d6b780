"""Finished trainings of energies: their tables and figures in a folder, and on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from drape.metrics.record import FILE, RunRecord
from drape.report.curves import draw_curves
from drape.report.document import describe_setting, document, missing, settings_of, tables
from drape.report.energy_map import draw_energy_map
from drape.report.learned import learned_energies, learned_fabrics
from drape.report.summary import summary
from drape.report.table import Table
from drape.report.tables import TableOf
from drape.report.training_trade import draw_training_trade


def write_trainings(
    runs: Sequence[RunRecord],
    folder: Path,
    console: Console,
    *,
    ablations: Sequence[str],
    seeds: Sequence[int],
    map_fabrics: Sequence[str],
    makers: Sequence[TableOf],
) -> tuple[list[Table], list[Path]]:
    """Write ``tables.md`` and figures of ``runs`` to ``folder``, and the curves of each run to its own folder.

    Returns the tables of the main setting, and maps of its energies, one panel for each of ``map_fabrics`` that was
    learned. What is missing to complete them is said for ``ablations`` and ``seeds``; ``makers`` make the tables.
    """
    found = settings_of(runs, ablations)[0]
    console.rule(describe_setting(found[0].setting))
    laws, maps = tables(found, makers), []
    for table in laws:
        console.print(table.terminal(), "")
    for command in missing(found, ablations, seeds):
        console.print(f"missing: {command}", soft_wrap=True)
    (folder / "tables.md").write_text(document(runs, ablations, seeds, makers), encoding="utf-8")
    of_main = [run for run in runs if all(run.setting[k] == found[0].setting[k] for k in ("data", "material"))]
    figures = [draw_training_trade(of_main, folder / "trade_training.png")]
    energies = learned_energies(found)
    if energies:
        fabrics = learned_fabrics(found, map_fabrics)
        maps.append(draw_energy_map(energies, fabrics, folder / "energy_map.png"))
    for run in (run for run in runs if (run.folder / "metrics.csv").is_file()):
        draw_curves(run.folder / "metrics.csv", run.folder / "figures" / "curves.png")
    best = min(of_main, key=lambda run: run.metrics.get("force_residual_N/overall", float("inf")))
    console.print(summary(best.folder / FILE), soft_wrap=True, highlight=False)
    console.print(
        f"{len(runs)} runs:", *(str(path) for path in [folder / "tables.md", *figures, *maps]), soft_wrap=True
    )
    return laws, maps
