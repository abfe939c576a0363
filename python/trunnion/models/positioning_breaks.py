"""What is another after a break of a positioning run, or in each cycle of one that has none.

A run that was begun again, or goes on after a break, may have another zero. Between two cycles an
axis may be homed, the instrument set to zero, or the compensation of the control switched; a nut
that gets warm has another backlash. So zero, scale and reversal may be others in each cycle. A
drift to and fro is so, too: it competes as noise (:mod:`trunnion.diagnosis.in_turn`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trunnion.base.units import Flags, Floats
from trunnion.data.positioning import Positioning
from trunnion.diagnosis.effect import Effect, Parameter, gridded, linear
from trunnion.machine.effects import Owner
from trunnion.models.breaks import break_of, restart_of

OF_CYCLES = ("zero_of_cycle", "scale_of_cycle", "reversal_of_cycle")
MIN_CYCLES = 3
"""Of two cycles one is another: that is what a drift makes, too."""
REFERENCES = 37
"""Places tried that no scale moves, from a travel before the targets to one behind them."""
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


def of_cycles(
    data: Positioning, unit: str, place: Floats | None, reversal: Floats | None
) -> Iterator[Effect]:
    """Yield zero, scale and reversal of each cycle, less those of the first.

    unit: Of deviations, as names have it. place: Target in mm, of a scale. reversal: Change of each
    reading by a unit of it. None: no candidate.
    """
    cycles, number = np.unique(data.cycle, return_inverse=True)
    if len(cycles) < MIN_CYCLES:
        return
    each = (number[:, None] == np.arange(1, len(cycles))).astype(float)
    sizes = [f"cycle_{k}_{unit}" for k in range(2, len(cycles) + 1)]
    owner = Owner.PLACEMENT
    yield linear("zero_of_cycle", sizes, each, _another("zero"), owner=owner)
    if place is not None:
        low, high = float(place.min()), float(place.max())
        over = high - low
        grid = tuple(np.linspace(low - over, high + over, REFERENCES))
        about = Parameter("about_mm", "mm", grid, (grid[0], grid[-1]), affine=True)
        ppm = [name.replace(unit, "ppm") for name in sizes]
        shape = _Scales(each, place)
        yield gridded("scale_of_cycle", [*ppm, about], shape, _another("scale"), owner=owner)
    if reversal is not None:
        columns = each * reversal[:, None]
        yield linear("reversal_of_cycle", sizes, columns, _another("reversal"), owner=owner)


def _another(what: str) -> str:
    return f"{what} of the axis, another in each cycle"


@dataclass(frozen=True, eq=False)
class _Scales:
    """Columns of a scale of each cycle but the first (n, k), about a place (mm) of the axis."""

    each: Floats
    place: Floats

    def __call__(self, values: Mapping[str, float]) -> Floats:
        return 1e-3 * self.each * (self.place - values["about_mm"])[:, None]


def apart(effects: Sequence[Effect]) -> list[Effect]:
    """Return candidates, of which some are not supposed together with others."""
    known = {e.id for e in effects}
    others = {id_: tuple(i for i in ids if i in known) for id_, ids in INSTEAD_OF.items()}
    return [replace(e, instead_of=others.get(e.id, ())) for e in effects]
