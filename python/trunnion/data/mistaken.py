"""Data in another unit than their columns declare, known by the size of what they hold.

A sentence says what is likely meant, with the factor; no number is changed. What is in another unit
throughout, inches for mm, is a machine of another size: nothing says it, unless the positions were
round in mm.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.units import Floats, unit_of
from trunnion.data.whole import MM_PER_INCH, in_inches, in_radians
from trunnion.files.table import Table

FACTORS_MM = {
    "are in inches": 25.4,
    "are in µm": 1e-3,
    "are in cm": 10.0,
    "are in m": 1e3,
    "are in mm but were taken for inches": 1 / 25.4,
}
"""What lengths may be by which they are wrong, and what takes them to mm."""

_FACTORS: Mapping[str, Mapping[str, float]] = {
    "mm": FACTORS_MM,
    "µm": {"are in mm": 1e3, "are 1000 times too large": 1e-3},
    "µm/m": {"are in mm/m": 1e3, "are in radians": 1e6},
    "deg": {
        "are in radians": float(np.degrees(1.0)),
        "are in arcminutes": 1 / 60,
        "are in degrees but were taken for radians": float(np.radians(1.0)),
    },
}
"""Declared unit → what its columns may be by which they are wrong, and what takes them there."""

MAX_SHOWN = 3
"""Positions that a sentence has as examples."""


@dataclass(frozen=True)
class Sizes:
    """Sizes that no machine and no instrument gives, of columns that declare a unit.

    least, limit: From which size on, and below which; in the column's unit.
    meant: What is asked; empty: after the units, in `others`, by which it is an ordinary size.
    others: Unit → what takes it to the column's; `ordinary`: the sizes that are usual.
    spread: Whether the largest difference counts, else the largest size.
    each: Whether each column is judged by itself, else the largest of all.
    """

    least: float
    limit: float
    meant: str = ""
    others: Mapping[str, float] = field(default_factory=dict)
    ordinary: tuple[float, float] = (0.0, np.inf)
    spread: bool = False
    each: bool = True

    def asked(self, size: float, unit: str) -> str:
        """Ask about a size in a unit; empty: nothing is known of it."""
        near = {
            name: factor
            for name, factor in self.others.items()
            if self.ordinary[0] <= size * factor <= self.ordinary[1]
        }
        if self.meant or not near:
            return self.meant
        (name, factor), *rest = near.items()
        first = f"{name} ({times_text(factor)} as large in {unit})"
        asked = [first, *(f"{other} ({times_text(times)})" for other, times in rest)]
        return f"are these {' or '.join(asked)}"


def times_text(factor: float) -> str:
    """Say a factor: ``1000 times``, ``10⁶ times``."""
    return "10⁶ times" if factor == 1e6 else f"{factor:.5g} times"


IN_M = Sizes(1e-6, 1.0, others={"m": 1e3, "inches": MM_PER_INCH}, ordinary=(10.0, 2e4), each=False)
"""Its limit is by the kind of data (`Table.smallest_mm`)."""

_SIZES: Mapping[str, tuple[Sizes, ...]] = {
    "µm": (
        Sizes(
            1e-6,
            0.3,
            others={"mm": 1e3, "inches": 25400.0, "m": 1e6},
            ordinary=(1.0, 510.0),
            spread=True,
        ),
    ),
    "µm/m": (
        Sizes(
            1e-7,
            0.3,
            others={"mm/m": 1e3, "radians": 1e6, "degrees": 1e6 * np.pi / 180.0},
            ordinary=(0.5, 500.0),
            spread=True,
        ),
        Sizes(2e4, np.inf, "are these µm/m already, made 1000 times too large", spread=True),
    ),
    "mm": (
        IN_M,
        Sizes(6e4, np.inf, "are these µm (1000 times as small in mm)", each=False),
    ),
}
"""By the unit that a column declares."""


def size_notes(data: Any) -> tuple[str, ...]:
    """Ask whether readings and set positions are in other units; empty where nothing is doubtful.

    Of anything but a table nothing is known. Slight moves of an axis are no other unit: positions
    of a log are judged by the servo (:mod:`trunnion.models.axis_log`).
    """
    if not isinstance(data, Table) or not len(data):
        return ()
    declared = {**data.readings, **data.set_positions}
    by_unit: dict[str, dict[str, Floats]] = {}
    for name, values in declared.items():
        by_unit.setdefault(unit_of(name), {})[name] = values
    if data.slight_moves:
        by_unit.pop("mm", None)
    said = [_asked(unit, some, data.smallest_mm) for unit, some in by_unit.items()]
    places = {n: v for n, v in data.set_positions.items() if n in by_unit.get("mm", {})}
    if in_inches(places.values()):
        shown = _shown(np.concatenate([*places.values()]))
        said.append(f"{listed(places)}: {shown}: are these inches? They are round in mm then.")
    said += [
        f"{name}: {_shown(values)}: are these radians (57.3 times as large in degrees)?"
        for name, values in data.set_positions.items()
        if unit_of(name) == "deg" and in_radians(values)
    ]
    return tuple(filter(None, said))


def factors(unit: str) -> Mapping[str, float]:
    """Return what columns of a unit may be by which they are wrong, and what takes them there."""
    return _FACTORS.get(unit, {})


def _asked(unit: str, columns: Mapping[str, Floats], smallest_mm: float) -> str:
    """Ask about columns of one unit; empty: their size is as it should be.

    smallest_mm: Below this no positions of the kind are all.
    """
    for sizes in _SIZES.get(unit, ()):
        found = {
            n: float(np.ptp(v) if sizes.spread else np.abs(v).max()) for n, v in columns.items()
        }
        limit = smallest_mm if sizes is IN_M else sizes.limit
        if not sizes.each:
            found = dict.fromkeys(found, max(found.values()))
        wrong = {name: size for name, size in found.items() if sizes.least <= size < limit}
        size = max(wrong.values(), default=0.0)
        if wrong and (meant := sizes.asked(size, unit)):
            how = "differ by" if sizes.spread else "reach"
            return f"{listed(wrong)}: values {how} {size:.3g} {unit} at most: {meant}?"
    return ""


def of_each(said: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return what is said of each of some measurements with its name, what of all of them once."""
    first, *others = said.values()
    of_all = [text for text in first if all(text in other for other in others)]
    own = [f"{name}: {x}" for name, texts in said.items() for x in texts if x not in of_all]
    return (*of_all, *own)


def of_number(said: str, count: int) -> str:
    """What is said of several columns, of so many."""
    return said if count > 1 else said.replace("are ", "is ", 1).replace(" were ", " was ")


def listed(names: Iterable[str]) -> str:
    """Names of columns as a sentence has them."""
    every = list(names)
    return " and ".join(filter(None, (", ".join(every[:-1]), every[-1])))


def _shown(values: NDArray[Any]) -> str:
    some = np.unique(values)[:MAX_SHOWN].tolist()
    return ", ".join(f"{value:.5g}" for value in some) + ", ..."
