"""Local errors: bells about some places along a quantity."""

from dataclasses import dataclass

import numpy as np

from trunnion._core import local_errors_inside
from trunnion.base.units import Floats
from trunnion.diagnosis.effect import NamedValues

WIDTHS = (1 / 4, 1 / 8, 1 / 16)  # in turns or ranges
STEPS_A_WIDTH = 2  # between neighbouring places
BESIDE_PLACE = np.linspace(-0.25, 0.25, 5)  # in widths, around a place of the scan
TIMES_WIDTH = (0.5, 0.7, 1.0, 1.4)  # the same of widths


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
