"""Rows of long arrays, some at a time: a processor works faster on what its cache holds."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

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


def repeats(parts: Sequence[ArrayLike], each: int = 1) -> Integers | None:
    """Labels of readings whose rows, (n,) a part, are equal; -1 without a repeat, None: no repeats.

    each: How many readings a row has.
    """
    columns = [np.asarray(part) for part in parts]
    order = np.lexsort(columns[::-1])
    new = np.zeros(len(order), dtype=bool)
    for column in (x[order] for x in columns):
        new[1:] |= column[1:] != column[:-1]
    label = np.empty(len(order), dtype=np.intp)
    label[order] = np.cumsum(new)
    several = np.repeat(np.bincount(label)[label] > 1, each)
    labels = each * np.repeat(label, each) + np.tile(np.arange(each), len(label))
    return np.where(several, labels, -1).astype(np.intp) if several.any() else None
