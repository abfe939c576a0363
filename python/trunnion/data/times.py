"""Times of a measurement: from where they count, and what they lack where changes are sought."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from itertools import combinations
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.files.table import Table

T = TypeVar("T")

MIN_TIMES = 3
FAR_S = 86400.0
"""A clock that begins farther than a day from 0 counts from elsewhere, as from the year 1970."""
SHOWN = "%Y-%m-%d %H:%M:%S"


def elapsed_s(time_s: ArrayLike) -> Floats:
    """Time of each reading since the first, (n,): the clock of a measurement begins anywhere.

    What changes with time is counted from there in every kind of data; the moment of a jump is
    stated by the clock itself (:func:`from_first_reading`). The core does the same for touches.
    """
    time = np.asarray(time_s, dtype=np.float64)
    return time - np.min(time) if len(time) else time


def begin_and_span_s(data: Table) -> tuple[float, float]:
    """When the first reading was made by the clock of the data, and how long all of them took, s.

    0 and 0 without times.
    """
    time = data.columns.get("time_s")
    if time is None or not len(time):
        return 0.0, 0.0
    return float(np.min(time)), float(np.ptp(time))


def from_first_reading(data: T) -> T:
    """Return data whose clock counts from elsewhere with times since their first reading.

    Of data with a clock for each part, such as each pass of a tool, since the first of the part.
    Other data as they are: moments are stated by the clock that users see in their rows.
    """
    begin_s = _begin_elsewhere_s(data)
    if begin_s is None or not isinstance(data, Table):
        return data
    return data.counted_from(begin_s)


def _begin_elsewhere_s(data: Any) -> Floats | None:
    """When the first reading was made, of each row; None: its clock counts from about there."""
    time = data.columns.get("time_s") if isinstance(data, Table) else None
    if time is None or not len(time) or time.dtype.kind != "f" or abs(np.min(time)) <= FAR_S:
        return None
    begin_s = np.full(len(time), float(np.min(time)))
    parts = data.columns.get(data.clock)
    for part in () if parts is None else np.unique(parts):
        begin_s[parts == part] = np.min(time[parts == part])
    return begin_s


def clock_notes(data: Any) -> tuple[str, ...]:
    """Say by which clock times are stated, where it is not that of the rows."""
    begin_s = _begin_elsewhere_s(data)
    if begin_s is None:
        return ()
    part = f" of its {data.clock}" if data.clock in data.columns else ""
    return (
        f"time_s begins at {float(np.min(begin_s)):.10g} s: here times count from the first "
        f"reading{part}.",
    )


def check_order(measured: Sequence[Any], numbers: Sequence[int] | None = None) -> None:
    """Refuse measurements whose dates are known and say another order than they are given in.

    What happened before one of them is in all that follow. Times that overlap are in any order.

    numbers: Theirs in the list that was given, from 0.

    Raises InputError: one that ended before one given before it began.
    """
    spans = []
    for number, one in zip(numbers or range(len(measured)), measured, strict=True):
        began = one.began if isinstance(one, Table) else None
        if began is not None and len(one):
            begin_s, span_s = begin_and_span_s(one)
            first = began + timedelta(seconds=begin_s)
            spans.append((first, first + timedelta(seconds=span_s), _called(one, number)))
    for (first, _, earlier), (_, last, later) in combinations(spans, 2):
        if (first.tzinfo is None) == (last.tzinfo is None) and last < first:
            order = [name for _, _, name in sorted(spans, key=lambda span: span[0].timestamp())]
            raise InputError(
                f"measurements: got {later}, which ended {last:{SHOWN}}, after {earlier}, which "
                f"began {first:{SHOWN}}, expected them in the order of time: what changed "
                f"before one is changed in all that follow it. By their dates: {', '.join(order)}"
            )


def _called(one: Table, number: int) -> str:
    """Name a measurement by its file, else by its number, from 1."""
    files = () if one.origin is None else one.origin.names
    return files[0] if len(files) == 1 else f"measurement {number + 1}"


def time_notes(data: Any) -> tuple[str, ...]:
    """Say that times do not change, or that they fall; anything but a table has no times."""
    time = data.columns.get("time_s") if isinstance(data, Table) else None
    if time is None or len(time) < MIN_TIMES:
        return ()
    if not np.ptp(time):
        return (f"time_s is {time[0]:g} in every row: no change with time can be found.",)
    parts = data.columns.get(data.clock)
    if parts is not None and not any(np.ptp(time[parts == part]) for part in np.unique(parts)):
        return (
            f"time_s is the same in all rows of each {data.clock}: no change with time within a "
            f"{data.clock} can be found.",
        )
    falls = (np.flatnonzero(np.diff(time) < 0) + 1 if data.in_order else np.empty(0, int)).tolist()
    if len(falls) == 1 and not _begins_another(data, falls[0]):
        row = falls[0]
        return (
            f"time_s falls once, from {time[row - 1]:g} to {time[row]:g} at {data.place(row)}: was "
            "the recording started again there? Then add to the later times what had passed: rows "
            "are taken to be made at the times that are written, and a drift depends on them.",
        )
    if len(falls) == len(time) - 1:
        return (
            "time_s falls from every row to the next: rows are taken to be made at these times, "
            "the last row first. If they count down, a drift has the other sign.",
        )
    return ()


def _begins_another(data: Table, row: int) -> bool:
    """Whether a row begins another set-up or run, which may have a clock of its own."""
    labels = (data.columns[name] for name in ("setup", "run") if name in data.columns)
    return any(each[row] != each[row - 1] for each in labels)
