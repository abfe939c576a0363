"""What a control records of touches: coordinates, ways from the starts, and the clock they show."""

from __future__ import annotations

import numpy as np

from trunnion.base.recognition import on_grid, recognised
from trunnion.base.resolution import Coordinates
from trunnion.base.rows import equal_rows
from trunnion.base.units import Floats, Integers
from trunnion.data.touches import Touches
from trunnion.setup.parts import PERIODS_MS

SAME_PERIOD = 0.02
WRITTEN_UM = 2e-3
"""What six decimals of a mm (a log's) make of the way of an oblique approach, at most."""
ROUND_DIRECTION = 1e-6
MIN_ALIKE = 5
"""Touches of one way, from starts and to places that differ, which chance does not make."""
MIN_COUNTS = 3
"""Counts of steps: one difference is no step."""
MAX_CHANCE = 1e-6
"""That ways in the steps of a stated clock all are multiples of more."""


def readings_um(touches: Touches) -> Floats:
    """Readings: recorded coordinates along the approaches, µm, shape (n,)."""
    return np.asarray(np.einsum("ij,ij->i", touches.position_mm, touches.direction) * 1e3)


def recorded_um(touches: Touches) -> tuple[Floats, ...]:
    """What may be recorded in steps, µm: places along the approach, or ways along it, (n,).

    A control that looks at the probe once in a tick records multiples of it on the way from the
    start along the approach.
    """
    known = readings_um(touches)
    if touches.start_mm is None:
        return (known,)
    way = np.einsum("ij,ij->i", touches.position_mm - touches.start_mm, touches.direction)
    return (_without_digits(1e3 * way, WRITTEN_UM), known)


def coordinates_um(touches: Touches) -> Coordinates:
    """Coordinates that may be recorded in steps, µm, from the first touch.

    A file or a display has as many digits wherever the touch is, however oblique the approach.
    """
    places = touches.position_mm
    return Coordinates(1e3 * (places - places[:1]), touches.direction)


def servo_period_ms(touches: Touches) -> float:
    """Period that touches are looked at, as their ways say; 0: none is seen.

    At several feeds the ways, or the places along the approach, are whole steps, and the steps are
    as the feeds; at any, touches from different starts to different places have the same ways: they
    are of no display, but of a clock. It is none whose steps are finer than those in which the
    coordinates are written.
    """
    feed = touches.feed_mm_min
    if feed is None or not np.all(feed > 0):
        return 0.0
    found = _of_feeds(touches, feed) or _of_starts(touches, feed)
    if not PERIODS_MS[0] <= found <= PERIODS_MS[1]:
        return 0.0
    # Of an axis that no touch is made along, the places are those of the plan.
    digits = min(recognised(axis) for axis in coordinates_um(touches).places.T)
    return found if found * float(feed.min()) / 60 > (1 - SAME_PERIOD) * digits else 0.0


def other_period_ms(touches: Touches, stated_ms: float) -> float:
    """Period that touches are looked at, where it is not the stated one; 0: they do not say so.

    Few ways that are multiples of the seen period in stated ones may be so by chance.
    """
    seen = servo_period_ms(touches)
    if not seen or abs(seen - stated_ms) <= SAME_PERIOD * stated_ms:
        return 0.0
    if seen < stated_ms:
        return seen  # touches lie between the looks of the stated clock
    assert touches.feed_mm_min is not None
    counts = np.round(readings_um(touches) * 60 / touches.feed_mm_min / stated_ms)
    by_chance = (stated_ms / seen) ** len(np.unique(counts))
    return seen if by_chance <= MAX_CHANCE else 0.0


def _of_feeds(touches: Touches, feed: Floats) -> float:
    """Period of ways or places that are whole steps, as the feeds; 0: there is none."""
    for recorded in recorded_um(touches):
        periods = [_step(60.0 * recorded[feed == f] / f) for f in np.unique(feed)]
        if len(periods) > 1 and np.allclose(periods, periods[0], rtol=SAME_PERIOD):
            return periods[0]
    return 0.0


def _of_starts(touches: Touches, feed: Floats) -> float:
    """Period of ways that are whole steps, of which places are not as few; 0: there is none.

    A control reaches its feed within the same way along one line, not along all.
    """
    if touches.start_mm is None:
        return 0.0
    digits = float(WRITTEN_UM * 60.0 / feed.min())
    lines = np.round(touches.direction / ROUND_DIRECTION)
    label, first = equal_rows([*lines.T, feed])
    way, place = (60.0 * recorded / feed for recorded in recorded_um(touches))
    along, places = (_without_digits(v - v[first][label], digits) for v in (way, place))
    if _distinct(label, places) - _distinct(label, along) < MIN_ALIKE:
        return 0.0
    for ways in (_without_digits(way, digits), np.append(0.0, along)):
        period = _step(ways)
        if period and _distinct(np.abs(np.round((ways - ways[0]) / period))) >= MIN_COUNTS:
            return 0.0 if on_grid(places, period) else period  # as a display does it
    return 0.0


def _distinct(*columns: Floats | Integers) -> int:
    """How many rows differ."""
    return len(equal_rows(columns)[1])


def _step(values: Floats) -> float:
    """Step whose multiples values differ by, as all of them say it; 0: none."""
    step = recognised(values)
    if not step > 0:
        return 0.0
    off = values - values[0]
    count = np.round(off / step)
    return float(off @ count / (count @ count))


def _without_digits(ways: Floats, digits: float) -> Floats:
    """Ways of which those are one that differ by the digits of a file, shape (n,)."""
    order = np.argsort(ways)
    label = np.empty(len(ways), dtype=np.intp)
    label[order] = np.cumsum(np.diff(ways[order], prepend=ways[order][:1]) > digits)
    count = np.bincount(label)
    whole = (np.bincount(label, weights=ways) / count)[label] if len(count) else ways
    return whole if np.all(np.abs(whole - ways) <= digits) else ways
