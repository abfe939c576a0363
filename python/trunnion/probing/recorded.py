"""What a control records of touches: coordinates, ways from the starts, and the clock they show."""

from __future__ import annotations

import numpy as np

from trunnion.base.recognition import SAME_STEP, on_grid, recognised
from trunnion.base.resolution import Coordinates
from trunnion.base.rows import equal_rows
from trunnion.base.units import Floats, Integers
from trunnion.data.touches import Touches
from trunnion.setup.parts import PERIODS_MS

SAME_PERIOD = 0.02
WRITTEN_UM = 2e-3
"""What six decimals of a mm (a log's) make of the way of an oblique approach, at most."""
ROUND_DIRECTION = 1e-6
MIN_COUNTS = 3
"""Counts of steps: one difference is no step."""
MAX_CHANCE = 1e-6
"""That ways in steps of a stated clock, or in the digits of a file, all are multiples of more."""


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


def servo_period_ms(touches: Touches, commands_um: float = 0.1) -> float:
    """Period that touches are looked at, as their ways say; 0: none is seen.

    commands_um: Step of commands, in which starts lie that are not known.

    At several feeds the ways, or the places along the approach, are whole steps, and the steps are
    as the feeds; at any, touches from different starts to different places have the same ways: they
    are of no display, but of a clock. It is none whose steps are finer than those in which the
    coordinates are written.
    """
    feed = touches.feed_mm_min
    if feed is None or not np.all(feed > 0):
        return 0.0
    # Of an axis that no touch is made along, the places are those of the plan.
    digits = min(recognised(axis) for axis in coordinates_um(touches).places.T)
    found = _of_feeds(touches, feed, commands_um) or _of_starts(touches, feed, digits)
    if not PERIODS_MS[0] <= found <= PERIODS_MS[1]:
        return 0.0
    return found if found * float(feed.min()) / 60 > (1 - SAME_PERIOD) * digits else 0.0


def other_period_ms(touches: Touches, stated_ms: float, commands_um: float = 0.1) -> float:
    """Period that touches are looked at, where it is not the stated one; 0: they do not say so.

    Few ways that are multiples of the seen period in stated ones may be so by chance.
    """
    seen = servo_period_ms(touches, commands_um)
    if not seen or abs(seen - stated_ms) <= SAME_PERIOD * stated_ms:
        return 0.0
    if seen < stated_ms:
        return seen  # touches lie between the looks of the stated clock
    assert touches.feed_mm_min is not None
    counts = np.round(readings_um(touches) * 60 / touches.feed_mm_min / stated_ms)
    by_chance = (stated_ms / seen) ** len(np.unique(counts))
    return seen if by_chance <= MAX_CHANCE else 0.0


def _of_feeds(touches: Touches, feed: Floats, commands_um: float) -> float:
    """Period of ways or places that are whole steps, as the feeds; 0: there is none.

    Places from starts in the steps of commands lie on steps of those, or finer, at any feed.
    """
    *ways, places = recorded_um(touches)
    for recorded, least in (*((way, 0.0) for way in ways), (places, commands_um)):
        periods = [_step(60.0 * recorded[feed == f] / f) for f in np.unique(feed)]
        if len(periods) > 1 and np.allclose(periods, periods[0], rtol=SAME_PERIOD):
            coarse = periods[0] * float(feed.min()) / 60.0 > (1 + SAME_PERIOD) * least
            return periods[0] if coarse else 0.0
    return 0.0


def _of_starts(touches: Touches, feed: Floats, digits_um: float) -> float:
    """Period of ways that are whole steps, which the places are not; 0: there is none.

    ``digits_um``: step in which coordinates are written. So many ways are hardly multiples of a
    clock's step by chance. A control reaches its feed within the same way along one line, not along
    all.
    """
    if touches.start_mm is None:
        return 0.0
    digits = float(WRITTEN_UM * 60.0 / feed.min())
    label, first = _lines(touches, feed)
    way, place = (60.0 * recorded / feed for recorded in recorded_um(touches))
    along, places = (_without_digits(v - v[first][label], digits) for v in (way, place))
    count = _distinct(label, places, along) - len(first)
    for ways in (_without_digits(way, digits), np.append(0.0, along)):
        period = _step(ways)
        if period and _distinct(np.abs(np.round((ways - ways[0]) / period))) >= MIN_COUNTS:
            share = max(2 * SAME_STEP, digits_um * 60.0 / feed.min() / period)
            if share**count > MAX_CHANCE or on_grid(places, period):  # as a display does it
                return 0.0
            return period
    return 0.0


def off_looks_um(touches: Touches, ticks_um: Floats) -> tuple[float, int]:
    """How far the ways from the starts are from whole ticks (n,), rms, with degrees of freedom.

    From those of all touches along one line at one tick in the mean, as the ball may be anywhere
    when it has reached its feed. No degrees of freedom: starts are not known.
    """
    if touches.start_mm is None or not np.all(ticks_um > 0):
        return 0.0, 0
    label, first = _lines(touches, ticks_um)
    looks = recorded_um(touches)[0] / ticks_um
    sine, cosine = (np.bincount(label, f(2 * np.pi * looks)) for f in (np.sin, np.cos))
    off = looks - np.arctan2(sine, cosine)[label] / (2 * np.pi)
    freedom = len(off) - len(first)
    squares = float(np.sum((ticks_um * (off - np.round(off))) ** 2))
    return float(np.sqrt(squares / max(freedom, 1))), freedom


def count_of_lines(touches: Touches, ticks_um: Floats) -> int:
    """How many lines of approach there are, each at one tick."""
    return len(_lines(touches, ticks_um)[1])


def _lines(touches: Touches, *columns: Floats) -> tuple[Integers, Integers]:
    """Label of the touches along one line that are alike in columns, and the first of each."""
    lines = np.round(touches.direction / ROUND_DIRECTION)
    return equal_rows([*lines.T, *columns])


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
