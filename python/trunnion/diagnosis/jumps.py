"""Where along a quantity that orders readings they may jump."""

from collections.abc import Callable

import numpy as np

from trunnion.base.units import Floats, Integers

JUMPS = 48  # places of the scan
NEAR = 24  # places between two of the scan that are tried at a time
ONE_BETWEEN = 2  # steps of the scan, of which each has one value between
MAX_PLACES = 384  # places at which a jump is sought beside causes
MAX_NUMBERS = 1 << 21  # numbers of these at once
MOMENTS = 48, 136  # least and most moments at which a slip is sought
MOMENT_NUMBERS = 1 << 18  # values of one column at all of these, beyond the least
FEW = 8  # of these, that compete with causes: each has its share of the odds


def places_of_jumps(distinct: Floats) -> Floats:
    """Places of the scan: values of a quantity, ascending, from which on readings are others."""
    return distinct[_step(distinct) :: _step(distinct)]


def moments_tried(between: Floats, readings: int, also: float | None = None) -> tuple[float, ...]:
    """Moments, of some between readings, at which a slip is sought: all of few.

    A cause that jumps beside a wrong moment would explain the readings between: a backlash, where
    the slip came as an axis turned back. ``also``: in a break of the measurement.
    """
    least, most = MOMENTS
    count = min(most, max(least, MOMENT_NUMBERS // max(readings, 1)))
    some = between[:: max(1, len(between) // count)]
    return tuple(map(float, some if also is None else np.union1d(some, [also])))


def near(distinct: Floats, place: float) -> Floats:
    """Some of the values between the neighbours of a place of the scan, and it; ascending.

    It alone where one value is between: a reading on the wrong side is no cause.
    """
    if _step(distinct) <= ONE_BETWEEN:
        return np.array([place])
    return np.unique([*distinct[_spread(*_about(distinct, place), FEW)], place])


def best_near(
    distinct: Floats, place: float, gains: Callable[[Floats], Floats]
) -> tuple[float, float]:
    """Value between the neighbours of a place of the scan at which a jump gains most; the gain."""
    return best_between(distinct, *_about(distinct, place), gains)


def best_between(
    distinct: Floats, low: int, high: int, gains: Callable[[Floats], Floats]
) -> tuple[float, float]:
    """The same of the values numbered from one to another."""
    while True:
        some = _spread(low, high, NEAR)
        gain = gains(distinct[some])
        best = int(np.argmax(gain))
        if high - low <= NEAR:
            return float(distinct[some[best]]), float(gain[best])
        low, high = int(some[max(best - 1, 0)]), int(some[min(best + 1, len(some) - 1)])


def fine_places(distinct: Floats, readings: int) -> Integers:
    """Numbers of so many values that a jump of any place shows at one of them."""
    return _spread(1, len(distinct) - 1, max(2 * JUMPS, min(MAX_PLACES, MAX_NUMBERS // readings)))


def _step(distinct: Floats) -> int:
    return max(1, len(distinct) // JUMPS)


def _about(distinct: Floats, place: float) -> tuple[int, int]:
    """Numbers of the first and the last value between the neighbours of a place of the scan."""
    at, step = int(np.searchsorted(distinct, place)), _step(distinct)
    return at - step + 1, min(at + step, len(distinct)) - 1


def _spread(low: int, high: int, count: int) -> Integers:
    """So many numbers from one to another, and one."""
    return np.unique(np.linspace(low, high, count + 1).round().astype(np.intp))
