"""A measurement in two parts: what may be another after the break between them.

A run that was aborted and begun again has other zeros of its axes: all that comes later is off by a
constant. A drift over a break of hours does the same to readings that take minutes, so that both
are candidates of one parameter each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.diagnosis.effect import Effect, linear
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


def break_of(time_s: Floats) -> float | None:
    """Return a time in the longest break between readings; None: they were measured in one go."""
    times = np.sort(np.asarray(time_s, dtype=np.float64))
    if len(times) < 2 * MIN_READINGS:
        return None
    apart = np.diff(times)
    inner = apart[MIN_READINGS - 1 : len(apart) - MIN_READINGS + 1]
    longest = MIN_READINGS - 1 + int(np.argmax(inner))
    if apart[longest] < max(MIN_BREAK_S, MIN_TIMES_USUAL * float(np.median(apart))):
        return None
    return float(times[longest] + times[longest + 1]) / 2


def zero_shift(letter: str, columns: Floats) -> Effect:
    """Make the shifted zero of a linear axis, of columns (n, 1), as an effect."""
    label = f"zero of the {letter.upper()} axis, shifted in a break of the measurement"
    return linear(f"zero_shift_{letter}", [ZERO], columns, label, owner=Owner.PLACEMENT)


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
