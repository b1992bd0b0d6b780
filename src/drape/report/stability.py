"""The sweep of extremes as a table and a figure: cases by energies and precisions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
import yaml
from hydra.core.utils import JobReturn, JobStatus
from hydra.experimental.callback import Callback
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from omegaconf import DictConfig

from drape.config import build_from_file
from drape.data.animation_hdf5 import AnimationFile
from drape.metrics.stability import Stability, stability
from drape.report.table import Table
from drape.simulators.simulator import Outcome

ALLOWED = 1e-3
"""A rise of the mechanical energy by less than this share of it is one of the tolerance."""
VERDICTS = {
    "all frames converged": "#8fce8f",
    "finite, and every other frame says why": "#f3e08a",
    "gained energy from nowhere": "#f0a35e",
    "not finite, or stopped": "#dd6464",
}
STOPPED = "stopped.txt"
"""In the folder of a run that ended in an error: what the error was."""

BUILT = ("scene", "energy", "fabric", "model")
"""Groups of the config in an animation whose objects are built again, the first two, and what may stand in these."""
PRECISIONS = ("float64", "float32")
COLUMNS = ("case", "converged", "residual", "gain", "drift", "ms/frame", "apart")
OTHERS = {Outcome.ITERATIONS: "iterations", Outcome.PRECISION: "precision", Outcome.NOT_FINITE: "not finite"}
NOTES = """# Numerical stability at the extremes

Made by `python src/animate.py -m --config-dir sweeps --config-name stability`: {minutes:.0f} minutes of steps.
`conf/scene/extreme.yaml` says what the cases are. Where a cell has two values, they are of a law in float64 / float32;
positions are float64 in both.

* converged: of all frames; why the others did not: the maximum of iterations, the precision of the numbers.
* residual: the largest mean unbalanced force per vertex, in weights of a vertex; the tolerance is 0.001.
* gain: the largest rise of kinetic + stored + gravitational energy above any earlier value, as a share of the largest
  kinetic + stored; nobody does work on these cloths. Up to {allowed:g} is the tolerance's.
