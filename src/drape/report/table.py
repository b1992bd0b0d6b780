"""A table that can be printed in a terminal and written as Markdown."""

from __future__ import annotations

from dataclasses import dataclass

from rich.markup import escape
from rich.table import Table as RichTable


@dataclass(frozen=True)
class Table:
    """Rows of text; the first column names the row."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    footnotes: tuple[str, ...] = ()

    def markdown(self) -> str:
        """The table with its title as a heading of level 3."""
        lines = [f"### {self.title}", ""] + ([self.note, ""] if self.note else [])
        lines += [_line(self.columns), "|---" + "|---:" * (len(self.columns) - 1) + "|"]
        lines += [_line(row) for row in self.rows]
        lines += ["", *(f"* {footnote}" for footnote in self.footnotes)] if self.footnotes else []
        return "\n".join(lines) + "\n"

    def terminal(self) -> RichTable:
        """The same for a console of ``rich``."""
        title, note = escape(self.title), escape("\n".join(filter(None, (self.note, *self.footnotes)))) or None
        table = RichTable(title=title, caption=note, title_justify="left", caption_justify="left")
        for k, column in enumerate(self.columns):
            table.add_column(escape(column), justify="right" if k else "left", overflow="fold")
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table


def _line(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def number(value: float) -> str:
    """At least three digits, two decimals where that is enough: 0.94, 85.74, 1052, 0.00123, 1.2e+05."""
    size = abs(value)
    if size == 0 or 0.1 <= size < 1000:
        return f"{value:.2f}"
    return f"{value:.0f}" if 1000 <= size < 1e5 else f"{value:.3g}"
