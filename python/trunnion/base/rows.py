"""Rows of long arrays, some at a time: a processor works faster on what its cache holds."""

from collections.abc import Iterator

import numpy as np

from trunnion.base.units import Flags, Integers

ROWS_AT_HAND = 1 << 14


def at_hand(count: int) -> Iterator[slice]:
    """Slices of so many rows, in order."""
    return (slice(first, first + ROWS_AT_HAND) for first in range(0, count, ROWS_AT_HAND))


def where(some: Flags) -> slice | Integers:
    """Which are true; as a slice, which is no copy, where they are evenly spaced."""
    rows = np.flatnonzero(some)
    steps = np.diff(rows)
    if len(rows) > 1 and np.all(steps == steps[0]):
        return slice(int(rows[0]), int(rows[-1]) + 1, int(steps[0]))
    return rows
