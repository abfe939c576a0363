"""When measurements that are compared were made, and what each is called."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, date, datetime
from itertools import pairwise
from typing import Any

from trunnion.base.errors import InputError
from trunnion.data.times import check_order


def days_of(dates: Sequence[Any] | None, measured: Sequence[Any]) -> tuple[float, ...]:
    """Days from the first measurement; without dates their numbers.

    measured: Their data, whose own dates have to be in order, too; None where there are none.
    """
    check_order(measured)
    count = len(measured)
    if dates is None:
        return tuple(map(float, range(count)))
    if len(dates) != count:
        raise InputError(f"dates: got {len(dates)}, expected one a measurement, {count}")
    days = [_day(d) for d in dates]
    found = tuple(d - days[0] for d in days)
    if any(b < a for a, b in pairwise(found)):
        raise InputError("dates: got some out of order, expected them in order of time")
    if found[-1] <= 0:
        raise InputError(
            f"dates: got {dates[0]} for each of {count} measurements, expected some that differ: "
            "of one day with the time, 2026-01-31T14:30"
        )
    return found


def _day(when: Any) -> float:
    if isinstance(when, bool):
        raise InputError(f"dates: got {when!r}, expected a date, text as ISO 8601, or days")
    if isinstance(when, int | float) and math.isfinite(when):
        return float(when)
    try:
        if isinstance(when, str):
            when = datetime.fromisoformat(when)
        if isinstance(when, datetime):
            zoned = when if when.tzinfo else when.replace(tzinfo=UTC)
            return zoned.timestamp() / 86400.0
    except ValueError:
        pass
    if isinstance(when, date):
        return float(when.toordinal() - date(1970, 1, 1).toordinal())
    raise InputError(f"dates: got {when!r}, expected a date, text as ISO 8601, or days")


def names_of(
    names: Sequence[str] | None, dates: Sequence[Any] | None, count: int
) -> tuple[str, ...]:
    """What each measurement is called; those of one name have a number behind it."""
    if names is not None and len(names) != count:
        raise InputError(f"names: got {len(names)}, expected one a measurement, {count}")
    if names is None and dates is None:
        return ("before", "after") if count == 2 else tuple(str(i + 1) for i in range(count))
    called = [str(one) for one in (dates if names is None else names) or ()]
    return tuple(
        name if called.count(name) == 1 else f"{name} ({called[: i + 1].count(name)})"
        for i, name in enumerate(called)
    )
