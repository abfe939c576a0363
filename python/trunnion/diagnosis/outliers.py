"""Readings that belong to no model: a chip under the probe, a false trigger.

Heavy tails are no outliers. A reading is one only if it is too far out for the tail that the other
readings show: their noise is taken as Student's t, its degrees of freedom weighed by the
likelihood of the other readings, and the gap between it and them is compared with the gaps that
such noise leaves.
"""

import numpy as np
from scipy import special

from trunnion.base.rows import at_hand
from trunnion.base.units import Flags, Floats, Integers

OUTLIER_LEVEL = 0.01
SUSPECT_LEVEL = 0.05  # of readings that compete with a cause that is there already
ALONE = 0.1  # readings as far out as this one that the others' noise may make, of all n
FAR = 4.0  # times the noise that the others show
MIN_FREE = 0.05  # of a reading that the fit leaves free, for residuals per leverage
SAME_SCALE = 0.02  # relative difference of scales of the noise that are taken for one
CHECKED = 1e-6  # share of a reading that the others can check
MAX_SHARE = 0.2  # more than a fifth of the readings are no outliers
MAX_ASIDE = 200  # readings that are set aside one by one: each is a pass through all

# Degrees of freedom of the noise, evenly spread in 1/ν from normal to tails of ν = 2.5. The
# heavier, the less likely beforehand, down to impossible where the variance is infinite.
_NU = 1.0 / np.linspace(1e-3, 0.4, 12)
_BEFORE = np.log(1.0 - 2.0 / _NU)
_MAD = special.stdtrit(_NU, 0.75)  # median absolute deviation of each, per unit scale
_NORM = special.gammaln((_NU + 1) / 2) - special.gammaln(_NU / 2) - 0.5 * np.log(_NU * np.pi)


def robust_sizes(basis: Floats, values: Floats, floor: float = 0.0) -> Floats:
    """Residuals of a fit that a few readings cannot bend, each per its own spread, shape (n,).

    Least absolute deviations by reweighting, then Tukey's bisquare (c = 4.685) from there with the
    scale held at the median absolute deviation, then least squares of the readings that it uses.
    Each residual is divided by the spread that noise of 1 gives it there: less than 1 where the
    reading was used, more where it was not. ``basis``: orthonormal; ``floor``: least scale.
    """
    n, p = basis.shape
    r = _moments(basis, values, np.ones(n))[2]
    for _ in range(25):
        scale = max(np.median(np.abs(r)) / 0.6745, floor)
        if scale <= 0:
            break
        r_new = _moments(basis, values, 1.0 / np.maximum(np.abs(r), 0.05 * scale))[2]
        done = np.max(np.abs(r_new - r)) < 0.02 * scale
        r = r_new
        if done:
            break
    # p of the n absolute residuals vanish in this fit
    scale = max(np.median(np.sort(np.abs(r))[p:]) / 0.6745, floor)
    for _ in range(10):
        if scale <= 0:
            return np.abs(r)
        u = r / (4.685 * scale)
        r_new = _moments(basis, values, np.where(np.abs(u) < 1, (1 - u * u) ** 2, 1e-9))[2]
        done = np.max(np.abs(r_new - r)) < 0.02 * scale
        r = r_new
        if done:
            break
    return _per_spread(basis, values, np.abs(r) < 4.685 * scale)


def snooped_sizes(basis: Floats, values: Floats, floor: float = 0.0) -> Floats:
    """Residuals as `robust_sizes`, of the fit to what `one_by_one` leaves, shape (n,)."""
    used = np.ones(len(values), dtype=bool)
    used[one_by_one(basis, values, floor)] = False
    return _per_spread(basis, values, used)