* drift: the largest change of the momentum as a share of Σ m|v|; of free cloths, on which only the air acts.
* apart: mean distance between the last frames in both precisions, in sides of the cloth.
"""

Cell = tuple[str, str, str]
"""Case, energy, precision."""


class StabilityReport(Callback):
    """At the end of a multirun: ``stability.md`` and ``stability.png`` of it; that a run stopped is a result, too."""

    def on_job_start(self, config: DictConfig, **_: Any) -> None:
        (Path(config.folder) / STOPPED).unlink(missing_ok=True)

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        if job_return.status is JobStatus.FAILED:
            error = job_return._return_value
            path = Path(config.folder) / STOPPED
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{type(error).__name__}: {error}\n", encoding="utf-8")
            job_return.status, job_return.return_value = JobStatus.COMPLETED, None

    def on_multirun_end(self, config: DictConfig, **_: Any) -> None:
        folder = Path(config.hydra.sweep.dir)
        found = read(folder)
        (folder / "stability.md").write_text(document(found), encoding="utf-8")
        draw(found, folder / "stability.png")
        counts = {text: sum(verdict(each) == text for each in found.values()) for text in VERDICTS}
        print("\n".join(f"{count:4d} of {len(found)}: {text}" for text, count in counts.items()))
        print(folder / "stability.md", folder / "stability.png", sep="\n")


def read(folder: Path) -> dict[Cell, Stability | str]:
    """All runs below ``folder``, each measured, or the error that it stopped with; in the order of running."""
    found: dict[Cell, Stability | str] = {}
    for path in sorted(folder.glob("*/*/*/.hydra"), key=lambda path: path.stat().st_mtime):
        run = path.parent
        cell: Cell = run.parts[-3], run.parts[-2], run.parts[-1]
        stopped = run / STOPPED
        animation = run / "animation.h5"
        if stopped.exists() or not animation.exists():
            found[cell] = stopped.read_text(encoding="utf-8").strip() if stopped.exists() else "interrupted"
            continue
        with AnimationFile(animation) as file:
            made = yaml.safe_load(file.header.config) or {}
            scene, energy = (build_from_file(made[name], BUILT, f"{animation}: config.{name}") for name in BUILT[:2])
            found[cell] = stability(file, scene, energy)
    return found


def verdict(result: Stability | str) -> str:
    """The worst that there is to say of a run, one of :data:`VERDICTS`."""
    converged, told, gained, failed = VERDICTS
    if isinstance(result, str) or not result.is_finite or Outcome.NOT_FINITE in result.outcomes:
        return failed
    if result.gain > ALLOWED:
        return gained
    return converged if set(result.outcomes) == {Outcome.CONVERGED} else told


def document(found: Mapping[Cell, Stability | str]) -> str:
    """One table for each energy, in Markdown."""
    seconds = sum(result.seconds for result in found.values() if isinstance(result, Stability))
    energies = dict.fromkeys(energy for _, energy, _ in found)
    notes = NOTES.format(minutes=seconds / 60, allowed=ALLOWED)
    return "\n".join([notes, *(_table(found, energy).markdown() for energy in energies)])


def _table(found: Mapping[Cell, Stability | str], energy: str) -> Table:
    rows = []
    for case in dict.fromkeys(case for case, other, _ in found if other == energy):
        pair = [found.get((case, energy, precision), "not run") for precision in PRECISIONS]
        cells = [" / ".join(dict.fromkeys(texts)) for texts in zip(*map(_cells, pair), strict=True)]
        rows.append((case, *cells, _apart(*pair)))
    return Table(energy, COLUMNS, tuple(rows))


def _cells(result: Stability | str) -> tuple[str, ...]:
    """Converged, residual, gain, drift, ms/frame."""
    if isinstance(result, str):
        return (shorten(result, 60), "", "", "", "")
    total, converged = result.outcomes.total(), result.outcomes[Outcome.CONVERGED]
    others = [f"{result.outcomes[outcome]} {word}" for outcome, word in OTHERS.items() if result.outcomes[outcome]]
    return (
        f"{converged}/{total}" + (f" ({', '.join(others)})" if others else ""),
        f"{result.residual:.0e}",
        _size(result.gain),
        "" if result.drift is None else _size(result.drift),
        f"{1e3 * result.seconds / total:.0f}",
    )


def _size(share: float) -> str:
    return f"{share:.0e}" if share else "0"


def _apart(first: Stability | str, second: Stability | str) -> str:
    if isinstance(first, str) or isinstance(second, str):
        return ""
    return _size(float(np.linalg.norm(first.x - second.x, axis=1).mean()) / first.side)


def draw(found: Mapping[Cell, Stability | str], path: Path) -> Path:
    """Cases by energies and precisions, coloured by the verdict; in each the converged frames and the gain."""
    cases = list(dict.fromkeys(case for case, *_ in found))
    ways = sorted({(energy, precision) for _, energy, precision in found})
    colours = list(VERDICTS.values())
    grid = np.full((len(cases), len(ways)), np.nan)
    figure = Figure(figsize=(2.2 + 1.5 * len(ways), 1.6 + 0.27 * len(cases)), layout="constrained")
    axes = figure.subplots()
    for (case, *way), result in found.items():
        row, column = cases.index(case), ways.index((way[0], way[1]))
        grid[row, column] = list(VERDICTS).index(verdict(result))
        text = "stopped"
        if isinstance(result, Stability):
            converged, _, risen, *_ = _cells(result)
            text = converged.partition(" ")[0] + (f"  +{risen}" if result.gain else "")
        axes.text(column, row, text, ha="center", va="center", fontsize=7)
    axes.imshow(grid, cmap=ListedColormap(colours), vmin=-0.5, vmax=len(colours) - 0.5, aspect="auto")
    axes.set_yticks(range(len(cases)), cases, fontsize=8)
    axes.set_xticks(range(len(ways)), [f"{energy}\n{precision}" for energy, precision in ways], fontsize=8)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    legend = [Patch(color=colour, label=text) for text, colour in VERDICTS.items()]
    figure.legend(handles=legend, loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    axes.set_xlabel("frames converged of all, and the largest gain of energy as a share of it")
    figure.savefig(path, dpi=120)
    return path
