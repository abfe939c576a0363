"""What stands beside a reading under the pointer: where it is in its file, and its columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trunnion.base.units import unit_of, without_unit
from trunnion.files.origin import places
from trunnion.files.table import Table
from trunnion.plot.picture import MAX_COLUMNS, Form, Picture, Series

MAX_SHOWN = 8
"""Columns beside a reading."""
LEFT_OUT = ("dir_x", "dir_y", "dir_z")


def hovered(picture: Picture, data: Sequence[Table]) -> Picture:
    """Return a picture, thinned, whose points tell file, line and columns of their data row.

    data: What was measured; rows of several are counted on.
    """
    picture = picture.thinned(MAX_COLUMNS)
    if not data:
        return picture
    known: dict[int, str] = {}
    series = tuple(_with_texts(s, picture, data, known) for s in picture.series)
    return replace(picture, series=series)


def _with_texts(s: Series, p: Picture, data: Sequence[Table], known: dict[int, str]) -> Series:
    if s.form is not Form.POINTS or s.rows is None:
        return s
    texts = []
    for row, value in zip(s.rows.tolist(), s.y.tolist(), strict=True):
        if row not in known:
            known[row] = _of_row(row, data)
        texts.append(f"{known[row]}\n{p.y.label or 'value'} {value:.4g} {p.y.unit}".rstrip())
    return replace(s, hover=tuple(texts))


def _of_row(row: int, data: Sequence[Table]) -> str:
    for one in data:
        if row < len(one):
            break
        row -= len(one)
    else:
        return f"row {row}"
    return "\n".join([places(one, [row]), *columns_of(one, row)])


def columns_of(data: Table, row: int) -> list[str]:
    """Say the first columns of a row."""
    names = [
        name for name in data.columns if name not in LEFT_OUT and not name.startswith("start_")
    ][:MAX_SHOWN]
    said = [_said(name, data.columns[name][row]) for name in names]
    if not set(LEFT_OUT) <= set(data.columns):
        return said
    along = [float(data.columns[name][row]) for name in LEFT_OUT]
    k = int(np.argmax(np.abs(along)))
    return [*said, f"approach {'−+'[along[k] > 0]}{'XYZ'[k]}"]


def _said(name: str, value: object) -> str:
    """Say a field: ``a_deg`` → "a 90 deg"."""
    unit = unit_of(name)
    text = f"{value:.7g}" if isinstance(value, float | np.floating) else str(value)
    return f"{without_unit(name)} {text} {unit}".replace("_", " ").rstrip()
