"""Named series of values, as a foreign file has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.units import Floats
from trunnion.files.columns import parse_number, shown_field
from trunnion.files.text import Source


@dataclass(frozen=True)
class Channels:
    """Columns of a file under the names that the file has for them.

    columns: By name, numbers or text, of equal length.
    lines: Line of each row, from 1.
    units: Where the file says them.
    time_s: Times of the rows; None where the file has none, or has them as a column.
    clock: Where the times come from, in words.
    separator, decimal: Of the file.
    notes: What else was decided, one sentence each.
    """

    columns: Mapping[str, NDArray[Any]]
    lines: Sequence[int]
    units: Mapping[str, str] = field(default_factory=dict)
    time_s: Floats | None = None
    clock: str = ""
    separator: str = " "
    decimal: str = "."
    notes: tuple[str, ...] = ()


def numbers(
    source: Source, line: int, fields: Sequence[str], names: Sequence[str], mark: str | None = None
) -> list[float]:
    """Return the fields of a line as numbers, as many as there are names.

    mark: What separates the fields; None: spaces.

    Raises FileFormatError: another number of fields, or one that is no finite number.
    """
    if len(fields) != len(names):
        raise source.error(
            line, 0, f"got {len(fields)} fields, expected {len(names)}: {', '.join(names)}"
        )
    found = []
    for i, (name, text) in enumerate(zip(names, fields, strict=True)):
        value = parse_number(text)
        if value is None or not np.isfinite(value):
            at = _start(source.lines[line], i, mark)
            raise source.error(
                line, at, f"{name}: got {shown_field(text)}, expected a finite number"
            )
        found.append(value)
    return found


def _start(line: str, index: int, mark: str | None) -> int:
    """Return where a field of a line begins."""
    rest = line.split(mark, index)[-1] if index < len(line.split(mark)) else ""
    return len(line) - len(rest.lstrip()) if rest else 0
