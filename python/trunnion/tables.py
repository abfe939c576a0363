"""Tables for terminals and notebooks: one description, rendered as text by rich or as HTML."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence
from dataclasses import dataclass

from rich import box
from rich.console import Console
from rich.table import Table as RichTable

__all__ = ["Table", "number"]


def number(value: float | None, digits: int = 4) -> str:
    """A number for a table: fixed decimals, a dash for what is not there, "inf" spelled out."""
    if value is None:
        return "–"
    if value == float("inf"):
        return "not seen"
    text = f"{value:.{digits}f}"
    return text.replace("-", "−") if float(text) != 0 else f"{0:.{digits}f}"


@dataclass(frozen=True)
class Table:
    """A titled table; the first column is text, the others are numbers or text.

    Attributes
    ----------
    title
        What it shows, with units where all columns share them.
    columns
        Headings.
    rows
        Cells as text, one row each.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
        """A table from any sequences."""
        return cls(title, tuple(columns), tuple(tuple(row) for row in rows))

    def to_rich(self) -> RichTable:
        """For a rich console."""
        table = RichTable(
            title=self.title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD
        )
        for index, column in enumerate(self.columns):
            # Names stay whole on a narrow terminal: the numbers beside them wrap.
            least = max(len(row[0]) for row in self.rows) if index == 0 and self.rows else None
            table.add_column(column, justify="left" if index == 0 else "right", min_width=least)
        for row in self.rows:
            table.add_row(*row)
        return table

    def text(self, width: int = 110) -> str:
        """As plain text."""
        buffer = io.StringIO()
        Console(file=buffer, width=width, color_system=None, highlight=False).print(self.to_rich())
        return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines())

    def html(self) -> str:
        """As an HTML table."""

        def cells(tag: str, row: Sequence[str]) -> str:
            style = ' style="text-align:right"'
            return "".join(
                f"<{tag}{style if index else ''}>{html.escape(cell)}</{tag}>"
                for index, cell in enumerate(row)
            )

        body = "".join(f"<tr>{cells('td', row)}</tr>" for row in self.rows)
        return (
            f"<table><caption>{html.escape(self.title)}</caption>"
            f"<thead><tr>{cells('th', self.columns)}</tr></thead><tbody>{body}</tbody></table>"
        )
