"""Data in another unit than their columns declare, known by the size of what they hold.

A sentence says what is likely meant, with the factor; no number is changed. What is in another unit
throughout, inches for mm, is a machine of another size: nothing says it, unless the positions were
round in mm.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.units import Floats, unit_of
from trunnion.data.whole import in_inches, in_radians
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
    """Sizes of another unit: from, below, and what the values then are; all in the column's unit.

    spread: Whether the largest difference counts, else the largest size.
    """

    least: float
    limit: float
    meant: str
    spread: bool


IN_M = Sizes(1e-6, 1.0, "are these m (1000 times as large in mm)", spread=False)
"""Its limit is by the kind of data (`Table.smallest_mm`)."""

_SIZES: Mapping[str, tuple[Sizes, ...]] = {
    "µm": (
        Sizes(4e-5, 1e-3, "are these inches (25400 times as large in µm)", spread=True),
        Sizes(
            1e-3,
            0.02,
            "are these mm (1000 times as large in µm) or inches (25400 times)",
            spread=True,
        ),
        Sizes(0.02, 0.3, "are these mm (1000 times as large in µm)", spread=True),
    ),
    "µm/m": (
        Sizes(1e-7, 1e-3, "are these radians (10⁶ times as large in µm/m)", spread=True),
        Sizes(1e-3, 0.3, "are these mm/m (1000 times as large in µm/m)", spread=True),
        Sizes(2e4, np.inf, "are these µm/m already, made 1000 times too large", spread=True),
    ),
    "mm": (
        IN_M,
        Sizes(6e4, np.inf, "are these µm (1000 times as small in mm)", spread=False),
    ),
}
"""What no machine and no instrument of the kinds gives, by the unit that a column declares."""


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
        size = max(float(np.ptp(v) if sizes.spread else np.abs(v).max()) for v in columns.values())
        limit = smallest_mm if sizes is IN_M else sizes.limit
        if sizes.least <= size < limit:
            how = "differ by" if sizes.spread else "reach"
            return f"{listed(columns)}: values {how} {size:.3g} {unit} at most: {sizes.meant}?"
    return ""


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
