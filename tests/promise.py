"""Promises of rates, and how many runs it takes to hold them.

A test of a promised rate must fail when the rate has fallen. `needed_runs` says how many runs it
takes that a true rate ten points below the promise fails in at least 90 % of cases, while one that
is as promised fails in at most 1 %; `kept` refuses to judge with fewer.
"""

from functools import cache

from scipy import stats

RISK = 0.01
"""Chance that a rate as promised fails."""
POWER = 0.90
"""Chance that a rate `DROP` below the promise fails."""
DROP = 0.10


def smallest_count(promise: float, runs: int) -> int:
    """Return the count of good runs below which a rate as promised falls in at most `RISK`."""
    return int(stats.binom.ppf(RISK, runs, promise))


@cache
def needed_runs(promise: float) -> int:
    """Return the smallest number of runs from which a drop is seen with the stated power."""

    def power(runs: int) -> float:
        return float(stats.binom.cdf(smallest_count(promise, runs) - 1, runs, promise - DROP))

    # The power saws up and down with the runs: from the number returned on it stays above.
    below = [runs for runs in range(1, 1000) if power(runs) < POWER]
    return max(below) + 1


def kept(good: int, runs: int, promise: float) -> bool:
    """Whether this many good runs keep the promise of a rate."""
    assert runs >= needed_runs(promise), (
        f"{runs} runs hold nothing of a promise of {promise:.0%}: {needed_runs(promise)} would"
    )
    return good >= smallest_count(promise, runs)
