"""Data in another unit than their columns declare, known by the size of what they hold.

A sentence says what is likely meant, with the factor; no number is changed. What is in another unit
throughout, inches for mm, is a machine of another size: nothing says it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.units import Floats, unit_of
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
    "deg": {"are in radians": float(np.degrees(1.0))},
}
"""Declared unit → what its columns may be by which they are wrong, and what takes them there."""

MIN_WHOLE = 3
"""Whole degrees among different positions, from which on they are taken for converted ones."""
WHOLE_DEG = 0.01  # what four decimals of a radian leave
MIN_DEG = 0.5


@dataclass(frozen=True)
class Sizes:
    """Sizes of another unit: from, below, and what the values then are; all in the column's unit.

    spread: Whether the largest difference counts, else the largest size.
    """

    least: float
    limit: float
    meant: str
    spread: bool


_SIZES: Mapping[str, tuple[Sizes, ...]] = {
    "µm": (Sizes(1e-3, 0.3, "are these mm (1000 times as large in µm)", spread=True),),
    "µm/m": (
        Sizes(1e-7, 1e-3, "are these radians (10⁶ times as large in µm/m)", spread=True),
        Sizes(1e-3, 0.3, "are these mm/m (1000 times as large in µm/m)", spread=True),
        Sizes(2e4, np.inf, "are these µm/m already, made 1000 times too large", spread=True),
    ),
    "mm": (
        Sizes(1e-6, 1.0, "are these m (1000 times as large in mm)", spread=False),
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
    said = [_asked(unit, some) for unit, some in by_unit.items()]
    said += [
        f"{name}: {_shown(values)}: are these radians (57.3 times as large in degrees)?"
        for name, values in data.set_positions.items()
        if unit_of(name) == "deg" and in_radians(values)
    ]
    return tuple(filter(None, said))


def factors(unit: str) -> Mapping[str, float]:
    """Return what columns of a unit may be by which they are wrong, and what takes them there."""
    return _FACTORS.get(unit, {})


def _asked(unit: str, columns: Mapping[str, Floats]) -> str:
    """Ask about columns of one unit; empty: their size is as it should be."""
    for sizes in _SIZES.get(unit, ()):
        size = max(float(np.ptp(v) if sizes.spread else np.abs(v).max()) for v in columns.values())
        if sizes.least <= size < sizes.limit:
            how = "differ by" if sizes.spread else "reach"
            return f"{listed(columns)}: values {how} {size:.3g} {unit} at most: {sizes.meant}?"
    return ""


def in_radians(values: NDArray[Any]) -> bool:
    """Whether positions are whole degrees when taken for radians, and not as they are."""
    distinct = np.unique(np.abs(values))
    degrees = np.degrees(distinct[distinct > np.radians(MIN_DEG)])
    if len(degrees) < MIN_WHOLE or len(degrees) < len(distinct) - 1:
        return False
    whole = np.abs(degrees - np.round(degrees)) < WHOLE_DEG
    as_given = np.abs(distinct - np.round(distinct, 2)) < 1e-9
    return bool(whole.all() and not as_given.all())


def listed(names: Iterable[str]) -> str:
    """Names of columns as a sentence has them."""
    every = list(names)
    return " and ".join(filter(None, (", ".join(every[:-1]), every[-1])))


def _shown(values: NDArray[Any]) -> str:
    some = np.unique(values)[:MIN_WHOLE].tolist()
    return ", ".join(f"{value:.5g}" for value in some) + ", ..."
