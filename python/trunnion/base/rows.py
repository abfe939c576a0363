"""Rows of long arrays, some at a time: a processor works faster on what its cache holds."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.units import Flags, Floats, Integers

ROWS_AT_HAND = 1 << 14


def at_hand(count: int) -> Iterator[slice]:
    """Slices of so many rows, in order."""
    return (slice(first, first + ROWS_AT_HAND) for first in range(0, count, ROWS_AT_HAND))


def product_of_seen(rows: Floats, columns: Floats) -> Floats:
    """Return rows (m, n) times columns (n,) or (n, s), of which those all zero cost nothing."""
    if columns.ndim == 1:
        return np.asarray(rows @ columns)
    seen = seen_of(columns)
    if seen.all():
        return np.asarray(rows @ columns)
    out = np.zeros((len(rows), columns.shape[1]))
    out[:, seen] = rows @ columns[:, seen]
    return out


def seen_of(columns: Floats) -> Flags:
    """Which columns, (n, ...), have any number but zeros: by their squares, the quickest sum.

    Those that are smaller than 1e-160 are none.
    """
    return np.asarray(np.einsum("i...,i...->...", columns, columns) != 0.0)


def where(some: Flags) -> slice | Integers:
    """Which are true; as a slice, which is no copy, where they are evenly spaced."""
    rows = np.flatnonzero(some)
    steps = np.diff(rows)
    if len(rows) > 1 and np.all(steps == steps[0]):
        return slice(int(rows[0]), int(rows[-1]) + 1, int(steps[0]))
    return rows


def equal_rows(parts: Sequence[ArrayLike]) -> tuple[Integers, Integers]:
    """Label each row, (n,) a part, alike where rows are equal; with the first row of each label."""
    columns = [np.asarray(part, dtype=np.float64) for part in parts]
    # Equal rows have equal sums: one column to sort.
    total = np.sum([np.sqrt(2.0 + i) * x for i, x in enumerate(columns)], axis=0)
    _, first, label = np.unique(total, return_index=True, return_inverse=True)
    if any(np.any(x != x[first[label]]) for x in columns):  # and others by chance
        rows = np.stack(columns, axis=1)
        _, first, label = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return label.reshape(-1), first


def repeats(parts: Sequence[ArrayLike], each: int = 1) -> Integers | None:
    """Labels of readings whose rows, (n,) a part, are equal; -1 without a repeat, None: no repeats.

    each: How many readings a row has.
    """
    label = equal_rows(parts)[0]
    several = np.repeat(np.bincount(label)[label] > 1, each)
    labels = each * np.repeat(label, each) + np.tile(np.arange(each), len(label))
    return np.where(several, labels, -1).astype(np.intp) if several.any() else None
