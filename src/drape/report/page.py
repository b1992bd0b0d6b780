"""The page of results: tables, figures and films in one folder that opens from disk, without a network."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

from drape.data.whole_file import whole_file
from drape.metrics.evaluation_record import EvaluationRecord
from drape.report import markup
from drape.report.clips import ShownSequence, show
from drape.report.garment_comparison import draw_garment_comparison
from drape.report.garment_rows import GarmentRow, by_data, garment_rows
from drape.report.garment_tables import animation_tables, comparison_table
from drape.report.garment_trade import draw_garment_trade
from drape.report.names import data_name, fingerprint, slug
from drape.report.page_style import STYLE
from drape.report.stage import MOST_ERROR, RIGHT, WRONG
from drape.report.table import Table, number

TITLE = "Garments, animated"
LEAD = (
    "A scene says what is present; the energies that it needs add up to an incremental potential; a simulator turns it "
    "into motion. Here is every way to animate the same recorded garments, side by side."
)
FILMS = (
    '<p class="note">All start from the same two recorded frames; the camera follows the recorded garment. Error and '
    "collisions are those of this sequence; of several seeds the first is shown.</p>"
)
ENERGY_MAP = "figures/energy_map.png"
"""Where a training leaves its map, below its folder."""


class Page:
    """Where the page stands, and how much of each data set is shown in motion.

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
        runs: Path | str,
        laws: Sequence[Table],
        maps: Sequence[Path] = (),
    ) -> Path:
        """Write ``index.html`` with what it shows; returns it. Clips of animations that have not changed are kept.

        ``laws`` are tables of learned energies; ``maps`` are their energy maps beside those that trainings have left
        below ``runs``.
        """
        groups = by_data(evaluations)
        sections = [(_heading(group[0]), self._garments(group, with_paper=not k)) for k, group in enumerate(groups)]
        law = self._laws(runs, laws, maps)
        sections += [("The law of the fabric", law)] if law else []
        commands = [f"{record.method['name']}: {record.provenance.get('command', '')}" for record in evaluations]
        if commands:
            sections.append(("Commands", markup.items(commands)))
        with whole_file(self.folder / "index.html") as temporary:
            temporary.write_text(_html(sections), encoding="utf-8")
        return self.folder / "index.html"

    def _garments(self, group: Sequence[EvaluationRecord], *, with_paper: bool) -> str:
        rows, name = garment_rows(group), data_name(group[0])
        best_first = [row for row in reversed(rows) if not row.is_twin]
        shown = show(best_first, self.sequences, self.folder / "clips" / name, self.height) if best_first else []
        first, *others = [*animation_tables(group), comparison_table(group, with_paper=with_paper)]
        drawn = [
            self._chart(
                draw_garment_trade, rows, f"{name}-trade", "Error against time per frame; lower left is better."
            ),
            self._chart(draw_garment_comparison, best_first, f"{name}-frames", "Mean vertex error against the frame."),
        ]
        return "\n".join(
            [
                f'<p class="note">{escape(_described(group[0]))}</p>',
                _tiles(rows),
                markup.table(first, best=True),
                "<h3>Speed and accuracy</h3>",
                f'<div class="charts">{"".join(drawn)}</div>',
                *(_in_motion(each, self.folder, first=not k) for k, each in enumerate(shown)),
                *(markup.table(table, best=True) for table in others),
            ]
        )

    def _chart(self, draw: Callable[..., Path | None], rows: Sequence[GarmentRow], name: str, caption: str) -> str:
        """A figure for light and for dark pages; nothing where there is nothing to draw."""
        places = [self.folder / "figures" / f"{name}-{theme}.svg" for theme in ("light", "dark")]
        light, dark = (draw(rows, path, dark=k == 1) for k, path in enumerate(places))
        return "" if light is None else markup.chart(light, self.folder, caption, dark)

    def _laws(self, runs: Path | str, laws: Sequence[Table], maps: Sequence[Path]) -> str:
        found = {path: path.stem for path in maps}
        found |= {path: str(path.parent.parent.relative_to(runs)) for path in sorted(Path(runs).rglob(ENERGY_MAP))}
        charts = []
        for path, caption in found.items():
            copy = self.folder / "figures" / f"{slug(caption)}-{fingerprint(str(path))}.png"
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)
            charts.append(markup.chart(copy, self.folder, f"Potential energy against deformation: {caption}"))
        parts = [markup.table(table) for table in laws]
        parts += ["<h3>Energy maps</h3>", f'<div class="charts">{"".join(charts)}</div>'] if charts else []
        return "\n".join(parts)


