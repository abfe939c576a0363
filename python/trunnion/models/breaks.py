"""A measurement in two parts: what may be another after the break between them.

A run that was aborted and begun again has other zeros of its axes: all that comes later is off by a
constant. A drift over a break of hours does the same to readings that take minutes, so that both
are candidates of one parameter each. Readings that come in cycles show a break without times, too:
a cycle that was left before its end begins again. So do places that are read in passes: an
instrument may be set to zero before each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.errors import InputError
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.effect import Effect, Parameter, gridded, linear
from trunnion.machine.effects import Owner
from trunnion.models.slips import FromThenOn

ZERO = "d_um"
"""Parameter of a shifted zero."""
MIN_BREAK_S = 180.0
"""A tool change, a calibration of the probe or a turn of the table takes less."""
MIN_TIMES_USUAL = 10.0
"""Of the median time between readings."""
MIN_READINGS = 5
"""Before and after: fewer of them look like outliers."""
MIN_STOPS_LEFT = 3
"""Of a cycle that was left before its end: a stop or two again are readings that were repeated."""


def break_of(time_s: Floats, cycle: Integers | None = None) -> float | None:
    """Return a time in the longest break between readings; None: they were measured in one go.

    cycle: Of each reading. What is usual between cycles is no break.
    """
    moments, longer = _between(time_s, cycle)
    longest = int(np.argmax(longer)) if len(longer) else 0
    return float(moments[longest]) if len(longer) and longer[longest] >= 0 else None


def breaks_of(time_s: Floats) -> tuple[float, ...]:
    """Return a time in each break between readings, in order."""
    moments, longer = _between(time_s)
    return tuple(moments[longer >= 0].tolist())


def _between(time_s: Floats, cycle: Integers | None = None) -> tuple[Floats, Floats]:
    """Return a time between readings, but for the first and last, and by how much it is a break."""
    order = np.argsort(time_s, kind="stable")
    times = np.asarray(time_s, dtype=np.float64)[order]
    if len(times) < 2 * MIN_READINGS:
        return np.zeros(0), np.zeros(0)
    apart = np.diff(times)
    usual = np.full(len(apart), np.median(apart))
    between = np.zeros(len(apart), dtype=bool) if cycle is None else np.diff(cycle[order]) != 0
    if between.sum() > 1:
        usual[between] = np.percentile(apart[between], 50, method="lower")
    longer = apart - np.maximum(MIN_BREAK_S, MIN_TIMES_USUAL * usual)
    inner = slice(MIN_READINGS - 1, len(apart) - MIN_READINGS + 1)
    return ((times[1:] + times[:-1]) / 2)[inner], longer[inner]


def restart_of(cycle: Integers, stop: Integers) -> int | None:
    """Return the reading at which a run begins again, the last such; None: it never does.

    Its number of the cycle is not a higher one, the cycle before it was left before its end, and it
    goes to the same stops as at first.

    cycle, stop: Of each reading, in the order of time.
    """
    whole = max(len(np.unique(stop[cycle == each])) for each in np.unique(cycle))
    found, start = None, 0
    for row in range(1, len(cycle)):
        if cycle[row] > cycle[row - 1]:
            start = row
            continue
        first = start if cycle[row] == cycle[row - 1] else int(np.argmax(cycle == cycle[row]))
        same = stop[row : row + MIN_STOPS_LEFT], stop[first : first + MIN_STOPS_LEFT]
        if not np.array_equal(*same):
            continue
        if MIN_STOPS_LEFT <= len(np.unique(stop[start:row])) < whole:
            found = row if MIN_READINGS <= row <= len(cycle) - MIN_READINGS else found
            start = row
    return found


def passes_of(place: Integers) -> Integers:
    """Return the readings with which a further pass begins: it goes to a place that was left.

    Of the readings of a place at which it turns half belong to each pass. What has fewer than
    `MIN_READINGS` is no pass, but readings that were repeated.

    place: Of each reading, in the order of time.
    """
    starts, left, stays = [0], set[int](), 0
    for row, at in enumerate(map(int, place)):
        if row and at == place[row - 1]:
            stays += 1
            continue
        if at in left:
            starts.append(row - (stays + 1) // 2)
            left.clear()
        left.add(at)
        stays = 0
    long = np.diff([*starts, len(place)]) >= MIN_READINGS
    return np.asarray(starts[1:], dtype=np.intp)[long[:-1] & long[1:]]


def zero_shift(letter: str, columns: Floats, size: str = ZERO) -> Effect:
    """Make the shifted zero of an axis, of columns (n, 1), as an effect.

    letter: Small; empty: there is one axis. size: Name of its parameter.
    """
    axis, end = (f"{letter.upper()} axis", f"_{letter}") if letter else ("axis", "")
    label = f"zero of the {axis}, shifted in a break of the measurement"
    return linear(f"zero_shift{end}", [size], columns, label, owner=Owner.PLACEMENT)


def moment_between(when: Floats, order: Integers, first: ArrayLike) -> Floats:
    """Moments before readings, by their numbers in the order of time."""
    at = np.asarray(first, dtype=np.intp)
    return np.asarray((when[order[at - 1]] + when[order[at]]) / 2)


def shift_from(
    id_: str,
    names: Sequence[str],
    enters: Floats,
    when: Floats,
    moments: Sequence[float],
    time: str,
    label: str,
) -> Effect:
    """Make a shift from a moment on, one of some, as an effect of the placement.

    names: Of its sizes. enters: What a unit of each changes, (n, k). when: Of each reading. time:
    Name of the moment, a parameter where there are several.
    """
    shape = _ShiftFrom(time, when, enters)
    if len(moments) == 1:
        columns = shape.columns({time: moments[0]})
        return linear(id_, names, columns, label, owner=Owner.PLACEMENT)
    grid = tuple(map(float, moments))
    at = Parameter(time, grid=grid, bounds=(float(np.min(when)), float(np.max(when))))
    sizes: list[str | Parameter] = [*names, at]
    return gridded(id_, sizes, shape.columns, label, slopes=shape.slopes, owner=Owner.PLACEMENT)


@dataclass(frozen=True, eq=False)
class _ShiftFrom:
    """Columns ``enters`` from a moment on; ``when``: of each reading, called ``name``."""

    name: str
    when: Floats
    enters: Floats

    def columns(self, values: Mapping[str, float]) -> Floats:
        """Columns of the shift, (N, k)."""
        return np.asarray((self.when > values[self.name])[:, None] * self.enters)

    def slopes(self, _: Mapping[str, float]) -> Floats:
        """No derivative by the moment, (N, 1)."""
        return np.zeros((len(self.when), 1))


@dataclass(frozen=True)
class ZeroShift:
    """The zero of a linear axis shifts at a moment, as an effect of touches.

    letter: Of the axis, small. t0_s: The moment.
    """

    letter: str
    t0_s: float
    parameters: tuple[str, ...] = (ZERO,)
    owner: Owner = Owner.PLACEMENT

    @property
    def id(self) -> str:
        """Its name."""
        return f"zero_shift_{self.letter}"

    def bound(self, data: Any, machine: Any) -> Effect:
        """Return it as a candidate for touches on a machine."""
        columns = self.on_machine(machine).jacobian(data, {})
        return zero_shift(self.letter, columns)

    def change(self, data: Any, values: Mapping[str, float]) -> NoReturn:  # noqa: ARG002
        """Refuse touches without a machine."""
        raise InputError(f"effect {self.id!r}: got touches only, expected a set-up beside them")

    def on_machine(self, machine: Any) -> FromThenOn:
        """Return what changes the readings on a machine."""
        return FromThenOn(self.t0_s, ZERO, machine.moved(self.letter))


def zero_shifts(data: Any) -> dict[str, ZeroShift]:
    """Shifted zeros of the axes of touches, by id; none of touches without a break."""
    t0_s = break_of(data.time_s)
    shifts = [] if t0_s is None else [ZeroShift(letter, t0_s) for letter in "xyz"]
    return {shift.id: shift for shift in shifts}
