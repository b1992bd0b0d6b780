"""The page of results: tables, figures and films in one folder that opens from disk, without a network."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import quote

import jinja2
import numpy as np

from drape.data.whole_file import whole_file
from drape.metrics.record import EvaluationRecord
from drape.report.clips import RECORDED, show
from drape.report.garment_curves import draw_garment_comparison
from drape.report.garment_rows import by_data, garment_rows
from drape.report.garment_sizes import Size, draw_sizes, size_tables
from drape.report.garment_tables import animation_tables, comparison_table
from drape.report.garment_trade import draw_garment_trade
from drape.report.names import data_name, fingerprint, slug
from drape.report.page_parts import Figure, GarmentSection, ScoreTable, heading, scores, tiles
from drape.report.stage import MOST_ERROR, RIGHT, WRONG
from drape.report.table import Table

SIZES = "The same garments in several resolutions: families by colour, sizes by marker; grey: the best of each size."
HERE = Path(__file__).parent
ENERGY_MAP = "figures/energy_map.png"
"""Path of a training's map, below its folder."""


class Page:
    """The page of results: its folder, and how much of each data set is shown in motion.

    Args:
        folder: of ``index.html`` and all that it shows.
        sequences: in motion, of each data set.
        height: of a clip [pixels].
    """

    def __init__(self, folder: Path | str, sequences: int = 3, height: int = 300) -> None:
        self.folder, self.sequences, self.height = Path(folder), sequences, height

    def write(
        self,
        evaluations: Sequence[EvaluationRecord],
        found: Sequence[Size],
        runs: Path | str,
        laws: Sequence[Table],
        maps: Sequence[Path] = (),
    ) -> Path:
        """Write ``index.html`` with what it shows; returns it. Clips of animations that have not changed are kept.

        ``found``: the same garments in several resolutions, among ``evaluations``. ``laws`` are tables of learned
        energies; ``maps`` are their energy maps, shown with those that trainings have left below ``runs``.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        text = _page(self.folder).render(
            garments=[self._garments(group, k) for k, group in enumerate(by_data(evaluations))],
            sizes=[ScoreTable.of(table) for table in size_tables(found)],
            choice=[chart] if (chart := self._chart(draw_sizes, found, "sizes", SIZES)) else [],
            laws=[ScoreTable.of(table) for table in laws],
            maps=self._maps(runs, maps),
            commands=[f"{each.method['name']}: {each.provenance.get('command', '')}" for each in evaluations],
            recorded=RECORDED,
            scale={"right": _rgb(RIGHT), "wrong": _rgb(WRONG), "most": f"{1e3 * MOST_ERROR:.0f}"},
        )
        shutil.copyfile(HERE / "page.css", self.folder / "page.css")
        with whole_file(self.folder / "index.html") as temporary:
            temporary.write_text(text, encoding="utf-8")
        return self.folder / "index.html"

    def _garments(self, group: Sequence[EvaluationRecord], place: int) -> GarmentSection:
        rows, name, first = garment_rows(group), data_name(group[0]), group[0]
        best_first = sorted((row for row in rows if not row.is_twin), key=lambda row: row.error)
        tables = [*animation_tables(group), comparison_table(group, with_paper=not place)]
        charts = (
            self._chart(draw_garment_trade, rows, f"{name}-trade", "Error against time a frame: lower left is better."),
            self._chart(draw_garment_comparison, best_first, f"{name}-frames", "Mean vertex error against the frame."),
        )
        title = f"{Path(str(first.data['path'])).stem}, {first.data['split']}, {_length(first)}"
        return GarmentSection(
            mark=f"{slug(title)}-{place}",
            title=title,
            about=f"{first.data['path']} ({first.data['source']}), split {first.data['split']}: {_length(first)}, each "
            "from two recorded ones. Only evaluations of exactly these are compared here.",
            tiles=tiles(rows),
            tables=[ScoreTable.of(table, best=True) for table in tables],
            charts=[chart for chart in charts if chart is not None],
            in_motion=show(best_first, self.sequences, self.folder / "clips" / name, self.height) if best_first else [],
        )

    def _chart(
        self, draw: Callable[..., Path | None], rows: Sequence[object], name: str, caption: str
    ) -> Figure | None:
        """A figure for light and for dark pages; None where there is nothing to draw."""
        places = [self.folder / "figures" / f"{name}-{theme}.svg" for theme in ("light", "dark")]
        light, dark = (draw(rows, path, dark=k == 1) for k, path in enumerate(places))
        return None if light is None else Figure(light, caption, dark)

    def _maps(self, runs: Path | str, maps: Sequence[Path]) -> list[Figure]:
        """Copies of energy maps below the folder of the page."""
        found = {path: path.stem for path in maps}
        found |= {path: str(path.parent.parent.relative_to(runs)) for path in sorted(Path(runs).rglob(ENERGY_MAP))}
        figures = []
        for path, caption in found.items():
            copy = self.folder / "figures" / f"{slug(caption)}-{fingerprint(str(path))}.png"
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)
            figures.append(Figure(copy, f"Elastic energy of an edge against its deformation: {caption}"))
        return figures


def _page(folder: Path) -> jinja2.Template:
    """``page.html``, which escapes all text and links to files below ``folder``."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    links = {"link": lambda path: quote(path.relative_to(folder).as_posix())}
    environment.filters |= links | {"heading": heading, "scores": scores}
    return environment.get_template("page.html")


def _length(record: EvaluationRecord) -> str:
    sequences, frames = len(record.data["sequences"]), record.data["frames"]
    long = f"{max(frames)}" if min(frames) == max(frames) else f"{min(frames)} to {max(frames)}"
    return f"{sequences} {'sequence' if sequences == 1 else 'sequences'} of {long} frames"


def _rgb(colour: np.ndarray) -> str:
    return "rgb({} {} {})".format(*(255 * colour).round().astype(int))
