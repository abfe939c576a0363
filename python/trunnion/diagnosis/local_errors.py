"""Local errors: bells about some places along a quantity."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from trunnion._core import local_errors_inside
from trunnion.base.units import Floats
from trunnion.diagnosis.effect import NamedValues

WIDTHS = (1 / 4, 1 / 8, 1 / 16)  # in turns or ranges
STEPS_A_WIDTH = 2  # between neighbouring places
BESIDE_PLACE = np.linspace(-0.25, 0.25, 5)  # in widths, around a place of the scan
TIMES_WIDTH = (0.5, 0.7, 1.0, 1.4)  # the same of widths
FAR_LESS = 0.2  # of a gain, that a local error has at a place of the scan near the best one
ROUNDS = 5  # of places and widths half as far from the best ones each time


def places_of(distinct: Floats, period: float | None) -> tuple[Floats, Floats]:
    """Places and widths (m,) of local errors with several values of a quantity, some beside each.

    What ends where the readings end is a jump, or slow.
    """
    span = float(distinct[-1] - distinct[0])
    whole, span = period or span, span if period is None else min(span, period)
    each = [np.arange(0.0, span + w / 4, w / STEPS_A_WIDTH) for w in whole * np.array(WIDTHS)]
    places = distinct[0] + np.concatenate(each)
    widths = np.repeat(whole * np.array(WIDTHS), [len(x) for x in each])
    inside = local_errors_inside(distinct, np.column_stack([places, widths]), period)
    return places[inside], widths[inside]


def between(
    place: float, width: float, further: Iterable[tuple[float, float]] = ()
) -> tuple[Floats, Floats]:
    """Places and widths (v,) of local errors near one of the scan; of further ones, too."""
    places = place + np.tile(BESIDE_PLACE, len(TIMES_WIDTH)) * width
    widths = np.repeat(TIMES_WIDTH, len(BESIDE_PLACE)) * width
    every = np.concatenate(
        [np.stack([places, widths], axis=1), *np.reshape([*further], (-1, 1, 2))]
    )
    return tuple(every[np.lexsort(every.T)].T)


def likeliest(
    place: float, width: float, gains: Callable[[Floats, Floats], Floats], least: float
) -> tuple[tuple[float, float], float]:
    """Place and width near those of the scan at which a local error gains most; the gain.

    ``least``: of one that gains less the nearest of a few that are tried; of one that gains far
    less at the place of the scan that place.
    """
    at_scan = gains(np.array([place]), np.array([width]))
    if at_scan[0] < FAR_LESS * least:
        return (place, width), float(at_scan[0])
    about, step, ratio = np.arange(-1.0, 2.0), np.diff(BESIDE_PLACE)[0], TIMES_WIDTH[-1]
    places, widths = between(place, width)
    bounds = widths[0], widths[-1]
    for _ in range(ROUNDS + 1):
        gain = gains(places, widths)
        best = int(np.argmax(gain))
        found = float(places[best]), float(widths[best])
        if gain[best] < least:
            break
        step, ratio = step / 2, np.sqrt(ratio)
        places = found[0] + np.tile(about, len(about)) * step * found[1]
        widths = np.clip(found[1] * ratio ** np.repeat(about, len(about)), *bounds)
    return found, float(gain[best])


def local(
    values: Floats, place: float | Floats, width: float | Floats, period: float | None
) -> Floats:
    """Local error of height 1 about a value of a quantity: a bell, half as high at its width."""
    return np.asarray(np.exp2(-((2 * beside(values, place, period) / width) ** 2)))


def beside(values: Floats, place: float | Floats, period: float | None) -> Floats:
    """How far values of a quantity are from one, the short way round."""
    off = values - place
    return off if period is None else off - period * np.rint(off / period)


@dataclass(frozen=True, eq=False)
class Bell:
    """Columns of a local error at values of its place and width; names: of height, place, width."""

    s: Floats
    weight: Floats
    turn: float
    names: tuple[str, ...]

    def columns(self, values: NamedValues) -> Floats:
        """Change of each reading per unit of the height, (n, 1)."""
        place, width = (float(values[name]) for name in self.names[1:])
        return (self.weight * local(self.s, place, width, self.turn or None))[:, None]

    def slopes(self, values: NamedValues) -> Floats:
        """Derivative of the change by place and width, (n, 2)."""
        height, place, width = (float(values[name]) for name in self.names)
        off = beside(self.s, place, self.turn or None)
        steep = 8 * np.log(2) * height / width**2 * self.columns(values)[:, 0] * off
        return np.stack([steep, steep * off / width], axis=1)
