"""Whether a level was turned as its data say, by how readings of the same places go together.

A level that is turned by 180 degrees shows every slope with the other sign, and its zero with the
same: over the places the sum of two rounds of readings is the same then but for a drift, else their
difference is.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from trunnion.base.recognition import displayed
from trunnion.base.units import Flags, Floats, Integers
from trunnion.data.levels import Levels

MIN_PLACES = 5
MAX_CHANCE = 1e-5
"""That sound readings, of noise alone, go so much better with the other sign."""
MIN_RATIO = 16.0
"""Of the sums of squares; an error that goes with time may be much the same in two rounds."""
EXACT = 1e-6
"""µm/m, which no level resolves."""
FORGOTTEN = (
    "The readings of round {} go with those of round 1 with the other sign: was the level turned "
    "by 180 degrees, and turn_deg not given?"
)
NOT_TURNED = (
    "The readings of round {} go with those of round 1 with the same sign, but turn_deg says that "
    "the level was turned between them: was it?"
)


def turn_doubts(data: Levels) -> tuple[str, ...]:
    """Ask about a round of readings that goes with the first as if turned otherwise than stated."""
    places, index = data.stations
    rounds = _rounds(index)
    if len(places) < MIN_PLACES:
        return ()
    values = np.stack([np.asarray(data.columns[f"{c}_um_m"]) for c in data.components], axis=1)
    first = _of_round(rounds == 0, index, len(places))
    step = max(displayed(column) for column in values.T)
    for k in range(1, int(rounds.max(initial=0)) + 1):
        later = _of_round(rounds == k, index, len(places))
        both = (first >= 0) & (later >= 0)
        one, other = first[both], later[both]
        turned = np.unique(data.sense[one] * data.sense[other])
        if np.sum(both) < MIN_PLACES or len(turned) != 1:
            continue
        stated = _scatter(values[one] - turned[0] * values[other], one)
        otherwise = _scatter(values[one] + turned[0] * values[other], one)
        freedom = (np.sum(both) - 2) * values.shape[1]
        least = freedom * (step**2 / 6.0 + EXACT**2)  # two readings that are rounded
        ratio = stated / max(otherwise, least)
        if ratio > MIN_RATIO and special.fdtrc(freedom, freedom, ratio) < MAX_CHANCE:
            return ((FORGOTTEN if turned[0] > 0 else NOT_TURNED).format(k + 1),)
    return ()


def _rounds(index: Integers) -> Integers:
    """How often the place of each row was read before."""
    order = np.argsort(index, kind="stable")
    start = np.searchsorted(index[order], index[order])
    rounds = np.empty(len(index), dtype=np.intp)
    rounds[order] = np.arange(len(index)) - start
    return rounds


def _of_round(rows: Flags, index: Integers, count: int) -> Integers:
    """Row of each place in a round, -1: none."""
    out = np.full(count, -1, dtype=np.intp)
    out[index[rows]] = np.flatnonzero(rows)
    return out


def _scatter(values: Floats, row: Integers) -> float:
    """Sum of squares about the mean and drift of each component, (n, c), read in these rows."""
    line = np.linalg.qr(np.stack([np.ones(len(row)), row - row.mean()], axis=1))[0]
    return float(np.sum((values - line @ (line.T @ values)) ** 2))
