"""Rows that are no readings of their own: pasted twice, copied to other labels, given twice.

Readings in steps that were taken again may be the same without being copies. Where some repeats
differ, these show how often honest ones would agree: rows are copies where so many agree hardly by
chance. Where all agree, the readings of one cycle show it, if they are in a few steps: noise takes
them from one step to the next and back at once, a machine alone hardly does. Others that all agree
say no more than one of them, copied or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from trunnion.base.recognition import MIN_STEP, recognised
from trunnion.base.rows import equal_rows
from trunnion.base.units import Flags, Floats, Integers
from trunnion.files.table import Table

LABELS = ("cycle", "pass", "run")
"""Columns that number what was measured again; a copy has others, and other times."""
PLACEMENT = "setup"
"""Column that names what was put up: a copy may call it otherwise."""
MIN_COPIED = 6
"""Rows of a block: fewer may repeat others by chance where readings are in steps."""
MAX_CHANCE = 1e-6
"""That so many honest repeats agree, below which they are copies."""
ALIKE_LEVEL = 0.01
"""The same of cycles that are all alike."""
MAX_STEPS = 50
"""Over which the readings of cycles that are all alike go, if they are honest."""
NEXT_STEP = 1.2
"""Rms of the differences of repeats that differ, in steps, up to which most may agree."""
OFTEN = 0.5
"""Share of agreeing repeats times that rms: 0.4 of normal noise of some steps."""

SAME = 1e-12
"""Of the largest reading: rounding of numbers."""

WHOLE = 1e-5
MAX_DIGITS = 9
"""After the decimal point; what has more was not written by hand or by a table."""
FEWER_DIGITS = 1
"""Of a rounded copy, at least."""
LEAST_DIGITS = 3
"""Of a rounded copy of a whole measurement: what is nominal has fewer."""
PLANNED = ("Touches",)
"""Data of which a plan has the columns of readings: they round to it."""
MIN_CYCLES = 2
"""Of repeats."""
ALL_ALIKE = (
    "Every {0} repeats the first to the last digit (copied, or alike in steps?): the readings show "
    "no repeatability."
)
_WHERE_PASTED = "in every column (pasted twice, or alike in steps?)"
_WHERE_ROUNDED = "with fewer digits (pasted from a rounded table?)"
_WHERE_LATER = "in every column but time_s (pasted with other times, or alike in steps?)"


class Distinct(NamedTuple):
    """Rows that are readings of their own.

    data: These rows alone.
    rows: Which rows of the given data they are; None: all.
    stands_for: Of every row given, the row of `data` that it is or repeats; None: itself.
    notes: What was left out; empty: nothing.
    """

    data: Any
    rows: Integers | None = None
    stands_for: Integers | None = None
    notes: tuple[str, ...] = ()

    def numbers(self, given: Sequence[int]) -> Integers:
        """Return the numbers in `data` of rows that are counted in the given data."""
        rows = np.asarray(given, dtype=np.intp)
        return rows if self.stands_for is None else self.stands_for[rows]


def distinct_rows(data: Any) -> Distinct:
    """Return the data without rows that are no readings of their own, which rows, and notes.

    Rows of which others repeat the commands and differ are readings of their own, unless so many
    agree hardly by chance.
    """
    if not isinstance(data, Table) or len(data) < 2:
        return Distinct(data)
    first, notes = np.arange(len(data)), []
    stands_for = first
    for found, what in (
        (_once, _WHERE_PASTED),
        (_with_other_times, _WHERE_LATER),
        (_with_fewer_digits, _WHERE_ROUNDED),
        (
            _without_copies,
            f"to the last digit under another {_label(data)} (copied, or alike in steps?)",
        ),
    ):
        original = found(data[first] if len(first) < len(data) else data)
        if not np.array_equal(original, np.arange(len(first))):
            own = np.unique(original)
            count = len(first) - len(own)
            notes.append(f"{count} of {len(first)} rows repeat others {what}: each counts once.")
            stands_for = np.searchsorted(own, original)[stands_for]
            first = first[own]
    used = data[first] if len(first) < len(data) else data
    if any(len(b) > 1 and _agree(used, b) for b in _of_same_commands(used)):  # no copies are left
        notes.append(ALL_ALIKE.format(_label(data)))
    return Distinct(data[first], first, stands_for, tuple(notes)) if notes else Distinct(data)


def given_again(data: Sequence[Any]) -> dict[int, int]:
    """Of some measurements those that another one has in every row but for times: which other.

    By their numbers. Also with the placement called otherwise, or with fewer digits. Measurements
    of fewer rows than `MIN_COPIED` may be alike by chance.
    """
    kept: list[int] = []
    out: dict[int, int] = {}
    tables = [i for i, one in enumerate(data) if isinstance(one, Table) and len(one) >= MIN_COPIED]
    types = [type(data[i]) for i in tables]
    tables = [i for i, own in zip(tables, types, strict=True) if types.count(own) > 1]
    digits = {i: _most_digits(data[i]) for i in tables}
    for i in sorted(tables, key=lambda i: (-len(data[i]), -digits[i])):
        of = next((j for j in kept if _is_in(data[i], digits[i], data[j], digits[j])), None)
        if of is None:
            kept.append(i)
        else:
            out[i] = of
    return dict(sorted(out.items()))


def _is_in(copy: Table, digits: int, data: Table, of: int) -> bool:
    """Whether a table of readings with so many digits has those of another one, which has ``of``.

    But for times and names of placements, or with fewer digits.
    """
    if type(data) is not type(copy):
        return False
    if _has_every_row(data, copy):
        return True
    columns = {*data.columns} ^ {*copy.columns}
    plan = type(data).__name__ in PLANNED or digits < LEAST_DIGITS
    if plan or columns - {PLACEMENT} or of < digits + FEWER_DIGITS:
        return False
    alike = [data, copy]
    if PLACEMENT in {*data.columns, *copy.columns}:
        alike = [one.with_columns(**{PLACEMENT: np.ones(len(one), dtype=int)}) for one in alike]
    original = _with_fewer_digits(type(data).concatenate(alike))
    return bool(np.all(original[len(data) :] < len(data)))


def _has_every_row(data: Table, other: Table) -> bool:
    """Whether a table has all rows of another one, but for times and names of placements."""
    names = [name for name in other.columns if name not in ("time_s", PLACEMENT)]
    if {*names} != {*data.columns} - {"time_s", PLACEMENT}:
        return False
    mine, theirs = ([one.columns[name] for name in names] for one in (data, other))
    first = np.all([a == b[0] for a, b in zip(mine, theirs, strict=True)], axis=0)
    if not first.any():  # cheap, and enough for nearly all
        return False
    rows = set(zip(*(column.tolist() for column in mine), strict=True))
    return all(row in rows for row in zip(*(column.tolist() for column in theirs), strict=True))


def _most_digits(data: Table) -> int:
    """Digits after the decimal point of the readings of a table, of the finest of them."""
    return max((int(_digits(v).max(initial=0)) for v in data.readings.values()), default=0)


def own_cycles(data: Table) -> Distinct:
    """Return the cycles that are no copies, as `distinct_rows`, for what is made of repeats.

    Of one cycle all that is alike may be repeats that an instrument shows alike. Where every cycle
    is as the first, they stay, and a note says of what the results are.
    """
    if _cycles(data) < MIN_CYCLES:
        return Distinct(data)
    own = distinct_rows(data)
    if not own.notes or _cycles(own.data) >= MIN_CYCLES:
        return own
    return Distinct(data, notes=(ALL_ALIKE.format(_label(data)),))


def _cycles(data: Table) -> int:
    """Count of repetitions."""
    name = _label(data)
    return len(np.unique(data.columns[name])) if name else 1


def _once(data: Table) -> Integers:
    """Of each row the first that is as it is in every column."""
    original = _first_equal(list(data.columns.values()))
    return np.arange(len(data)) if _by_chance(data, original) else original


def _with_other_times(data: Table) -> Integers:
    """Of each row of a run that repeats earlier rows one by one, but for times, that row.

    A run as long as a block: of single readings in steps the same may be read again. Samples of a
    log are distinguished by their times.
    """
    rows = np.arange(len(data))
    if "time_s" not in data.columns or data.kinds["time_s"].required:
        return rows
    first = _first_equal([v for name, v in data.columns.items() if name != "time_s"])
    again = np.flatnonzero(first != rows)
    if len(again) < MIN_COPIED:
        return rows
    at, run, runs = -1, list[int](), list[list[int]]()  # the row that was repeated last
    for row in again.tolist():
        follows = bool(run) and row == run[-1] + 1 and first[at + 1] == first[row]
        if not follows:
            run = []
            runs.append(run)
        at = at + 1 if follows else int(first[row])
        run.append(row)
    original = rows.copy()
    for run in runs:
        if len(run) >= MIN_COPIED:
            original[run] = first[run]
    return rows if _by_chance(data, original, "time_s") else original


def _with_fewer_digits(data: Table) -> Integers:
    """Of each row of a run whose readings are those of others, rounded, that row; but for times.

    Repeats that are honest and scatter by half a step or more agree so in every second reading at
    most. Single readings end in zeros by chance.
    """
    rows, readings = np.arange(len(data)), data.readings
    if not readings or ("time_s" in data.columns and data.kinds["time_s"].required):
        return rows
    digits = np.max([_digits(v) for v in readings.values()], axis=0)
    for count in np.unique(digits)[:-1].tolist():
        coarse = _in_runs(digits <= count)
        if not coarse.any() or np.median(digits[~coarse]) < count + FEWER_DIGITS:
            continue
        # Rows that are alike have readings of the same sum: nearly always too few of them have.
        total = _total([np.round(v, count) for v in readings.values()])
        if np.count_nonzero(np.isin(total[coarse], total[~coarse])) < MIN_COPIED:
            continue
        rounded = {
            name: np.round(v, count) + 0.0 if v.dtype.kind == "f" else v
            for name, v in data.columns.items()
            if name != "time_s"
        }
        of = _among(coarse, list(rounded.values()))
        copied = int(np.sum(of[coarse] >= 0))
        if copied < MIN_COPIED:
            continue
        given = [v for name, v in rounded.items() if name not in readings]
        again = _among(coarse, given)[coarse] >= 0
        chance = OFTEN ** len(readings)
        if bdtrc(copied - 1, again.sum(), chance) <= MAX_CHANCE:
            return np.where(of >= 0, of, rows)
    return rows


def _in_runs(some: Flags) -> Flags:
    """Those of some rows that are in runs as long as a block."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], some, [False]]).astype(int)))
    out = np.zeros(len(some), dtype=bool)
    for first, last in zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True):
        out[first:last] = last - first >= MIN_COPIED
    return out


