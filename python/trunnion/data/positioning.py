"""Positioning of an axis by ISO 230-2: ``positioning.csv``, one row a stop."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.checks import choose, nearest
from trunnion.base.errors import DataError
from trunnion.base.recognition import all_displayed
from trunnion.base.record import files_of, hold_files
from trunnion.base.report import rough
from trunnion.base.units import Flags, Floats, Integers, conversion, unit_of
from trunnion.data.apart import MAX_SHOWN, far_repeats
from trunnion.data.approach import refuse_other_approach
from trunnion.data.distinct import own_cycles
from trunnion.data.iso230_2 import Iso2302, Iso2302Rotary
from trunnion.data.places import MIN_DISTANCE, Places
from trunnion.data.shifted import displaced
from trunnion.files.columns import ColumnError, Integer, OptionalLabel, OptionalNumber, OptionalTime
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table

OWN = ("target", "measured")
MAX_STEP = 2.0  # of the range of deviations, in which positions may be recorded
MAX_EXCHANGED = 0.5  # different measured positions a target: repeats of a stop differ
DEVIATIONS = 5e-4  # of the travel of the targets: less than of another unit
OFF_LINE = 0.01  # of the measured travel: half of the positions of an axis are nearer to a line
MAX_OFF_LINE = 1.0  # mm or degrees: the same, of an axis that hardly moves
TURN_DEG, NEAR_A_TURN_DEG = 360.0, 10.0
OF_LONG_TRAVEL = 1e-5  # of the measured travel: the same, of positions in a smaller unit
MIN_COMMON = 2  # targets of runs whose results are compared: of one no mean deviates
FAR_OFF = 10.0  # of the median distance from the line: stops that are no part of it
LARGE_DEVIATION = 1.0  # mm or degrees: what no axis deviates by
SIDES = {frozenset((1,)): "forward", frozenset((-1,)): "backward"}
UNITS: Mapping[str, Mapping[float, str]] = {
    "mm": {
        **{1e3: "are these µm, or the targets m?", 1e-3: "are these m, or the targets µm?"},
        0.1: "are these cm?",
        **{25.4: "are the targets inches?", 1 / 25.4: "are these inches?"},
        10.0: "are the targets cm?",
    },
    "deg": {
        float(np.radians(1.0)): "are these radians?",
        float(np.degrees(1.0)): "are the targets radians?",
    },
}
"""Measured travel over that of the targets, and what makes it so, by the columns' unit."""
OTHER_WAY = "does the instrument count the other way?"


