"""Dates of a table whose times were dates: kept in files, put on one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.units import Floats


def with_dates(
    columns: Mapping[str, NDArray[Any]], began: datetime | None, time: str
) -> Mapping[str, NDArray[Any]]:
    """Return columns as they are written to a file: its times are dates again where they were.

    began: At 0 of the times; None: they were seconds. time: Name of their column.
    """
    times = columns.get(time)
    if began is None or times is None or times.dtype.kind != "f":
        return columns
    try:
        dates = [(began + timedelta(seconds=one)).isoformat() for one in times.tolist()]
    except OverflowError:  # a time that was put in since is beyond the years that a date has
        return columns
    return {**columns, time: np.array(dates, dtype=np.str_)}


def clocks_apart(began: Sequence[datetime | None]) -> tuple[datetime | None, list[float]]:
    """Return the date at which a clock common to tables begins, and where each begins on it, s.

    None and zeros: the date of one is not known, or only some have a time zone.
    """
    known = [date for date in began if date is not None]
    unknown = len(known) < len(began) or not known
    if unknown or len({date.utcoffset() is None for date in known}) > 1:
        return None, [0.0] * len(began)
    return known[0], [(date - known[0]).total_seconds() for date in known]


def on_one_clock(times: Sequence[Floats], begin_s: Sequence[float]) -> list[Floats]:
    """Return times of tables counted from the begin of the common clock."""
    return [time + begin if begin else time for time, begin in zip(times, begin_s, strict=True)]