def _moments(basis: Floats, values: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """Normal equations of a weighted fit (p, p), (p,), and its residuals (n,)."""
    n, p = basis.shape
    gram, right = np.zeros((p, p)), np.zeros(p)
    for some in at_hand(n):
        heavy = (basis[some] * weights[some, None]).T
        gram += heavy @ basis[some]
        right += heavy @ values[some]
    solution = np.linalg.lstsq(gram, right, rcond=None)[0]
    return gram, right, np.asarray(values - basis @ solution)


def _per_spread(basis: Floats, values: Floats, used: Flags) -> Floats:
    """Residuals of the fit to some readings, of all, each over the spread that noise of 1 gives it.

    A reading of which the others say nothing has none.
    """
    gram, right, _ = _moments(basis, values, used.astype(np.float64))
    share, along = np.linalg.eigh(gram)
    known = share > CHECKED
    seen = along[:, known] / np.sqrt(share[known])
    unseen = along[:, ~known]
    size = np.zeros(len(values))
    for some in at_hand(len(values)):
        white = basis[some] @ seen
        leverage = np.einsum("ij,ij->i", white, white)
        checked = np.linalg.norm(basis[some] @ unseen, axis=1) ** 2 <= CHECKED
        r = np.abs(values[some] - white @ (seen.T @ right))
        free = np.where(used[some], np.maximum(1.0 - leverage, MIN_FREE), 1.0 + leverage)
        size[some] = np.where(checked, r / np.sqrt(free), 0.0)
    return size


def far_out(size: Floats, dof: float, floor: float = 0.0, level: float = OUTLIER_LEVEL) -> Integers:
    """Find readings that are too far out for the noise of the others (indices).

    ``size``: absolute residuals of a robust fit per their spread, shape (n,); ``dof``: degrees of
    freedom of the fit; ``floor``: least noise of a reading.

    The k largest are a group that stands off if noise of the others gives k readings beyond the
    largest of the others, but hardly k beyond the least of the group. Tails themselves leave gaps
    (Rényi): for a known noise this chance is evenly spread from 0 to 1 for each k. Groups of k are
    tested at a share of 1/k² - 1/(k + 1)² of the level, which add up to it.
    """
    n = len(size)
    order = np.argsort(-size)
    ordered = size[order]
    noise = _Noise(ordered, dof / n)
    for k in range(min(int(MAX_SHARE * n), n - 5), 0, -1):
        x, others = ordered[k - 1], ordered[k:]
        mad = 0.5 * (others[(len(others) - 1) // 2] + others[len(others) // 2])  # they are in order
        mad = max(mad, 0.6745 * floor)
        if mad <= 0 or x < 3.5 * mad / 0.6745:
            continue
        scale = mad / _MAD
        bulk = noise.likelihood(k, mad)
        beyond, tail = _log_tail(others[0] / scale), _log_tail(x / scale)
        chance = _weights(bulk + k * beyond * (dof / n)) @ np.exp(k * (tail - beyond))
        if chance < level * (1.0 / k**2 - 1.0 / (k + 1) ** 2):
            # each alone, for the noise that the others show
            alone = 2 * special.stdtr(_NU, -ordered[:k, None] / scale) @ _weights(bulk)
            return np.sort(order[:k][n * alone < ALONE])
    return np.zeros(0, dtype=np.intp)


class _Noise:
    """How likely each kind of noise makes all but the k largest of some readings."""

    def __init__(self, ordered: Floats, share: float) -> None:
        self.ordered = ordered
        self.share = share  # of them, that are independent
        self.mad = np.inf

    def likelihood(self, k: int, mad: float) -> Floats:
        """Logarithm of it with what was supposed beforehand; many sizes share a scale."""
        if not abs(mad / self.mad - 1.0) < SAME_SCALE:
            self.mad = mad
            self.beyond = np.zeros((len(self.ordered) + 1, len(_NU)))
            t = self.ordered[:, None] / (mad / _MAD)
            np.cumsum((_NU + 1) / 2 * np.log1p(t * t / _NU), axis=0, out=self.beyond[1:])
        density = (len(self.ordered) - k) * (_NORM - np.log(mad / _MAD))
        return np.asarray(_BEFORE + self.share * (density - self.beyond[-1] + self.beyond[k]))


def _log_tail(t: Floats) -> Floats:
    """Logarithm of the chance of a reading at least so far out, of each noise."""
    return np.asarray(np.log(np.maximum(2 * special.stdtr(_NU, -t), 1e-300)))


def one_by_one(design: Floats, values: Floats, floor: float = 0.0) -> Integers:
    """Set aside, each time, the reading that the others miss most (indices, MAX_ASIDE at most).

    Baarda's data snooping, then back: a reading stays aside only if those set aside with it do not
    make it ordinary. Residuals are taken per leverage, so that a reading which the fit follows is
    found before those that it bends; a robust fit may take it for a good one. ``design`` is
    orthonormal, shape (n, p), and ``values`` orthogonal to it; ``floor``: least noise of a reading.
    """
    n = len(values)
    shifts = np.zeros((n, 0))  # orthonormal, what the readings set aside may change
    r = values
    free = 1.0 - np.einsum("ij,ij->i", design, design)
    left = np.ones(n, dtype=bool)
    aside: list[int] = []
    for _ in range(min(int(MAX_SHARE * n), n - design.shape[1] - 5, MAX_ASIDE)):
        size = np.abs(r) / np.sqrt(np.maximum(free, CHECKED))
        size[free < CHECKED] = 0.0
        i = int(np.argmax(size))
        if size[i] < FAR * max(np.median(size[left]) / 0.6745, floor):
            break
        aside.append(i)
        left[i] = False
        column = -design @ design[i] - shifts @ shifts[i]
        column[i] += 1.0
        unit = column / np.sqrt(column[i])
        shifts = np.column_stack([shifts, unit])
        r = r - unit * (unit @ r)
        free = free - unit * unit
    sigma = max(np.sqrt(r @ r / max(n - design.shape[1] - len(aside), 1)), floor)
    while aside:
        bent = -design @ design[aside].T
        bent[aside, np.arange(len(aside))] += 1.0
        shifts, moments = np.linalg.qr(bent)
        inverse = np.linalg.inv(moments)
        found = np.abs(inverse @ (shifts.T @ values)) / np.linalg.norm(inverse, axis=1)
        least = int(np.argmin(found))
        if found[least] > FAR * sigma:
            break
        del aside[least]
    return np.sort(np.asarray(aside, dtype=np.intp))


def _weights(log_likelihood: Floats) -> Floats:
    w = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(w / w.sum())


def outlier_penalty(n: int, level: float = OUTLIER_LEVEL) -> float:
    """Penalty of taking one of n readings out, on the scale of the penalties of causes."""
    return float(special.chdtri(1, level / n))
