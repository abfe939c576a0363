"""A table as notebooks show it."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_HTML_ROWS = 12


def html_table(title: str, columns: Mapping[str, NDArray[Any]], count: int) -> str:
    """Return columns of `count` rows as HTML: the first and the last rows of a long one."""
    half = MAX_HTML_ROWS // 2
    shown: list[int | None] = list(range(count))
    if count > MAX_HTML_ROWS:
        shown = [*range(half), None, *range(count - half + 1, count)]
    head = "".join(f"<th>{html.escape(name)}</th>" for name in columns)
    body = "".join(f"<tr>{_row(columns, row)}</tr>" for row in shown)
    return (
        f"<table><caption>{title}, {count} rows</caption>"
        f"<thead><tr><th></th>{head}</tr></thead><tbody>{body}</tbody></table>"
    )


def _row(columns: Mapping[str, NDArray[Any]], row: int | None) -> str:
    if row is None:
        return "<td>…</td>" * (len(columns) + 1)
    fields = (_field(values[row]) for values in columns.values())
    return f"<th>{row}</th>" + "".join(f"<td>{field}</td>" for field in fields)


def _field(value: Any) -> str:
    return html.escape(f"{value:.10g}" if isinstance(value, np.floating) else str(value))
