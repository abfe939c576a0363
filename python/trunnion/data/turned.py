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
    "the level was turned between them: was it, or were the signs of these readings changed "
    "already? Readings are given as they were read."
)


def turn_doubts(data: Levels) -> tuple[str, ...]:
    """Ask about a round of readings that goes with the first as if turned otherwise than stated.

    Compared as what goes with time may differ from round to round, and as it is a drift from the
    first reading to the last, or another zero: slopes that grow along the places (a bow, a twist)
    are lost in the first, and a jump back between two drifts is none of the second.
    """
    places, index = data.stations
    rounds = _rounds(index)
    if len(places) < MIN_PLACES:
        return ()
    values = np.stack([np.asarray(data.columns[f"{c}_um_m"]) for c in data.components], axis=1)
    moment = np.arange(len(values), dtype=np.float64)
    if data.time_s is not None:
        moment = np.asarray(data.time_s, dtype=np.float64)
    first = _of_round(rounds == 0, index, len(places))
    step = max(displayed(column) for column in values.T)
    for k in range(1, int(rounds.max(initial=0)) + 1):
        later = _of_round(rounds == k, index, len(places))
        both = (first >= 0) & (later >= 0)
        one, other = first[both], later[both]
        turned = np.unique(data.sense[one] * data.sense[other])
        if np.sum(both) < MIN_PLACES or len(turned) != 1:
            continue
        freedom = (np.sum(both) - 2) * values.shape[1]
        least = freedom * (step**2 / 6.0 + EXACT**2)  # two readings that are rounded
        by_sign = values[one] - values[other], values[one] + values[other]
        free = np.stack([np.ones(len(one)), one - one.mean()], axis=1)
        pairs = [tuple(_left(change, free) for change in by_sign)]
        pairs.append(_of_one_drift(*by_sign, moment[one], moment[other], turned[0]))
        if turned[0] < 0:  # of signs that were changed the zero has the other one, and stays
            kept = np.ones((len(one), 1))
            pairs.append((_left(by_sign[0], kept), pairs[-1][1]))
        for same, opposite in pairs:
            stated, otherwise = (same, opposite) if turned[0] > 0 else (opposite, same)
            ratio = stated / max(otherwise, least)
            if ratio > MIN_RATIO and special.fdtrc(freedom, freedom, ratio) < MAX_CHANCE:
                return ((FORGOTTEN if turned[0] > 0 else NOT_TURNED).format(k + 1),)
    return ()


def _of_one_drift(
    same: Floats, opposite: Floats, at: Floats, later: Floats, turned: float
) -> tuple[float, float]:
    """Sums of squares that a zero and a drift leave of two rounds, of the same or another sign.

    What is stated may have either drift or another zero in the later round; what is asked about
    has to do without.

    same, opposite: First less and plus later readings, (n, c). at, later: Their moments, (n,).
    """
    zero = np.ones((len(at), 1))
    apart, together = (np.asarray(x, dtype=np.float64)[:, None] for x in (at - later, at + later))
    if turned > 0:
        return min(_left(same, apart), _left(same, zero)), _left(opposite, zero)
    return _left(same, apart), _left(opposite, np.hstack([zero, together]))


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


def _left(values: Floats, columns: Floats) -> float:
    """Sum of squares that columns, (n, k), leave of each component, (n, c)."""
    fitted = columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(np.sum((values - fitted) ** 2))
