"""Deviations from nominal positions or lengths in place of these: recognised and made whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from trunnion.base.errors import TrunnionError
from trunnion.base.units import Floats
from trunnion.data.ballbar import Ballbar
from trunnion.data.mistaken import listed
from trunnion.files.table import Table

MIN_SPREAD_UM = 0.3
"""Deviations that differ by less are not in µm: they would be better than any machine."""

MIN_RELATIVE_SPREAD = 0.02
"""Of the largest: what differs by less is a length in another unit, not deviations from one."""

FOLLOWING = 0.1
"""By how much the slope of positions over nominal ones differs from 1 at most."""

MIN_OTHER_BAR_MM = 1.0
"""By how much a bar of another length differs from the radius of the program at least."""

MAX_OTHER_BAR = 5.0
"""By which factor at most: units differ by more."""

MAX_OFF_CIRCLE = 1e-3
"""Of the radius: how far commanded positions of a ball-bar lie off their circle or sphere."""


def from_deviations(data: Table) -> Iterator[tuple[str, Table, float]]:
    """Yield what readings may be deviations from, the data if they are, and mm of their unit."""
    expected = nominal_readings(data)
    if not expected:
        return
    holds, what = ("are", "places") if len(expected) > 1 else ("holds", "length")
    spread = max(float(np.ptp(data[name])) for name in expected)
    if spread <= MIN_RELATIVE_SPREAD * max(float(np.abs(data[name]).max()) for name in expected):
        return
    places = {name: data[name] for name in data.set_positions if name.endswith("_mm")}
    if any(_follows(data[name], places) for name in expected if f"nominal_{name}" in places):
        return
    for unit, factor in (("mm", 1.0), ("µm", 1e-3)):
        if unit == "µm" and spread < MIN_SPREAD_UM:
            continue
        meant = {name: nominal + factor * data[name] for name, nominal in expected.items()}
        try:
            made = data.with_columns(**meant)
        except TrunnionError:  # no length
            continue
        text = f"if {listed(expected)} {holds} deviations from the nominal {what} in {unit}"
        yield text, made, factor


def of_another_bar(data: Table) -> Iterator[tuple[str, Table]]:
    """Yield the data with lengths about those commanded, where all differ from these by much.

    A bar of another nominal length than the radius of the program, or than its set-up has it.
    """
    if not isinstance(data, Ballbar) or (radius := _bar_mm(data)) is None:
        return
    measured, said = np.array(data.length_mm, dtype=np.float64), []
    for label in np.unique(data.setup):
        rows = data.setup == label
        off = float(np.median(measured[rows] - radius[rows]))
        commanded = float(np.median(radius[rows]))
        if abs(off) < MIN_OTHER_BAR_MM:
            continue
        if not 1 / MAX_OTHER_BAR < 1.0 + off / commanded < MAX_OTHER_BAR:
            return
        measured[rows] -= off
        said.append(f"{commanded + off:.4g} mm long where {commanded:.4g} mm are commanded")
    if said:
        some = " and ".join(dict.fromkeys(said))
        yield f"if the ball-bar is {some}", data.with_columns(length_mm=measured)


def _follows(values: Floats, places: Mapping[str, Floats]) -> bool:
    """Whether values change by as much as places do: such a column holds positions in mm."""
    about = np.column_stack([place - place.mean() for place in places.values()])
    slopes = np.linalg.lstsq(about, values - values.mean(), rcond=1e-9)[0]
    return abs(float(np.linalg.norm(slopes)) - 1.0) < FOLLOWING


def nominal_readings(data: Table) -> Mapping[str, Floats]:
    """Return what readings should be, by name, as far as the data tell."""
    if isinstance(data, Ballbar):
        return {} if (length := _bar_mm(data)) is None else {"length_mm": length}
    pairs = {name: f"nominal_{name}" for name in data.readings}
    return {n: data[p] for n, p in pairs.items() if p in data.set_positions}


def _bar_mm(data: Ballbar) -> Floats | None:
    """Radius of the circle or sphere of each set-up, (n,); None where there is none."""
    position = data.position_mm
    if position is None:
        return None
    length = np.empty(len(data))
    for label in np.unique(data.setup):
        rows = data.setup == label
        about = position[rows] - position[rows].mean(axis=0)
        square = np.sum(about**2, axis=1)
        # |p|² = 2 c·p + (r² − |c|²); of a circle the centre is in its plane (least norm).
        terms = np.column_stack([2 * about, np.ones(len(about))])
        *centre, rest = np.linalg.lstsq(terms, square, rcond=1e-9)[0]
        radius = float(np.sqrt(max(rest + np.sum(np.square(centre)), 0.0)))
        off = np.abs(np.linalg.norm(about - np.asarray(centre), axis=1) - radius)
        if not off.max() <= MAX_OFF_CIRCLE * radius:
            return None
        length[rows] = radius
    return length
