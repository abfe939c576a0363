"""How much readings scatter by the direction in which they feel a disturbance.

A reading that feels the components c_k of independent disturbances of k directions has the variance
sum of c_k² v_k. The v are fitted to squared residuals, each weighed by the variance that it has.
"""

import numpy as np
from scipy import special
from scipy.optimize import nnls

from trunnion.base.units import Floats

LEVEL = 1e-2  # of the test of equal variances
MAX_RATIO = 10.0  # of the scatter of two directions, that is allowed for
ROUNDS = 20
SETTLED = 1e-3
TINY = 1e-300


def variances_by_direction(
    shares: Floats, square: Floats, free: Floats, least: float = 0.0
) -> Floats | None:
    """Return the variance of each direction (k,); None: they are all alike.

    A test of the likelihood says so at the level `LEVEL`, allowing for tails: its statistic is
    divided by what the kurtosis makes of it (Layard 1973, Robust large-sample tests for homogeneity
    of variances, JASA 68).

    Parameters
    ----------
    shares:
        c_k² of each reading, (n, k).
    square:
        Squares of residuals over what the fit leaves free of each reading, (n,).
    free:
        That share, above 0, (n,).
    least:
        Variance that no direction goes below.
    """
    pooled = float(free @ square) / float(free.sum())
    found = np.full(shares.shape[1], pooled)
    for _ in range(ROUNDS):
        weight = np.sqrt(free) / (shares @ found)
        before, found = found, nnls(shares * weight[:, None], square * weight)[0]
        found = np.maximum(found, max(least, found.max() / MAX_RATIO**2, TINY))
        if np.all(np.abs(found - before) <= SETTLED * found):
            break
    variance = shares @ found
    unit = square / variance
    statistic = float(free @ (np.log(pooled) + square / pooled - np.log(variance) - unit))
    excess = float(np.mean(unit**2) / np.mean(unit) ** 2) - 3.0
    chance = special.chdtrc(len(found) - 1, statistic / max(1.0, 1.0 + excess / 2.0))
    return found if chance <= LEVEL else None
