"""How much readings scatter by the direction in which they feel a disturbance.

A reading that feels the components c_k of independent disturbances of k directions has the variance
sum of c_k² v_k. The v are fitted to squared residuals, each weighed by the variance that it has.
"""

import numpy as np
from scipy import special

from trunnion.base.units import Floats

LEVEL = 1e-2  # of the test of equal variances
MAX_RATIO = 10.0  # of the scatter of two directions, that is allowed for
ALIKE = 1.2  # times the scatter of another direction: weights would change nothing
FAR = 5.0  # times the scatter of the others of its direction: one reading is no scatter
FALSE = 0.02  # share of the readings that the test does without
MIN_FREEDOM = 8.0  # degrees of freedom of a direction, from which its scatter is judged
MIN_FREE = 1e-6
ROUNDS = 20
SETTLED = 1e-3
TINY = 1e-300


def variances_by_direction(
    shares: Floats, left: Floats, free: Floats, least: float = 0.0
) -> Floats | None:
    """Return the variance of each direction (k,); None: they are all alike, or too few say so.

    A test of the likelihood says so at the level `LEVEL`, allowing for tails: its statistic is
    divided by what the kurtosis makes of it (Layard 1973, Robust large-sample tests for homogeneity
    of variances, JASA 68).

    Parameters
    ----------
    shares:
        c_k² of each reading, (n, k).
    left:
        Residuals, (n,).
    free:
        Share of each reading that the fit leaves free, (n,).
    least:
        Variance that no direction goes below.
    """
    if np.any(shares.T @ np.maximum(free, 0.0) < MIN_FREEDOM):
        return None
    kept = free > MIN_FREE
    shares, free = shares[kept], free[kept]
    square = np.square(left[kept]) / free
    felt = shares * square[:, None]
    others = (felt.sum(axis=0) - felt.max(axis=0)) / np.maximum(shares.sum(axis=0) - 1.0, TINY)
    if not np.any(square > least) or np.any(felt.max(axis=0) > FAR**2 * others):
        return None
    found = _fitted(shares, square, free, least)
    if found.max() < ALIKE**2 * found.min():
        return None
    # A false reading makes no direction loud: the test is of the others.
    size = square / (shares @ found)
    inner = np.argsort(size)[: len(size) - max(1, int(FALSE * len(size)))]
    return found if _chance(shares[inner], square[inner], free[inner], least) <= LEVEL else None


def _fitted(shares: Floats, square: Floats, free: Floats, least: float) -> Floats:
    """Variances of the directions (k,) by least squares on the squares, weighed by themselves.

    ``square``: squares of residuals over what is free of each.
    """
    found = np.full(shares.shape[1], float(free @ square) / float(free.sum()))
    for _ in range(ROUNDS):
        weight = np.sqrt(free) / (shares @ np.maximum(found, TINY))
        before, found = found, _not_negative(shares * weight[:, None], square * weight)
        found = np.maximum(found, max(least, found.max() / MAX_RATIO**2, TINY))
        if np.all(np.abs(found - before) <= SETTLED * found):
            break
    return np.asarray(found)


def _not_negative(columns: Floats, values: Floats) -> Floats:
    """Least squares (k,) of columns (n, k), none of them negative."""
    found, _, rank, _ = np.linalg.lstsq(columns, values, rcond=None)
    if rank == len(found) and np.all(found >= 0):
        return np.asarray(found)
    from scipy.optimize import nnls  # takes 0.1 s to load

    return np.asarray(nnls(columns, values)[0])


def _chance(shares: Floats, square: Floats, free: Floats, least: float) -> float:
    """Probability of readings like these where all directions scatter alike."""
    found = _fitted(shares, square, free, least)
    pooled = max(float(free @ square) / float(free.sum()), least, TINY)
    variance = shares @ found
    unit = square / variance
    statistic = float(free @ (np.log(pooled) + square / pooled - np.log(variance) - unit))
    excess = float(np.mean(unit**2) / np.maximum(np.mean(unit), TINY) ** 2) - 3.0
    return float(special.chdtrc(len(found) - 1, statistic / max(1.0, 1.0 + excess / 2.0)))