def _heading(record: EvaluationRecord) -> str:
    return f"{Path(str(record.data['path'])).stem}, {record.data['split']}, {_length(record)}"


def _length(record: EvaluationRecord) -> str:
    sequences, frames = len(record.data["sequences"]), record.data["frames"]
    long = f"{max(frames)}" if min(frames) == max(frames) else f"{min(frames)} to {max(frames)}"
    return f"{sequences} {'sequence' if sequences == 1 else 'sequences'} of {long} frames"


def _described(record: EvaluationRecord) -> str:
    return (
        f"{record.data['path']} ({record.data['source']}), split {record.data['split']}: {_length(record)}, each from "
        "two recorded ones. Only evaluations of exactly these are compared here."
    )


def _tiles(rows: Sequence[GarmentRow]) -> str:
    """The numbers that say most: lowest error, noise floor, fastest, how many."""
    known = [row for row in rows if not row.is_twin and row.over_seeds("error_mm") is not None]
    tiles = []
    for kind, choice in (
        ("trained simulator", [row for row in known if row.training]),
        ("solver", [row for row in known if row.is_solver]),
        ("baseline", [row for row in known if not row.training and not row.is_solver]),
    ):
        if choice:
            best = min(choice, key=lambda row: row.over_seeds("error_mm").mean)
            tiles.append((f"{number(best.over_seeds('error_mm').mean)} mm", f"best {kind}: {best.label}"))
    floor = next((floor for row in rows if (floor := row.over_seeds("floor_mm")) is not None), None)
    tiles += [(f"{number(floor.mean)} mm", "noise floor: the same simulation, started 1e-6 m beside")] if floor else []
    found = "".join(f'<div class="tile"><b>{escape(n)}</b><span>{escape(text)}</span></div>' for n, text in tiles)
    return f'<div class="tiles">{found}</div>' if found else ""


def _in_motion(sequence: ShownSequence, page: Path, *, first: bool) -> str:
    about = ", ".join(filter(None, (sequence.kind, sequence.fabric, sequence.motion)))
    title = f"In motion: {about} (no. {sequence.name})" if about else f"In motion: no. {sequence.name}"
    ends = " to ".join("rgb({} {} {})".format(*(255 * colour).round().astype(int)) for colour in (RIGHT, WRONG))
    ends = ends.replace(" to ", ", ")
    scale = f'<p class="note">0<span class="scale" style="background:linear-gradient(90deg, {ends})"></span>'
    scale += f"{1e3 * MOST_ERROR:.0f} mm and more from the recorded garment</p>\n"
    pictures = [lane for lane in sequence.lanes if lane.picture is not None]
    last = markup.details(
        "Last frame, coloured by error",
        scale + markup.films(pictures, page, last=True) if pictures else "",
        shown=first,
    )
    return f"<h3>{escape(title)}</h3>\n{FILMS if first else ''}\n{markup.films(sequence.lanes, page)}{last}"


def _html(sections: Sequence[tuple[str, str]]) -> str:
    marks = [f"{slug(title)}-{k}" for k, (title, _) in enumerate(sections)]
    titled = list(zip(marks, sections, strict=True))
    links = "".join(f'<li><a href="#{mark}">{escape(title)}</a></li>' for mark, (title, _) in titled)
    body = "\n".join(
        f'<section id="{mark}">\n<h2>{escape(title)}</h2>\n{text}\n</section>' for mark, (title, text) in titled
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{TITLE}</title>
<style>{STYLE}</style>
</head>
<body>
<header><h1>{TITLE}</h1><p class="lead">{LEAD}</p></header>
<nav><ul>{links}</ul></nav>
<main>
{body}
</main>
<footer>Made by <code>python src/report.py</code>. Errors are mean distances of vertices to the recorded ones.</footer>
</body>
</html>
"""
