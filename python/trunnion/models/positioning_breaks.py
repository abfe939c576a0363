"""What is another after a break of a positioning run, or in each cycle of one that has none.

A run that was begun again, or goes on after a break, may have another zero. Between two cycles an
axis may be homed, the instrument set to zero, or the compensation of the control switched. So zero
and scale may be others in each cycle. A drift to and fro is so, too: it competes as noise
(:mod:`trunnion.diagnosis.in_turn`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trunnion.base.units import Flags, Floats
from trunnion.data.positioning import Positioning
from trunnion.diagnosis.effect import Effect, Parameter, gridded, linear
from trunnion.machine.effects import Owner
from trunnion.models.breaks import break_of, restart_of

OF_CYCLES = ("zero_of_cycle", "scale_of_cycle")
MIN_CYCLES = 3
"""Of two cycles one is another: that is what a drift makes, too."""
SELDOM = 20.0
"""As how many candidates each counts: cycles are repeats, and not alike in one of 20 beforehand."""
REFERENCES, FEW = 7, 5
"""Places tried that no scale moves, from a travel before the targets to one behind them."""
BEGINNINGS = np.linspace(0.1, 0.8, 5)
"""Of a change in the course of a run: tried, over the time that this takes.

What begins with it is a warm-up."""
SPANS = np.geomspace(0.1, 1.6, 4)
"""The same of the time over which it comes. What comes at once is no change by heat, but a step."""
TENTH_TO_NINE = 2 * np.log(9.0)
"""Of the logistic function: from a tenth of its height to nine of them."""
_DISPLACED = ("cycle_drift", "warmup", "scale_change")
INSTEAD_OF = {
    "scale_change": ("screw_warmup",),
    "zero_of_cycle": _DISPLACED,
    "scale_of_cycle": (*_DISPLACED, "screw_warmup", "zero_of_cycle"),
}
"""What is nearly a sum of others: of both together one would take off what the other adds."""


def after_break(data: Positioning) -> Flags:
    """Which stops come after the run was begun again, else after a break; none: in one go."""
    cycle, time_s, order = np.asarray(data.cycle), data.time_s, data.in_time
    stop = 2 * data.stops[1] + (data.direction > 0)
    again = restart_of(cycle[order], stop[order])
    if again is not None:
        return np.asarray(np.isin(np.arange(len(data)), order[again:]))
    t0_s = None if time_s is None else break_of(time_s, cycle)
    return np.zeros(len(data), dtype=bool) if t0_s is None else np.asarray(time_s) > t0_s


def of_cycles(data: Positioning, unit: str, place: Floats | None) -> Iterator[Effect]:
    """Yield zero and scale of each cycle, less those of the first.

    unit: Of deviations, as names have it. place: Target in mm, of a scale; None: no candidate.
    """
    cycles, number = np.unique(data.cycle, return_inverse=True)
    if len(cycles) < MIN_CYCLES:
        return
    each = (number[:, None] == np.arange(1, len(cycles))).astype(float)
    sizes = [f"cycle_{k}_{unit}" for k in range(2, len(cycles) + 1)]
    more: dict[str, Any] = {"owner": Owner.PLACEMENT, "sought": SELDOM}
    yield linear("zero_of_cycle", sizes, each, _another("zero"), **more)
    if place is not None:
        about = _about(place, REFERENCES)
        ppm = [name.replace(unit, "ppm") for name in sizes]
        shape = _Scales(each, place)
        yield gridded("scale_of_cycle", [*ppm, about], shape, _another("scale"), **more)


def scale_change(target: Floats, minutes: Floats) -> Effect:
    """Make a scale that is another one after a while: a logistic function of the time.

    As of heat that comes or goes in between (air conditioning, a door, the sun, a pump). A tenth of
    it is there at a time (`from_min`), and nine tenths a span later (`over_min`). target: In mm.
    """
    length = float(np.max(minutes))
    times = [
        Parameter(name, "min", tuple(shares * length), (shares[0] * length, shares[-1] * length))
        for name, shares in (("from_min", BEGINNINGS), ("over_min", SPANS))
    ]
    about = _about(target, FEW)
    label = "scale of the axis, changing in the course of the run"
    return gridded("scale_change", ["d_ppm", about, *times], _Gradual(target, minutes), label)


def _about(place: Floats, count: int) -> Parameter:
    """Place that a scale does not move, of so many from a travel before to one behind the axis."""
    low, high = float(place.min()), float(place.max())
    over = high - low
    grid = tuple(np.linspace(low - over, high + over, count))
    return Parameter("about_mm", "mm", grid, (grid[0], grid[-1]))


@dataclass(frozen=True, eq=False)
class _Gradual:
    """Column of a scale that comes at times in minutes, (n, 1)."""

    place: Floats
    minutes: Floats

    def __call__(self, values: Mapping[str, float]) -> Floats:
        share = come(self.minutes, values["from_min"], values["over_min"])
        return (1e-3 * share * (self.place - values["about_mm"]))[:, None]


def come(minutes: Floats, from_min: float, over_min: float) -> Floats:
    """Share of a change that is there, less that at the first reading, at 0."""
    steep, middle = TENTH_TO_NINE / 2 / over_min, from_min + over_min / 2
    at_first = math.tanh(-steep * middle)
    return np.asarray((np.tanh(steep * (minutes - middle)) - at_first) / 2)


def _another(what: str) -> str:
    return f"{what} of the axis, another in each cycle, less that of the first"


@dataclass(frozen=True, eq=False)
class _Scales:
    """Columns of a scale of each cycle but the first (n, k), about a place (mm) of the axis."""

    each: Floats
    place: Floats

    def __call__(self, values: Mapping[str, float]) -> Floats:
        return 1e-3 * self.each * (self.place - values["about_mm"])[:, None]


def apart(effects: Sequence[Effect]) -> list[Effect]:
    """Return candidates, of which some make much of any wander and exclude others."""
    ids = {e.id for e in effects}
    others = {id_: tuple(i for i in some if i in ids) for id_, some in INSTEAD_OF.items()}
    return [
        replace(e, instead_of=others[e.id], near_any=True) if e.id in others else e for e in effects
    ]