def _digits(values: Floats) -> Integers:
    """Digits after the decimal point of each value, `MAX_DIGITS` + 1 of one that has more."""
    scaled = np.multiply.outer([10.0**count for count in range(MAX_DIGITS + 1)], values)
    whole = np.abs(scaled - np.round(scaled)) < WHOLE
    return np.where(whole.any(axis=0), np.argmax(whole, axis=0), MAX_DIGITS + 1)


def _among(some: Flags, columns: Sequence[NDArray[Any]]) -> Integers:
    """Of each row of ``some`` the first of the others that is as it is in every column, else -1."""
    label = equal_rows(_numbers(columns))[0] if columns else np.zeros(len(some), dtype=np.intp)
    first = np.full(len(label), -1)
    others = np.flatnonzero(~some)[::-1]
    first[label[others]] = others
    return np.where(some, first[label], -1)


def _numbers(columns: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """Columns as numbers that are the same where they are: text as codes."""
    return [
        v if v.dtype.kind in "fi" else np.unique(v, return_inverse=True)[1].reshape(-1)
        for v in columns
    ]


def _first_equal(columns: Sequence[NDArray[Any]]) -> Integers:
    """Of each row the first that is as it is in every column."""
    # Equal rows have equal sums, so distinct sums are those of distinct rows: one column to sort.
    total = _total([v for v in columns if v.dtype.kind in "fi"])
    if len(np.unique(total)) == len(columns[0]):
        return np.arange(len(columns[0]))
    codes = [np.unique(v, return_inverse=True)[1].reshape(-1) for v in columns]
    table = np.column_stack(codes)
    _, first, same = np.unique(table, axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[same.reshape(-1)], dtype=np.intp)


def _total(columns: Sequence[NDArray[Any]]) -> Floats:
    """Sum of each row, that of equal rows equal and of others hardly ever."""
    return np.asarray(sum(np.sqrt(2.0 + i) * v for i, v in enumerate(columns)))


def _by_chance(data: Table, original: Integers, but: str = "") -> bool:
    """Whether honest repeats of readings in steps would agree as often as these rows do.

    original: Of each row the first that is as it is in every column, ``but`` this one.
    """
    rows, readings = np.arange(len(data)), data.readings
    if np.array_equal(original, rows):
        return False  # none repeats another
    known = [name for name in data.columns if name in data.kinds and name != but]
    given = [data.columns[name] for name in known if name not in readings]
    if not readings or not given:
        return False
    command, first = equal_rows(_numbers(given))
    again = rows != first[command]
    alike = again & (original != rows)
    if np.array_equal(again, alike):
        return False  # all agree
    other, one = rows[again & ~alike], first[command][again & ~alike]
    chance = np.prod([_agreeing(v[other] - v[one], v) for v in readings.values()])
    return bool(bdtrc(alike.sum() - 1, again.sum(), chance) > MAX_CHANCE)


def _agreeing(off: Floats, values: Floats) -> float:
    """Share of honest repeats that agree, at most, by the differences ``off`` of some.

    values: All readings of the column, which may lie on a grid.
    """
    step, off = recognised(values), off[off != 0]
    if not len(off):
        return 1.0
    if not step > 0:
        return 0.0
    size = float(np.sqrt(np.mean(off**2))) / step
    return 1.0 if size < NEXT_STEP else min(1.0, OFTEN / size)


def _label(data: Table) -> str:
    """Name of the column that numbers repetitions; empty: none."""
    return next((name for name in LABELS if name in data.columns), "")


def _without_copies(data: Table) -> Integers:
    """Of each row that of the first block of one label that is its block but for label and time."""
    rows = np.arange(len(data))
    for same in _of_same_commands(data):
        if len(same) < 2 or _alike_in_steps(data, same):
            continue
        own = [np.stack([v[b] for v in data.readings.values()] or [0 * b]) for b in same]
        for block, first in zip(same, _first_alike(own), strict=True):
            rows[block] = same[first]
    return rows


def _of_same_commands(data: Table) -> list[list[Integers]]:
    """Blocks of rows of one label, in lists of those that have the same commands."""
    rows = np.arange(len(data))
    if not (name := _label(data)):
        return []
    number = np.unique(data.columns[name], return_inverse=True)[1].reshape(-1)
    blocks = [rows[number == i] for i in range(number.max() + 1)]
    if len(blocks) < 2:
        return []
    known = {name, "time_s", *data.readings}
    given = [v for k, v in data.columns.items() if k not in known]
    groups: dict[bytes, list[Integers]] = {}
    for block in blocks:
        alike = b"".join(_bytes(v[block]) for v in given) + bytes(str(len(block)), "ascii")
        if len(block) < MIN_COPIED:
            alike += bytes(f"|{block[0]}", "ascii")
        groups.setdefault(alike, []).append(block)
    return list(groups.values())


def _alike_in_steps(data: Table, blocks: Sequence[Integers]) -> bool:
    """Whether some blocks of the same commands are all alike, as honest repeats in steps may be."""
    if not _agree(data, blocks):
        return False
    one, chance = blocks[0], 1.0
    for name, values in data.readings.items():
        off = values[one]
        if (commanded := name.replace("measured", "target")) != name:
            off = off - data.columns[commanded][one]
        step = recognised(off)
        if np.ptp(off) > MAX_STEPS * step + MIN_STEP:
            return False
        to_next = np.round(np.diff(off) / step) if step > 0 else np.zeros(len(one) - 1)
        chance *= 1.0 - float(np.mean(to_next[1:] * to_next[:-1] < 0)) if len(one) > 2 else 0.0
    return chance ** (len(one) * (len(blocks) - 1)) > ALIKE_LEVEL


def _agree(data: Table, blocks: Sequence[Integers]) -> bool:
    """Whether all readings of some blocks of the same commands are the same."""
    one, readings = blocks[0], data.readings.values()
    same = (np.array_equal(v[one], v[b]) for v in readings for b in blocks[1:])
    return bool(readings) and all(same)


def _first_alike(blocks: Sequence[NDArray[Any]]) -> list[int]:
    """Of each of some blocks (r, n) of the same commands the first that it is a copy of, or itself.

    Those that are not alike show how often rows of honest repeats agree: a machine that changes
    moves them all one way, noise moves as many up as down.
    """
    known: dict[bytes, int] = {}
    first = [known.setdefault(b.tobytes(), i) for i, b in enumerate(blocks)]
    apart = [blocks[i] for i in known.values()]
    agree = [_beside_a_change(a, b) for a, b in pairwise(apart)]
    count = len(blocks)
    honest = float(np.mean(agree)) ** blocks[0].shape[1] * count * count / 2 if agree else 0.0
    return list(range(count)) if honest > MAX_CHANCE else first


def _beside_a_change(one: Floats, other: Floats) -> float:
    """Share of readings (r, n) that agree, but for a change that moves them all one way."""
    off = other - one
    beside = off - np.median(off, axis=1, keepdims=True)
    least = SAME * np.max(np.abs(one), axis=1, keepdims=True)
    both = np.minimum(np.sum(beside > least, axis=1), np.sum(beside < -least, axis=1))
    return float(np.prod(1.0 - 2.0 * both / off.shape[1]))


def _bytes(values: NDArray[Any]) -> bytes:
    """What tells two columns apart: objects (text) by their text."""
    return (values.astype(str) if values.dtype == object else values).tobytes() + b"|"
