"""Readings of electronic levels: a CSV file with a column of inclination for each axis.

Two are known: the export of Wyler's instruments (``"Date Time";"B7514X [rad]";...``: the unit in
brackets) and that of level_solver (``trigger,raw_x_mm_per_m,raw_y_mm_per_m``). Neither says where
the instrument stood or which of its axes was along the guideway.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from trunnion.files.delimited import Delimited
from trunnion.files.foreign.channels import Channels
from trunnion.files.text import Source

NAME = "electronic level CSV"
_BRACKETS = re.compile(r".*\[\s*(rad|mrad|mm/m|µm/m|um/m|arcsec)\s*\]\s*")
_SUFFIXES = {"_mm_per_m": "mm/m", "_um_per_m": "µm/m", "_rad": "rad"}


def matches(source: Source) -> bool:
    """Whether a column of the header has the unit of an inclination, in one of the two ways."""
    filled = source.filled()
    return bool(filled) and bool(_UNITS.search(source.lines[filled[0]]))


_UNITS = re.compile(r"\[\s*(?:rad|mrad|mm/m|µm/m|um/m|arcsec)\s*\]|raw_[xy]_(?:mm|um)_per_m")


def read(source: Source, wanted: Sequence[str] | None, period_s: float | None) -> Channels:
    """Return the columns with their units."""
    del wanted, period_s
    file = Delimited(source)
    columns = file.columns()
    units = {}
    for name in columns:
        found = _BRACKETS.fullmatch(name)
        end = next((u for s, u in _SUFFIXES.items() if name.endswith(s)), None)
        if found or end:
            units[name] = found[1] if found else str(end)
    return Channels(
        columns,
        [i + 1 for i in file.data_lines],
        units,
        separator=file.separator,
        decimal=file.decimal,
        notes=tuple(file.notes),
    )
