"""Readings that stand at another row than they belong to: shifted by one, or two exchanged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.units import Flags, Floats, Integers
from trunnion.data.deviations import nominal_readings
from trunnion.data.sweep import Sweep
from trunnion.files.table import Table

MIN_ROWS = 8
MIN_SHIFTED = 3
"""Rows in sequence that hold the readings of their neighbours: fewer are single mistakes."""
NEAR = 0.1
"""Of the usual distance from one position to the next: a reading is at a position."""
MAX_OTHERS = 1
"""Rows beside the shifted ones that hold no reading of theirs: where the shift begins or ends."""
MIN_RADIUS = 1e-6  # mm
TURN_DEG = 360.0


def displaced_rows(data: Any) -> str:
    """Say which readings belong to other rows; empty: all are near their own, or nothing is known.

    Of data whose readings are places near nominal ones, and of targets on a rotary axis.
    """
    if isinstance(data, Sweep):
        return _on_axis(data)
    nominal = nominal_readings(data) if isinstance(data, Table) else {}
    if len(nominal) < 2:  # a length is the same in many rows
        return ""
    expected = np.stack([np.asarray(x, dtype=np.float64) for x in nominal.values()], axis=1)
    read = np.stack([np.asarray(data[n], dtype=np.float64) for n in nominal], axis=1)
    return displaced(read, expected, data.place)


def displaced(
    measured: Floats, expected: Floats, place: Callable[[int], str], period: float = np.inf
) -> str:
    """Say which of measured places belong to other rows; empty: none.

    measured, expected: In the order of measurement, (n,) or (n, d); a constant apart.
    place: Where people find a row. period: Of angles.
    """
    read, meant = (x.reshape(len(x), -1) for x in (measured, expected))
    if len(read) < MIN_ROWS:
        return ""
    moves = np.linalg.norm(_around(np.diff(meant, axis=0), period), axis=1)
    if not np.any(moves > 0):
        return ""
    near = NEAR * float(np.median(moves[moves > 0]))
    if np.all(_is_near(read - meant - _constant(read - meant, period), near, period)):
        return ""
    found = [(run, by) for by in (1, -1) for run in _shifted(read, meant, by, near, period)]
    if not found:
        return _exchanged(read, meant, near, period, place)
    # By another constant the readings before a shift are shifted the other way.
    (start, end), by = min(found, key=lambda one: one[0][0] == 0)
    first, last = place(start), place(end - 1)
    which, why = ("after", "was a reading left out")
    if by < 0:
        which, why = "before", "was a reading entered twice, or a position left out,"
    return f"from {first} to {last} each reading is that of the row {which}: {why} at {first}?"


def _shifted(
    read: Floats, meant: Floats, by: int, near: float, period: float
) -> Iterator[tuple[int, int]]:
    """Yield first row and end of readings that are those of the row `by` further on."""
    n = len(read)
    other = np.full_like(meant, np.nan)
    rows = np.arange(max(0, -by), min(n, n - by))
    other[rows] = meant[rows + by]
    for zero in (_constant(read - meant, period), _constant((read - other)[rows], period)):
        own = _is_near(read - meant - zero, near, period)
        moved = _is_near(read - other - zero, near, period)
        same = own & moved  # the next position is the same one
        run = _longest(moved & ~own, same)
        if run is None or np.sum((moved & ~own)[run[0] : run[1]]) < MIN_SHIFTED:
            continue
        outside = np.ones(n, dtype=bool)
        outside[run[0] : run[1]] = False
        wrong = np.flatnonzero(outside & ~own)
        beside = (run[0] - 1, run[1])
        few = len(wrong) <= MAX_OTHERS and all(row in beside for row in wrong.tolist())
        if few and np.sum(outside & own) >= MIN_SHIFTED:  # all of them are a constant apart
            yield run


def _exchanged(
    read: Floats, meant: Floats, near: float, period: float, place: Callable[[int], str]
) -> str:
    """Say which two readings are at each other's position; empty: none."""
    zero = _constant(read - meant, period)
    wrong = np.flatnonzero(~_is_near(read - meant - zero, near, period))
    if len(wrong) != 2:
        return ""
    crossed = _is_near(read[wrong] - meant[wrong[::-1]] - zero, near, period)
    if not np.all(crossed):
        return ""
    first, second = (place(int(row)) for row in wrong)
    return f"the reading at {first} is that of {second}, and the other way round: exchanged?"


@dataclass(frozen=True, eq=False)
class _Places:
    """Where people find some rows of data."""

    data: Table
    rows: Integers

    def __call__(self, row: int) -> str:
        return self.data.place(int(self.rows[row]))


def _on_axis(data: Sweep) -> str:
    """The same of a sweep: angles of each target about its circle, over those of the axis."""
    commanded = np.asarray(data.angle_deg, dtype=np.float64)
    said = ""
    for target in np.unique(np.asarray(data.target)):
        rows = np.flatnonzero(np.asarray(data.target) == target)
        angles = _angles(data.position_mm[rows])
        if angles is None:
            continue
        where = _Places(data, rows)
        texts = [
            displaced(sense * angles, commanded[rows], where, TURN_DEG) for sense in (1.0, -1.0)
        ]
        found = next(filter(None, texts), "")
        if not found:
            return ""  # of one target alone: no station
        said = said or f"of target {target}, as of all, {found}"
    return said if len(np.unique(np.asarray(data.target))) > 1 else said.replace(", as of all,", "")


def _angles(places: Floats) -> Floats | None:
    """Angles of places (n, 3) about the middle of their circle, deg; None: on no circle."""
    if len(places) < MIN_ROWS:
        return None
    about = places - places.mean(axis=0)
    flat = about @ np.linalg.svd(about, full_matrices=False)[2][:2].T
    terms = np.column_stack([2 * flat, np.ones(len(flat))])
    centre = np.linalg.lstsq(terms, np.sum(flat**2, axis=1), rcond=1e-12)[0][:2]
    away = flat - centre
    if np.linalg.norm(away, axis=1).min() < MIN_RADIUS:
        return None
    return np.asarray(np.degrees(np.arctan2(away[:, 1], away[:, 0])))


def _around(values: Floats, period: float) -> Floats:
    """Differences of angles within half a turn; others as they are."""
    if not np.isfinite(period):
        return values
    return np.asarray(values - period * np.round(values / period))


def _constant(apart: Floats, period: float) -> Floats:
    """The usual difference of readings and positions, by component."""
    if not np.isfinite(period):
        return np.asarray(np.median(apart, axis=0))
    first = np.median(_around(apart, period), axis=0)
    about = _around(apart - first, period)
    return np.asarray(first + np.median(about, axis=0))


def _is_near(apart: Floats, near: float, period: float) -> Flags:
    """Whether a reading is at a position; not where there is none (NaN)."""
    distance = np.linalg.norm(_around(apart, period), axis=1)
    return np.asarray(np.nan_to_num(distance, nan=np.inf) <= near)


def _longest(moved: Flags, same: Flags) -> tuple[int, int] | None:
    """First and end of the longest run of moved rows; rows that are the same go with them."""
    best: tuple[int, int] | None = None
    start: int | None = None
    for row in range(len(moved) + 1):
        if row < len(moved) and (moved[row] or (same[row] and start is not None)):
            start = row if start is None else start
            continue
        if start is not None:
            end = row
            while not moved[end - 1]:
                end -= 1
            if best is None or end - start > best[1] - best[0]:
                best = (start, end)
        start = None
    return best
