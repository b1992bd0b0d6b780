"""Pieces of an HTML page: tables, figures, films. All text is escaped here, and all links are relative."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from drape.report.clips import RECORDED, Lane
from drape.report.garment_rows import FLOOR, PAPER
from drape.report.table import Table
from drape.report.tables import OF_PAPER

NUMBER = re.compile(r"-?\d[\d.]*(e[+-]?\d+)?")
RANGE = re.compile(r" \(([^()]*…[^()]*)\)$")
"""Over seeds, at the end of a cell: it stands below the mean."""
BEST = ' class="best"'
NO_SCORES = ("seeds",)
"""Columns of which no number is the best."""


def link(path: Path, page: Path) -> str:
    """Address of a file below the folder ``page``."""
    return quote(path.relative_to(page).as_posix())


def table(content: Table, *, best: bool = False) -> str:
    """A table with its title, note and footnotes; with ``best`` the lowest of ours in each column is marked."""
    lowest = _lowest(content) if best else {}
    titles = "".join(f'<th scope="col">{escape(column)}</th>' for column in content.columns)
    body = "\n".join(_row(row, lowest) for row in content.rows)
    parts = [f"<h3>{escape(content.title)}</h3>"]
    parts += [f'<p class="note">{escape(content.note)}</p>'] if content.note else []
    parts += [f'<div class="table"><table><thead><tr>{titles}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>']
    return "\n".join(parts) + "\n" + details("How the rows were trained", items(content.footnotes))


def items(lines: Iterable[str]) -> str:
    """A list; nothing where there are no lines."""
    found = "\n".join(f"<li>{escape(line)}</li>" for line in lines)
    return f'<ul class="notes">\n{found}\n</ul>' if found else ""


def details(summary: str, content: str, *, shown: bool = False) -> str:
    """Content that opens on demand; nothing where there is none."""
    state = " open" if shown else ""
    return f"<details{state}><summary>{escape(summary)}</summary>\n{content}\n</details>\n" if content else ""


def chart(light: Path, page: Path, caption: str, dark: Path | None = None) -> str:
    """A figure; ``dark`` is its form for dark pages, without which it stands on white."""
    source = f'<source media="(prefers-color-scheme: dark)" srcset="{link(dark, page)}">' if dark else ""
    picture = f'<picture>{source}<img src="{link(light, page)}" alt="{escape(caption)}"></picture>'
    kind = "chart" if dark else "chart white"
    return f'<figure class="{kind}">{picture}<figcaption>{escape(caption)}</figcaption></figure>'


def films(lanes: Sequence[Lane], page: Path, *, last: bool = False) -> str:
    """Lanes side by side: their clips, or their ``last`` pictures, which also stand in where motion is reduced."""
    return '<div class="lanes">\n' + "\n".join(_film(lane, page, last) for lane in lanes) + "\n</div>\n"


def _film(lane: Lane, page: Path, last: bool) -> str:
    kind = "lane recorded" if lane.label == RECORDED else "lane"
    told = " ".join(f"<span>{escape(text)}</span>" for text in scores(lane))
    caption = f"<b>{escape(lane.label)}</b>{told}"
    if lane.clip is None or lane.picture is None:
        shown = f'<div class="gone">{escape(lane.problem)}</div>'
    else:
        still, alt = link(lane.picture, page), escape(f"{lane.label}: last frame")
        if last:
            shown = f'<img src="{still}" alt="{alt}">'
        else:
            source = f'<source media="(prefers-reduced-motion: reduce)" srcset="{still}">'
            film = f'<img src="{link(lane.clip, page)}" alt="{escape(lane.label)} in motion">'
            shown = f"<picture>{source}{film}</picture>"
    return f'<figure class="{kind}">{shown}<figcaption>{caption}</figcaption></figure>'


def scores(lane: Lane) -> list[str]:
    """``12.3 mm`` and ``0.4 % collision``, as far as they are known."""
    if lane.label == RECORDED:
        return ["what the others are compared with"]
    parts = []
    if "error_mm" in lane.scores:
        parts.append(f"{lane.scores['error_mm']:.3g} mm")
    if "collision_percent" in lane.scores:
        parts.append(f"{lane.scores['collision_percent']:.2g} % collision")
    return parts


def _row(row: Sequence[str], lowest: dict[int, float]) -> str:
    paper = row[0].endswith(PAPER) or row[0] == OF_PAPER
    kind = ' class="paper"' if paper else ' class="floor"' if row[0] == FLOOR else ""
    cells = [f'<th scope="row">{escape(row[0])}</th>']
    for k, cell in enumerate(row[1:], 1):
        marked = not kind and k in lowest and _value(cell) == lowest[k]
        shown = RANGE.sub(r" <small>(\1)</small>", escape(cell))
        cells.append(f"<td{BEST if marked else ''}>{shown}</td>")
    return f"<tr{kind}>{''.join(cells)}</tr>"


def _lowest(content: Table) -> dict[int, float]:
    """Lowest number of each column among our rows, where there are at least two."""
    found = {}
    ours = [row for row in content.rows if not row[0].endswith(PAPER) and row[0] != FLOOR]
    for k, column in enumerate(content.columns):
        values = [value for row in ours if k and column not in NO_SCORES and (value := _value(row[k])) is not None]
        if len(values) > 1:
            found[k] = min(values)
    return found


def _value(cell: str) -> float | None:
    match = NUMBER.match(cell)
    return float(match.group()) if match else None
