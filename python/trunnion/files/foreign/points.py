"""Points of a laser tracker or another measuring instrument: ``[NAME] X Y Z`` a line.

Separated by spaces, tabs, commas or semicolons; a header ``x y z`` may stand above. Channels are
called ``x``, ``y``, ``z`` and ``name``. The unit is not in the file.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from trunnion.files.columns import parse_number
from trunnion.files.foreign.channels import Channels, numbers
from trunnion.files.text import Source

NAME = "list of points"
AXES = ("x", "y", "z")
_BETWEEN = re.compile(r"[ \t]*[,;][ \t]*|[ \t]+")


def _fields(line: str) -> list[str]:
    return _BETWEEN.split(line.strip())


def _header(fields: Sequence[str]) -> bool:
    return tuple(field.lower() for field in fields[-3:]) == AXES and len(fields) <= 4


def matches(source: Source) -> bool:
    """Whether there is a header x y z, or a name that is no number before three that are."""
    filled = source.filled()[:20]
    if not filled:
        return False
    first = _fields(source.lines[filled[0]])
    if _header(first):
        return True
    rows = [_fields(source.lines[i]) for i in filled]
    return all(
        len(row) == 4
        and parse_number(row[0]) is None
        and all(parse_number(text) is not None for text in row[1:])
        for row in rows
    )


def read(source: Source, wanted: Sequence[str] | None, period_s: float | None) -> Channels:
    """Return coordinates, and names where there are some."""
    del wanted, period_s
    rows = source.filled()
    first = _fields(source.lines[rows[0]])
    if _header(first):
        rows = rows[1:]
    if not rows:
        raise source.error(len(source.lines) - 1, 0, "got no point, expected at least one")
    width = len(_fields(source.lines[rows[0]]))
    names, table = [], []
    for i in rows:
        fields = _fields(source.lines[i])
        if width == 4 and len(fields) == 4:
            names.append(fields.pop(0))
        table.append(numbers(source, i, fields, AXES))
    columns = dict(zip(AXES, np.array(table).T, strict=True))
    return Channels(
        {**columns, **({"name": np.array(names, dtype=object)} if names else {})},
        [i + 1 for i in rows],
    )
