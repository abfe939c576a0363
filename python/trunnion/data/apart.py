"""Rows that are no readings: drop-outs, zeros where nothing was measured, typing errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from trunnion.base.statistics import NORMAL_MEDIAN
from trunnion.base.units import Flags, Floats, Integers
from trunnion.files.origin import places
from trunnion.files.table import Table

MAX_SHARE = 0.1
"""Of the rows, that are taken for no readings: more are a part of the measurement."""
FAR = 20.0
"""Median distances from the median, from which on a reading is far from all others."""
FAR_STOP = 30.0
"""Spreads of repeated stops (1 sigma), from which on a stop is far from the others."""
MAX_SHOWN = 3
"""Rows that are listed."""


def rows_apart(data: Table, nominal: Mapping[str, Floats]) -> Iterator[Flags]:
    """Yield which rows may be no readings: of one value in all columns, or far from the others.

    nominal: What readings should be, by their name, (n,) each, as far as the data say.
    """
    read = {name: np.asarray(values, dtype=np.float64) for name, values in data.readings.items()}
    if not read:
        return
    values = np.stack(list(read.values()), axis=1)
    same = np.all(values == values[:, :1], axis=1) if values.shape[1] > 1 else values[:, 0] == 0.0
    far = np.zeros(len(data), dtype=bool)
    for name, column in read.items():
        off = np.abs(column - nominal.get(name, 0.0) - np.median(column - nominal.get(name, 0.0)))
        far |= off > FAR * np.median(off)
    for some in (far, same):
        if some.any() and some.sum() <= MAX_SHARE * len(data):
            yield some


def said_of(data: Table, apart: Flags) -> str:
    """Say which rows do not go with the others, and what they hold where that is one value."""
    rows = np.flatnonzero(apart)
    held = {name: np.unique(column[apart]) for name, column in data.readings.items()}
    alike = all(len(some) == 1 for some in held.values())
    what = " and ".join(f"{some[0]:g} in {name}" for name, some in held.items()) if alike else ""
    what = what or f"values of {' and '.join(held)} that are far from all others"
    one = len(rows) == 1
    return (
        f"{len(rows)} of {len(data)} rows {'does' if one else 'do'} not go with the others (a "
        f"drop-out, nothing measured, a typing error?): {places(data, rows.tolist(), MAX_SHOWN)} "
        f"hold{'s' if one else ''} {what}"
    )


def far_repeats(values: Floats, repeats: Integers, least: float) -> Flags:
    """Whether a value, (n,), is far from others of its repeats, and so seldom that it is none.

    repeats: Number of the place and way of each. least: Below this the spread is not.
    """
    off = np.zeros(len(values))
    for number in np.unique(repeats):
        mine = repeats == number
        off[mine] = values[mine] - np.median(values[mine])
    usual = np.abs(off[off != 0.0])  # the median of an odd number is one of them
    if not len(usual):
        return np.zeros(len(values), dtype=bool)
    spread = max(float(np.median(usual)) / NORMAL_MEDIAN, least)
    far = np.abs(off) > FAR_STOP * spread
    return far if far.sum() <= MAX_SHARE * len(values) else np.zeros_like(far)
