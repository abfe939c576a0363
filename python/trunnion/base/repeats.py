"""Repeats of a reading on one grid: what they share of its error of rounding.

With noise of standard deviation s and steps of t their errors of rounding correlate by
(6/π²) Σ exp(-4π²k²s²/t²) / k², from the Fourier series of the sawtooth.
"""

import numpy as np

from trunnion.base.rows import where as where_true
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats, Integers

MAX_NOISE_STEPS = 1.0  # from here on errors of rounding are noise like any other

STEPS = np.linspace(0.0, MAX_NOISE_STEPS, 401)
"""Noise of a reading beside the rounding, in steps."""
_ORDERS = np.arange(1, 200)[:, None]
CORRELATION = (6 / np.pi**2) * np.sum(
    np.exp(-4 * np.pi**2 * _ORDERS**2 * STEPS**2) / _ORDERS**2, axis=0
)
"""Of the errors of rounding of repeats with so much noise."""
SCATTER = STEPS**2 + (1 - np.minimum(CORRELATION, 1.0)) / 12
"""Variance of such repeats about their mean, in squares of steps."""


def noise_beside(variance: float, scatter: Floats = SCATTER) -> float:
    """Noise beside the rounding of repeats with this variance about their mean, in steps.

    ``scatter``: variance for each noise of `STEPS`.
    """
    if variance < scatter[-1]:
        return float(np.interp(variance, scatter, STEPS))
    return float(np.sqrt(variance - 1 / 12))


def shared_variance(scatter: float, step: float) -> float:
    """Variance of the error of rounding that repeats with this variance about their mean share.

    It does not shrink with their number. 0: there is none, or as good as none.
    """
    if not step > 0:
        return 0.0
    noise = noise_beside(scatter / step**2)
    return step**2 / 12 * float(np.interp(noise, STEPS, np.minimum(CORRELATION, 1.0), right=0.0))


class Repeats:
    """Errors of readings of which repeats share a part; called, it makes them white.

    White readings keep the size of the readings.

    Parameters
    ----------
    variance, shared:
        Variance of each reading, and its covariance with its repeats, shape (n,).
    label:
        Equal for repeats, -1 for the others, shape (n,).
    """

    def __init__(self, variance: Floats, shared: Floats, label: Integers) -> None:
        self.variance, self.shared, self.label = variance, shared, label
        self._repeated = label >= 0
        self.rows = np.flatnonzero(self._repeated)
        self.index, self.count = repeated(label)
        own = np.where(label >= 0, variance - shared, variance)
        self.scale = np.sqrt(own)
        first = np.zeros(len(self.count), dtype=np.intp)
        first[self.index] = self.rows
        own, together = own[first], self.count * shared[first]
        self.shrink = 1 - np.sqrt(own / (own + together))

    def with_labels(self, label: Integers) -> "Repeats":
        """Return the same for other repeats."""
        return Repeats(self.variance, self.shared, label)

    def within(self, label: Integers) -> bool:
        """Whether all repeats of a reading have its label, (n,): columns keep to their rows."""
        own, first = label[self.rows], np.zeros(len(self.count), dtype=label.dtype)
        first[self.index] = own
        return bool(np.array_equal(first[self.index], own))

    def covariance(self, columns: Floats) -> Floats:
        """Return columns (n, k) times the covariance of the errors between them, shape (k, k)."""
        own = columns[self.rows] * np.sqrt(self.shared[self.rows])[:, None]
        together = np.zeros((len(self.count), columns.shape[1]))
        np.add.at(together, self.index, own)
        alone = self.scale**2
        return np.asarray(columns.T @ (columns * alone[:, None]) + together.T @ together)

    def __call__(self, columns: Floats) -> Floats:
        """Whiten columns (n, ...)."""
        flat = columns.reshape(len(columns), -1) / self.scale[:, None]
        if len(self.count) and len(columns) >= MANY_ROWS:
            # Each column by itself: columns lie in a row in memory.
            every, share = where_true(self._repeated), self.shrink / self.count
            for column in flat.T:
                own = column[every]
                column[every] = own - (share * np.bincount(self.index, own))[self.index]
        elif len(self.count):
            own = flat[self.rows]
            order = np.argsort(self.index, kind="stable")
            start = np.concatenate([[0], np.cumsum(self.count)[:-1]])
            total = np.add.reduceat(own[order], start, axis=0)
            flat[self.rows] = own - (total * (self.shrink / self.count)[:, None])[self.index]
        return np.asarray(flat.reshape(columns.shape))


def within_groups(label: Integers, groups: Integers) -> Integers:
    """Labels of repeats of one group, -1 for readings that have none there, (n,)."""
    both = np.where(label >= 0, label * (int(groups.max(initial=0)) + 1) + groups, -1)
    return several(np.unique(both, return_inverse=True)[1].reshape(-1) - int(np.any(both < 0)))


def several(label: Integers) -> Integers:
    """Keep the labels that several readings have."""
    if not np.any(label >= 0):
        return label
    count = np.bincount(label[label >= 0], minlength=int(label.max()) + 1)
    return np.where((label >= 0) & (count[np.maximum(label, 0)] > 1), label, -1)


def repeated(label: Integers) -> tuple[Integers, Integers]:
    """Group of each reading that repeats another, and how many each group has."""
    _, index, count = np.unique(label[label >= 0], return_inverse=True, return_counts=True)
    return index.reshape(-1), count
