"""Waves of unknown length along a quantity, and the shortest that the places on a grid show."""

import numpy as np

from trunnion.base.rotation import cosine_sine
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.columns import AT_HAND
from trunnion.diagnosis.model import Covariate
from trunnion.diagnosis.smooth import over_range

WAVES = 10  # over the range, of a quantity on no grid
APART = 3 * WAVES  # values distinguished over half of the range: six in the shortest wave
WAVES_ON_A_GRID = 50
WAVES_BETWEEN = np.array(
    [0.0, -0.25, -0.125, 0.125, 0.25]
)  # over the range, around one of the scan
OFF_GRID = 0.01  # of a step, how far places on a grid are off it: rounding


def waves_of(v: Covariate, distinct: Floats) -> Floats:
    """How many waves there are over the range of a quantity, of each term, ascending (m,).

    ``distinct``: its values, sorted. On a grid of places waves are as short as two steps: rows that
    alternate would else be taken for noise.
    """
    if shortest_on_grid(v, distinct):
        return np.arange(3, len(distinct)) / 2
    return np.arange(1.5, min(WAVES, len(distinct) / 3), 0.5)


def places_apart(values: Floats) -> int:
    """How many different values there are for the shortest wave."""
    low, high = values.min(initial=np.inf), values.max(initial=-np.inf)
    if low >= high:
        return min(len(values), 1)
    return len(np.unique(np.floor(APART * over_range(values, low, high))))


def shortest_on_grid(v: Covariate, distinct: Floats) -> float:
    """Period of two steps of the grid that a quantity is on; 0: on none, or on one of many steps.

    A shorter wave has the values of a longer one there. What is in the order of measurement is on
    no grid of places: its steps are those of the measurement.
    """
    if v.sequence or v.classes:
        return 0.0
    step = step_of_grid(distinct)
    few = step > 0.0 and float(distinct[-1] - distinct[0]) < (2 * WAVES_ON_A_GRID + 0.5) * step
    return 2 * step if few else 0.0


def step_of_grid(distinct: Floats) -> float:
    """Step of the grid that values are on, sorted; 0: on none."""
    if len(distinct) < 2:
        return 0.0
    off = distinct - distinct[0]
    number = np.rint(off / np.diff(distinct).min())
    step = float(off[-1] / number[-1])
    return 0.0 if np.any(np.abs(off - number * step) > OFF_GRID * step) else step


def waves(rates: Floats | Integers, x: Floats) -> Floats:
    """Return the cosine of each multiple, then the sine of each, shape (2, m, n)."""
    if len(rates) * len(x) <= AT_HAND:
        return cosine_sine(np.multiply.outer(rates, x))
    out = np.empty((2, len(rates), len(x)))
    for i, rate in enumerate(rates):
        out[:, i] = cosine_sine(rate * x)
    return out
