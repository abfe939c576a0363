"""What the times of a measurement lack where changes with time are looked for."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.files.table import Table

MIN_TIMES = 3


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
    if data.in_order and (np.diff(time) < 0).all():
        return (
            "time_s falls from every row to the next: rows are taken to be made at these times, "
            "the last row first. If they count down, a drift has the other sign.",
        )
    return ()