class Positioning(Table):
    """Measured positions of one axis at its targets, from both directions, in cycles.

    Of a linear axis in mm, of a rotary one in degrees. Further columns ``NAME_mm`` (``NAME_deg``)
    are other instruments on the same stop (`instrument`).

    Examples
    --------
    >>> import trunnion as tn
    >>> axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    >>> round(axis.iso230_2().accuracy_um, 1)
    24.2
    """

    choice = "target_mm, measured_mm, or target_deg, measured_deg"

    target_mm = OptionalNumber("target position of a linear axis", commanded=True)
    measured_mm = OptionalNumber("measured position of a linear axis", observed=True)
    target_deg = OptionalNumber("target position of a rotary axis", commanded=True)
    measured_deg = OptionalNumber("measured position of a rotary axis", observed=True)
    direction = Integer("sense of approach", among=(-1, 1))
    cycle = Integer("number of the cycle, from 1", minimum=1)
    axis = OptionalLabel("letter of the axis; one axis a table")
    time_s = OptionalTime("time since the start")
    temperature_c = OptionalNumber("temperature of the axis or its scale")

    @property
    def rotary(self) -> bool:
        """Whether the axis turns."""
        return self.target_deg is not None

    @property
    def unit(self) -> str:
        """Unit of deviations: µm or arcsec."""
        return "arcsec" if self.rotary else "µm"

    @property
    def target(self) -> Floats:
        """Target positions, mm or degrees, (n,)."""
        return np.asarray(self.columns[f"target_{self._suffix}"], dtype=np.float64)

    @property
    def measured(self) -> Floats:
        """Measured positions, mm or degrees, (n,)."""
        return np.asarray(self.columns[f"measured_{self._suffix}"], dtype=np.float64)

    @property
    def deviation(self) -> Floats:
        """Measured less target position, µm or arcsec, (n,)."""
        return (self.measured - self.target) * (3600.0 if self.rotary else 1e3)

    @property
    def instruments(self) -> tuple[str, ...]:
        """Names of further instruments on the same stops."""
        end = f"_{self._suffix}"
        names = (name.removesuffix(end) for name in self.columns if name.endswith(end))
        return tuple(
            name
            for name in names
            if name not in OWN and self.columns[name + end].dtype.kind in "fiu"
        )

    @property
    def in_time(self) -> Integers:
        """Rows in the order of their times, (n,); without times in that of the rows."""
        rows = np.arange(len(self))
        return rows if self.time_s is None else np.argsort(self.time_s, kind="stable")

    @property
    def stops(self) -> tuple[Floats, Integers]:
        """Distinct targets in ascending order, (m,), and the number of each row's, (n,).

        Targets that scatter about one place, as a control reads them back, are one target.
        """
        found = self.places
        return found.nominal, found.number

    @property
    def places(self) -> Places:
        """Places that the targets mean."""
        return Places.of(self.target, self.direction, self.cycle)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is taken otherwise than it is written, one sentence each."""
        found, factor = self.places, 3600.0 if self.rotary else 1e3
        if found.scatter < MIN_DISTANCE:
            return ()
        return (
            f"The targets scatter by up to {found.scatter * factor:.2g} {self.unit} about "
            f"{len(found.nominal)} places, as a control reads positions back: each place counts as "
            "one target. Deviations are from the targets as written.",
        )

    @property
    def readings(self) -> Mapping[str, NDArray[Any]]:
        """Measured positions, those of further instruments too, by column name."""
        others = (f"{name}_{self._suffix}" for name in self.instruments)
        more = {name: self.columns[name] for name in others}
        return MappingProxyType({**super().readings, **more})

    def instrument(self, name: str) -> "Positioning":
        """Return the same stops as another instrument measured them."""
        choose("instrument", name, self.instruments)
        values = self.columns[f"{name}_{self._suffix}"]
        return self.with_columns(**{f"measured_{self._suffix}": values})

    def iso230_2(self) -> Any:
        """Return the results of ISO 230-2:2014: `Iso2302`, of a rotary axis `Iso2302Rotary`.

        Raises
        ------
        DataError
            One direction only, fewer than two stops at a target from one direction, or passes
            whose targets fall with a direction with which those of most others rise.
        """
        self.check_units()
        refuse_other_approach(self)
        own = own_cycles(self)
        result = own.data._results()
        other = self.displaced
        doubts = (f"Measured positions belong to other rows: {other}",) if other else ()
        notes = (*doubts, *self._far_stops(result), *own.notes, *result.notes)
        result = replace(result, notes=notes)
        hold_files(result, files_of(self))
        return result

    def _far_stops(self, result: Any) -> tuple[str, ...]:
        """Say which stops are far from all others of their target, and what the results hold."""
        _, index = self.stops
        repeats = 2 * index + (self.direction > 0)
        far = far_repeats(self.deviation, repeats, self._step)
        if not far.any():
            return ()
        rows = np.flatnonzero(far)
        said = [
            f"{self.place(int(row))} ({rough(self.deviation[row])} {self.unit})"
            for row in rows[:MAX_SHOWN]
        ]
        more = f" and {len(rows) - MAX_SHOWN} more" if len(rows) > MAX_SHOWN else ""
        name = f"accuracy_{result.unit_name()}"
        without = ""
        with suppress(DataError):
            left = getattr(own_cycles(self[~far]).data._results(), name)
            without = f": without {'it' if len(rows) == 1 else 'them'} A is {rough(left)}, not "
            without += f"{rough(getattr(result, name))} {self.unit}"
        return (
            f"Far from the other stops at the target, a typing error or a collision? "
            f"{', '.join(said)}{more}. The results hold {'it' if len(rows) == 1 else 'them'}"
            f"{without}.",
        )

    def _results(self) -> Any:
        """Return the results of stops that are all readings of their own."""
        targets, index = self.stops
        senses = np.unique(self.direction).tolist()
        if len(senses) == 1:
            raise DataError(
                f"direction: got {senses[0]:+d} in every row, expected stops with direction "
                f"{-senses[0]:+d}, too: reversal and the figures of both directions need them, and "
                "those of one direction alone are not given"
            )
        found: dict[int, list[Floats]] = {}
        for sense in (1, -1):
            found[sense] = [
                self.deviation[(index == i) & (self.direction == sense)]
                for i in range(len(targets))
            ]
            few = [i for i, stops in enumerate(found[sense]) if len(stops) < 2]
            if few:
                count = len(found[sense][few[0]])
                raise DataError(
                    f"target {targets[few[0]]:g} {self._suffix} from direction {sense:+d}: got "
                    f"{'one stop' if count else 'no stop'}, expected at least 2 (ISO 230-2: 5)"
                )
        kind = Iso2302Rotary if self.rotary else Iso2302
        return kind.of(targets, found[1], found[-1], self._step, self.notes)

    @property
    def _step(self) -> float:
        """Step in which positions are recorded, in the unit of deviations; 0: none is seen.

        Targets lie on a grid, too: a step is no larger than deviations show.
        """
        measured = self.measured * (3600.0 if self.rotary else 1e3)
        found = (all_displayed(values, [self.deviation]) for values in (measured, self.deviation))
        largest = MAX_STEP * float(np.ptp(self.deviation))
        return max((step for steps in found for step in steps if step <= largest), default=0.0)

    def _check_turns(self) -> None:
        """Refuse angles of which some are counted within one turn, where the targets are not."""
        if not self.rotary:
            return
        off = self.measured - self.target
        turns = np.round(off / TURN_DEG)
        usual = float(np.median(turns))
        wrapped = np.flatnonzero((turns != usual) & (abs(off - TURN_DEG * turns) < NEAR_A_TURN_DEG))
        others = off[turns == usual] - TURN_DEG * usual
        most = len(others) > len(off) / 2 and np.all(abs(others) < NEAR_A_TURN_DEG)
        if len(wrapped) and most:
            first = int(wrapped[0])
            raise DataError(
                f"measured_deg (row {first}): got {self.measured[first]:.9g} at target "
                f"{self.target[first]:.9g}, a whole turn more or less than other rows "
                f"({len(wrapped)} of {len(off)} rows): is it counted within one turn? Expected "
                "angles that are counted on, as the targets are"
            )

    def check_units(self) -> None:
        """Refuse measured positions that do not move as the targets do.

        Raises
        ------
        DataError
            They move by less than half as much, more than twice as much, or the other way; or
            they are the targets, and the columns exchanged; or some are a whole turn off.
        """
        self._check_turns()
        count = len(np.unique(self.target))
        if count < 2:
            return
        suffix, distinct = self._suffix, len(np.unique(self.measured))
        if distinct == 1:
            raise DataError(
                f"measured_{suffix}: got {self.measured[0]:g} in every row, expected measured "
                "positions"
            )
        if distinct <= MAX_EXCHANGED * count and len(self) >= 2 * distinct:
            raise DataError(
                f"target_{suffix}: got {count} different targets, and {distinct} different values "
                f"of measured_{suffix} in {len(self)} rows, expected targets that repeat; are the "
                "two columns exchanged?"
            )
        slope, off = self._line()
        near_line = max(MAX_OFF_LINE, OF_LONG_TRAVEL * float(np.ptp(self.measured)))
        if 0.5 < slope < 2.0 and off <= near_line:
            return
        if other := self.displaced:
            raise DataError(f"measured_{suffix}: got readings that belong to other rows: {other}")
        # Deviations have steps, a reversal and noise as large as what they change over the travel.
        if abs(slope) < DEVIATIONS or off > OFF_LINE * abs(slope) * float(np.ptp(self.target)):
            raise DataError(
                f"measured_{suffix}: got values that do not move with target_{suffix}, expected "
                f"measured positions: {self._as_deviations()}"
            )
        if 0.5 < slope < 2.0:
            raise DataError(
                f"measured_{suffix}: got values {off:.3g} {suffix} off a line (median), expected "
                f"measured positions: {self._as_deviations()}"
            )
        near = [
            text for factor, text in UNITS[suffix].items() if abs(abs(slope) / factor - 1) < 0.05
        ]
        turned = [OTHER_WAY] if slope < 0 else []
        likely = f"; {' '.join([*near, *turned]) or 'another unit, or other columns?'}"
        raise DataError(
            f"measured_{suffix}: got {slope:.3g} {suffix} of travel for each {suffix} of "
            f"target_{suffix}, expected about 1{likely}"
        )

    @property
    def displaced(self) -> str:
        """Which measured positions belong to other rows, in the order of time; empty: none."""
        rows = self.in_time

        def place(row: int) -> str:
            at = int(rows[row])
            return f"{self.place(at)} (cycle {self.cycle[at]}, direction {self.direction[at]:+d})"

        return displaced(self.measured[rows], self.target[rows], place)

    def _line(self) -> tuple[float, float]:
        """Slope of the measured positions, and their median distance from the line."""
        target, measured = self.target, self.measured
        for _ in range(2):  # again without what is far off: one number that was cut
            slope, start = np.polyfit(target, measured, 1).tolist()
            off = np.abs(measured - start - slope * target)
            near = off <= FAR_OFF * np.median(off)
            if len(np.unique(target[near])) < 2:
                break
            target, measured = target[near], measured[near]
        return slope, float(np.median(off))

    def _as_deviations(self) -> str:
        """Ask whether measured positions are deviations; in their small unit, if they are large."""
        if float(np.ptp(self.measured)) < LARGE_DEVIATION:
            return "are these deviations from the target? Then it is the target plus the deviation"
        return (
            f"are these deviations from the target in {self.unit}? Then it is the target plus the "
            f"deviation / {3600 if self.rotary else 1000}"
        )

    @property
    def stations(self) -> tuple[Floats, Integers]:
        """As `stops`."""
        return self.stops

    def results(self, others: Sequence["Positioning"] = ()) -> tuple[Iso2302 | Iso2302Rotary, ...]:
        """Return the results of ISO 230-2, or nothing where stops or targets are too few for it.

        others: Measurements whose targets count: results are of those that all have.
        """
        nominal, index = self.stops
        shared = [np.isin(nominal, one.stops[0])[index] for one in (self, *others)]
        common: Flags = np.all(shared, axis=0)
        if len(np.unique(index[common])) < MIN_COMMON:
            return ()
        try:
            return (self[common].iso230_2(),)
        except DataError:
            return ()

    def done_otherwise(self, other: "Positioning", names: Sequence[str]) -> str:
        """Say that another measurement came to the targets from other sides; empty: it did not.

        names: Of both.
        """
        letters = {str(one.axis[0]).lower() for one in (self, other) if one.axis is not None}
        if len(letters) > 1:  # of two axes nothing has changed
            return ""
        mine, theirs = self._sides(), other._sides()
        common = mine.keys() & theirs.keys()
        others = sum(mine[place] != theirs[place] for place in common)
        sides = [frozenset(one.direction.tolist()) for one in (self, other)]
        if sides[0] == sides[1] and others <= len(common) / 2:
            return ""
        how = [SIDES.get(each, "both") for each in sides]
        where = f" at {others} of {len(common)} targets" if sides[0] == sides[1] else ""
        return (
            f"The targets were reached from different directions ({how[0]} in {names[0]}, {how[1]} "
            f"in {names[1]}){where}: a change may be the reversal of the axis."
        )

    def _sides(self) -> dict[float, frozenset[int]]:
        """Directions in which each place was reached."""
        places, index = self.stops
        found: dict[float, frozenset[int]] = {}
        for i, sense in zip(index.tolist(), self.direction.tolist(), strict=True):
            place = float(places[i])
            found[place] = found.get(place, frozenset()) | {sense}
        return found

    @property
    def _suffix(self) -> str:
        return "deg" if self.rotary else "mm"

    def _check(self) -> None:
        for unit in ("mm", "deg"):
            if f"target_{unit}" in self.columns and f"measured_{unit}" not in self.columns:
                raise self._not_measured(unit)
        self.all_or_none("target_mm", "measured_mm")
        self.all_or_none("target_deg", "measured_deg")
        if (self.target_mm is None) == (self.target_deg is None):
            got = "neither" if self.target_mm is None else "both"
            found = f" in the columns {', '.join(self.columns)}" if got == "neither" else ""
            raise ColumnError(
                "target_mm", None, f"{got} of target_mm and target_deg{found}", "one of them"
            )
        if self.axis is not None and len(np.unique(self.axis)) > 1:
            row = int(np.argmax(self.axis != self.axis[0]))
            text = f"{self.axis[row]!s} after {self.axis[0]!s}"
            raise ColumnError("axis", row, text, "one axis a table")

    def _not_measured(self, unit: str) -> ColumnError:
        """Return the error of targets without a column of measured positions."""
        measured = f"measured_{unit}"
        others = [n for n in self.columns if n.endswith(f"_{unit}") and n != f"target_{unit}"]
        near = nearest(measured, self.columns.keys() - self.kinds.keys(), 0.8)
        other = unit_of(near) if near is not None else ""
        if near is not None and other and conversion(other, unit) is None:
            near = None
        if near is not None and other not in ("", unit):
            got = f"no {measured}, but {near}, by its name in {other}"
            expected = f"{measured} (trunnion read --column {measured}={near} converts it)"
        elif near is not None:
            got, expected = f"no {measured}, but {near}", f"the name {measured}"
        elif others:
            more = f" --column {others[-1]}={others[-1]}" * (len(others) > 1)
            got = f"no {measured} beside {', '.join(others)}"
            expected = (
                f"one of them as {measured} (trunnion read --column {measured}={others[0]}{more}: "
                "further instruments by their own names)"
            )
        else:
            got = f"no {measured} beside it"
            expected = f"{measured}: the target plus the deviation"
        return ColumnError(f"target_{unit}", None, got, expected)


def read_positioning(path: str | PathLike[str]) -> Positioning:
    """Read ``positioning.csv``: columns as in `Positioning`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    Positioning(110 rows: target_mm, measured_mm, direction, cycle, time_s)
    """
    return read_table(path, Positioning)
