"""What changed between measurements of one machine: the records."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from trunnion.base.report import (
    Cell,
    Result,
    Shown,
    Table,
    cell_text,
    measured,
    plus_minus,
    significant,
)
from trunnion.base.units import without_unit
from trunnion.diagnosis.records import chance, with_unit

MAX_NAMED = 8  # in a sentence
_SHAPES = {"a2": "bow", "a3": "S-shape"}
_HARMONIC = re.compile(r"([ab])\d*")
FEW = 8  # measurements, below which control limits say little


@dataclass(frozen=True)
class Change:
    """One quantity before and after.

    Attributes
    ----------
    name, unit, owner
        As results and diagnoses call it ("EX0C", "twist_um_m_m", "scale.ppm"); whose it is. Of an
        effect of many parameters ("field (rms)") before, after and change are rms of what it does
        to the readings, and the change is never negative.
    before, after, change, std_error
        Values, and the standard uncertainty of the change.
    low, high
        95 % interval of the change, of this quantity by itself.
    p_value
        That it did not change, corrected for the number of quantities (Holm).
    changed
        Whether that is below the level of the comparison.
    label
        What people call it.
    rms
        Whether the change is the rms of a difference.
    """

    name: str
    unit: str
    owner: str
    before: float
    after: float
    change: float
    std_error: float
    low: float
    high: float
    p_value: float
    changed: bool
    label: str = ""
    rms: bool = False

    @property
    def called(self) -> str:
        """What people call it, or its name."""
        return self.label or self.name

    @property
    def within(self) -> float:
        """Largest size that the change may have, 95 %."""
        return max(abs(self.low), abs(self.high))

    @property
    def ends(self) -> tuple[Cell, Cell]:
        """Both values, shown to the digits that their change is known to."""
        before, after = (measured(v, self.std_error)[0] for v in (self.before, self.after))
        return before, after

    def sentence(self) -> str:
        """Say both values and the change."""
        by = plus_minus(self.change, self.std_error)
        ends = " → ".join(map(cell_text, self.ends))
        change = "rms of the difference" if self.rms else "change"
        return with_unit(f"{self.called} {ends} ({change} {by})", self.unit)


@dataclass(frozen=True)
class Trend:
    """One quantity over time.

    Attributes
    ----------
    name, unit
        Of the quantity.
    rate, std_error
        By weighted regression, a day (or a measurement, where there are no dates).
    p_value, changing
        That there is no trend, corrected for the number of quantities (Holm).
    centre, lower, upper
        Control limits of an individuals chart: mean ± 2.66 mean moving ranges (ISO 7870-2).
    outside
        Measurements (from 0) outside the limits.
    label
        What people call it.
    """

    name: str
    unit: str
    rate: float
    std_error: float
    p_value: float
    changing: bool
    centre: float
    lower: float
    upper: float
    outside: tuple[int, ...]
    label: str = ""

    @property
    def called(self) -> str:
        """What people call it, or its name."""
        return self.label or self.name


@dataclass(frozen=True, eq=False, repr=False)
class MachineComparison(Result):
    """What changed between measurements of one machine, and what did not. See :func:`compare`.

    Attributes
    ----------
    names
        Of the measurements, in order.
    quantities
        From the first measurement to the last: those that changed first, strongest first.
    trends
        Of three or more measurements.
    values, std_errors
        Name → value of each measurement and its standard uncertainty.
    days
        When the measurements were made, from the first; without dates their numbers.
    dated
        Whether there were dates.
    level
        Chance that anything is said to have changed where nothing did.
    mistakes
        What is likely wrong with the data of a measurement, as its diagnosis names it.
    notes
        What else a reader should know.

    Examples
    --------
    >>> import trunnion as tn
    >>> axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    >>> worn = axis.with_columns(measured_mm=axis.measured + 2e-3 * axis.direction)
    >>> sorted(tn.compare(axis, worn).changed)[:2]
    ['mean_reversal_um', 'reversal.b_um']
    """

    names: tuple[str, ...]
    quantities: tuple[Change, ...]
    trends: tuple[Trend, ...]
    values: Mapping[str, tuple[float, ...]]
    std_errors: Mapping[str, tuple[float, ...]]
    days: tuple[float, ...]
    dated: bool
    level: float
    mistakes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def title(self) -> str:
        """Name the result."""
        return f"Comparison of {len(self.names)} measurements"

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        """Name → change from the first measurement to the last, and its standard error."""
        return {q.name: (q.change, q.std_error) for q in self.quantities}

    @property
    def changed(self) -> frozenset[str]:
        """Names of what changed."""
        return frozenset(q.name for q in self.quantities if q.changed)

    def derived(self) -> Mapping[str, Any]:
        """Changes by name."""
        return {"changes": self.changes}

    def headline(self) -> str:
        """How much changed."""
        return f"{len(self.changed)} of {len(self.quantities)} quantities changed"

    def sentences(self) -> tuple[str, ...]:
        """Say what changed, then what did not and how well that is known."""
        moved = [q for q in self.quantities if q.changed]
        still = [q for q in self.quantities if not q.changed]
        level = f"{100 * self.level:.3g} %"
        ends = f"from {self.names[0]} to {self.names[-1]}"
        if not self.quantities:
            none = f"Nothing to compare {ends}: no quantity is known of both."
            return (*self.mistakes, none, *self.notes)
        lines = [*self.mistakes]
        if moved:
            lines.append(f"Changed {ends}: {_listed([q.sentence() for q in moved])}.")
        else:
            lines.append(f"Nothing changed {ends}, as far as the measurements show.")
        if still:
            parts = [with_unit(f"{q.called} within ±{q.within:.2g}", q.unit) for q in still]
            lines.append(f"Not changed, 95 % each: {_listed(parts)}.")
        lines.append(
            f"Level {level} over all {len(self.quantities)} quantities together (Holm); errors "
            "that all measurements share cancel."
        )
        going = [t for t in self.trends if t.changing]
        if going:
            each = "day" if self.dated else "measurement"
            rates = [with_unit(plus_minus(t.rate, t.std_error), t.unit) for t in going]
            parts = [f"{t.called} {rate} a {each}" for t, rate in zip(going, rates, strict=True)]
            lines.append(f"Trend: {_listed(parts)}.")
        out = [
            f"{t.called} at {', '.join(self.names[i] for i in t.outside)}"
            for t in self.trends
            if t.outside
        ]
        if out:
            lines.append(f"Outside its control limits: {_listed(out)}.")
        return (*lines, *self.notes)

    def tables(self) -> tuple[Table, ...]:
        """Return changes and trends."""
        rows = [_row(q) for q in self.quantities]
        columns = ("", self.names[0], self.names[-1], "change", "standard error", "unit", "p")
        tables = [Table.of("Changes", (*columns, "changed"), rows)]
        if self.trends:
            each = "day" if self.dated else "measurement"
            heads = ("", f"trend a {each}", "standard error", "p", "lower limit", "upper limit")
            lines = [
                (
                    t.called,
                    *measured(t.rate, t.std_error),
                    _chance(t.p_value),
                    significant(t.lower, 4),
                    significant(t.upper, 4),
                )
                for t in self.trends
            ]
            title = "Trends"
            if len(self.names) < FEW:
                title += f" (limits of {len(self.names)} measurements say little)"
            tables.append(Table.of(title, heads, lines))
        return tuple(tables)


def meaning(effect: str, parameter: str, named: Sequence[str]) -> str:
    """Say what a parameter of several is: a2 of a straightness → "bow (a2)"."""
    short = without_unit(parameter)
    said = _SHAPES.get(short, "") if effect.startswith("straightness") else ""
    match = _HARMONIC.fullmatch(short)
    if not said and match:
        other = {"a": "b", "b": "a"}[match[1]] + parameter[1:]
        said = {"a": "cosine part", "b": "sine part"}[match[1]] if other in named else ""
    return f"{said} ({short})" if said else short


def _row(q: Change) -> tuple[Cell, ...]:
    changed = "yes" if q.changed else "no"
    return (
        q.called,
        *q.ends,
        *measured(q.change, q.std_error),
        q.unit,
        _chance(q.p_value),
        changed,
    )


def _chance(p: float) -> Shown:
    return Shown(p, chance(p).removeprefix("p ").removeprefix("= "))


def _listed(parts: Sequence[str], mark: str = "; ") -> str:
    more = len(parts) - MAX_NAMED
    return mark.join(parts[:MAX_NAMED]) + (f"; and {more} more" if more > 0 else "")


def done_otherwise(names: Sequence[str], data: Sequence[Any]) -> list[str]:
    """Say what was done otherwise than in the first measurement, and looks like a change.

    names: Of the measurements.
    """
    said = getattr(data[0], "done_otherwise", None)
    if said is None:
        return []
    others = zip(names[1:], data[1:], strict=True)
    return [text for name, other in others if (text := said(other, (names[0], name)))]


def not_compared(
    names: Sequence[str],
    std: Sequence[Mapping[str, float]],
    stated: Sequence[Mapping[str, float] | None],
) -> tuple[str, ...]:
    """Say which quantities of several measurements are not compared, and what is missing of them.

    names: Of the measurements. std: Of each, standard errors of its quantities, inf: unknown.
    stated: Of each, those that it states, inf: not identifiable; None: all.
    """
    common = [name for name in std[0] if all(name in one for one in std)]
    if not common:
        each = "; ".join(
            f"{name}: {_listed([*one], ', ') or 'nothing'}"
            for name, one in zip(names, std, strict=True)
        )
        return (f"No quantity is in all of them ({each}).",)
    said = []
    for called, mine, known in zip(names, std, stated, strict=True):
        unknown = [name for name in common if not isfinite(mine[name])]
        bare = [name for name in unknown if known is not None and name not in known]
        if bare:
            said.append(
                f"Not compared, as {called} has no standard error of it: {_listed(bare, ', ')}. "
                "Nothing says what of a change is noise; expected estimates as trunnion estimate "
                "TOUCHES SETUP -o estimate.json writes them, not names and values alone."
            )
        if open_ := [name for name in unknown if name not in bare]:
            said.append(f"Not compared, as {called} does not identify it: {_listed(open_, ', ')}.")
    return tuple(said)
