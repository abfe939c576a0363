"""Readings that belong to no model: a chip under the probe, a false trigger.

Heavy tails are no outliers. A reading is one only if it is too far out for the tail that the other
readings show: their noise is taken as Student's t, its degrees of freedom weighed by the
likelihood of the other readings, and the gap between it and them is compared with the gaps that
such noise leaves.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import TypeAlias

import numpy as np
from scipy import special

from trunnion.base.rows import at_hand
from trunnion.base.statistics import NORMAL_MEDIAN
from trunnion.base.units import Flags, Floats, Integers

Sizes: TypeAlias = Callable[[Floats, Floats, float], Floats]

OUTLIER_LEVEL = 0.01
SUSPECT_LEVEL = 0.05  # of readings that compete with a cause that is there already
ALONE = 0.1  # readings as far out as this one that the others' noise may make, of all n
FAR = 4.0  # times the noise that the others show
MIN_FREE = 0.05  # of a reading that the fit leaves free, for residuals per leverage
SAME_SCALE = 0.02  # relative difference of scales of the noise that are taken for one
CHECKED = 1e-6  # share of a reading that the others can check
MIN_DOF = 5  # degrees of freedom from which outliers can be found
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
    r = _left(basis, values, np.ones(n))
    for _ in range(25):
        scale = max(_median(np.abs(r)) / NORMAL_MEDIAN, floor)
        if scale <= 0:
            break
        r_new = _left(basis, values, 1.0 / np.maximum(np.abs(r), 0.05 * scale))
        done = np.max(np.abs(r_new - r)) < 0.02 * scale
        r = r_new
        if done:
            break
    # p of the n absolute residuals vanish in this fit
    scale = max(_median(np.sort(np.abs(r))[p:]) / NORMAL_MEDIAN, floor)
    for _ in range(10):
        if scale <= 0:
            return np.abs(r)
        u = r / (4.685 * scale)
        r_new = _left(basis, values, np.where(np.abs(u) < 1, (1 - u * u) ** 2, 1e-9))
        done = np.max(np.abs(r_new - r)) < 0.02 * scale
        r = r_new
        if done:
            break
    return _per_spread(basis, values, np.abs(r) < 4.685 * scale)


def _median(values: Floats) -> float:
    """Median of numbers (n,): numpy's asks for axes and for nan, each time of a few hundred."""
    low, high = (len(values) - 1) // 2, len(values) // 2
    middle = np.partition(values, (low, high))
    return float((middle[low] + middle[high]) / 2.0)


def snooped_sizes(basis: Floats, values: Floats, floor: float = 0.0) -> Floats:
    """Residuals as `robust_sizes`, of the fit to what `one_by_one` leaves, shape (n,)."""
    used = np.ones(len(values), dtype=bool)
    used[one_by_one(basis, values, floor)] = False
    return _per_spread(basis, values, used)


def _left(basis: Floats, values: Floats, weights: Floats) -> Floats:
    """Residuals (n,) of a fit by weights above zero, which leave no direction of the basis out."""
    gram, right = _moments(basis, values, weights)
    try:
        solution = np.linalg.solve(gram, right)
    except np.linalg.LinAlgError:  # weights too far apart for the numbers
        solution = np.linalg.lstsq(gram, right, rcond=None)[0]
    return np.asarray(values - basis @ solution)


def _moments(basis: Floats, values: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Normal equations of a weighted fit (p, p), (p,)."""
    n, p = basis.shape
    gram, right = np.zeros((p, p)), np.zeros(p)
    for some in at_hand(n):
        root = np.sqrt(weights[some])
        heavy = basis[some] * root[:, None]
        gram += heavy.T @ heavy  # symmetric: half of the work
        right += (values[some] * root) @ heavy
    return gram, right


def _per_spread(basis: Floats, values: Floats, used: Flags) -> Floats:
    """Residuals of the fit to some readings, of all, each over the spread that noise of 1 gives it.

    A reading of which the others say nothing has none.
    """
    gram, right = _moments(basis, values, used.astype(np.float64))
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


def far_out_beside(
    basis: Floats,
    values: Floats,
    floor: float,
    level: float = OUTLIER_LEVEL,
    sizes: Callable[[Sizes], Floats] | None = None,
) -> Integers:
    """Find readings far out beside a fit (indices).

    ``basis``: orthonormal, of all that is fitted, (n, p); ``values``: what it leaves, (n,);
    ``floor``: least noise of a reading; ``sizes``: their sizes by a function, where they are kept.
    """
    n, p = basis.shape
    sizes = sizes or (lambda of: of(basis, values, floor))
    leverage = np.einsum("ij,ij->i", basis, basis)
    size = np.abs(values) / np.sqrt(np.maximum(1 - leverage, MIN_FREE))
    typical = max(np.median(size) / NORMAL_MEDIAN, floor)
    if n - p < MIN_DOF or typical <= 0 or size.max() < FAR * typical:
        return np.zeros(0, dtype=np.intp)
    far = far_out(sizes(robust_sizes), n - p, floor, level)
    if len(far):
        return far
    # A robust fit may follow a bad reading that weighs much.
    return far_out(sizes(snooped_sizes), n - p, floor, level)


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
    for group in _groups(ordered, floor, level):
        k, scale = group.count, group.mad / _MAD
        bulk = noise.likelihood(group)
        beyond, tail = _log_tail(ordered[k] / scale), _log_tail(ordered[k - 1] / scale)
        chance = _weights(bulk + k * beyond * (dof / n)) @ np.exp(k * (tail - beyond))
        if chance < group.level:
            # each alone, for the noise that the others show
            alone = 2 * special.stdtr(_NU, -ordered[:k, None] / scale) @ _weights(bulk)
            return np.sort(order[:k][n * alone < ALONE])
    return np.zeros(0, dtype=np.intp)


@dataclass(frozen=True, slots=True)
class _Group:
    """The largest readings, as many as stand off perhaps.

    ``mad``: median of the others; ``about``: one that is about the same, which many groups share;
    ``level``: at which the group is tested.
    """

    count: int
    mad: float
    about: float
    level: float


def _groups(ordered: Floats, floor: float, level: float) -> Iterator[_Group]:
    """Groups of readings, in order of size, that some kind of noise makes seldom; large ones first.

    The noise that makes a group most seldom leaves no more than a few to be weighed against each
    other.
    """
    n = len(ordered)
    count = np.arange(min(int(MAX_SHARE * n), n - 5), 0, -1)
    others = n - count
    mad = 0.5 * (ordered[count + (others - 1) // 2] + ordered[count + others // 2])
    mad = np.maximum(mad, NORMAL_MEDIAN * floor)
    far = (mad > 0) & (ordered[count - 1] >= 3.5 * mad / NORMAL_MEDIAN)
    count, mad = count[far], mad[far]
    about = np.array(list(accumulate(mad.tolist(), _same_scale)))
    beyond, tail = (_log_tail(ordered[at, None] / mad[:, None] * _MAD) for at in (count, count - 1))
    own_level = level * (1.0 / count**2 - 1.0 / (count + 1) ** 2)
    seldom = np.exp(count * np.min(tail - beyond, axis=1)) < own_level
    for one in zip(*(x[seldom].tolist() for x in (count, mad, about, own_level)), strict=True):
        yield _Group(*one)


def _same_scale(about: float, mad: float) -> float:
    """Return the first scale where the second is about the same, else the second."""
    return about if abs(mad / about - 1.0) < SAME_SCALE else mad


class _Noise:
    """How likely each kind of noise makes all but the k largest of some readings."""

    def __init__(self, ordered: Floats, share: float) -> None:
        self.ordered = ordered
        self.share = share  # of them, that are independent
        self.about = np.inf

    def likelihood(self, group: _Group) -> Floats:
        """Logarithm of it with what was supposed beforehand."""
        if group.about != self.about:
            self.about = group.about
            self.beyond = np.zeros((len(self.ordered) + 1, len(_NU)))
            t = self.ordered[:, None] / (self.about / _MAD)
            np.cumsum((_NU + 1) / 2 * np.log1p(t * t / _NU), axis=0, out=self.beyond[1:])
        density = (len(self.ordered) - group.count) * (_NORM - np.log(group.mad / _MAD))
        beyond = self.beyond[group.count]
        return np.asarray(_BEFORE + self.share * (density - self.beyond[-1] + beyond))


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
    n, p = design.shape
    r, free = values, 1.0 - np.einsum("ij,ij->i", design, design)
    cofactor = np.eye(p)  # of the fit to those left
    aside: list[int] = []
    for _ in range(min(int(MAX_SHARE * n), n - p - 5, MAX_ASIDE)):
        size = np.abs(r) / np.sqrt(np.maximum(free, CHECKED))
        size[free < CHECKED] = 0.0
        i = int(np.argmax(size))
        typical = size[i] / FAR
        if typical < floor or _median_beyond(size, n - len(aside), NORMAL_MEDIAN * typical):
            break
        aside.append(i)
        # What the fit to those left makes of a change of this reading, without it: rank one.
        way = cofactor @ design[i]
        bent = -(design @ way)
        bent[i] += 1.0
        bent[aside[:-1]] = 0.0
        own = bent[i]
        cofactor += np.outer(way, way) / own
        r = r - bent * (r[i] / own)
        free = free - bent * (bent / own)
        r[i] = free[i] = 0.0
    sigma = max(np.sqrt(r @ r / max(n - p - len(aside), 1)), floor)
    return _without_ordinary(design, values, aside, sigma)


def _median_beyond(size: Floats, count: int, limit: float) -> bool:
    """Whether the median of so many of some numbers, the largest, is larger than a limit."""
    larger = 2 * int(np.count_nonzero(size > limit))
    if larger == count:  # the limit lies between the two in the middle
        return bool(np.median(np.sort(size)[-count:]) > limit)
    return larger > count


def _without_ordinary(design: Floats, values: Floats, aside: list[int], sigma: float) -> Integers:
    """Take back the readings that those set aside with them make ordinary (indices that stay).

    Each time the one whose change, estimated with those of the others, is least for its spread.
    """
    at = np.asarray(aside, dtype=np.intp)
    cofactor = np.linalg.inv(np.eye(len(at)) - design[at] @ design[at].T)
    change = cofactor @ values[at]
    while len(at):
        spread = np.diag(cofactor)
        found = np.abs(change) / np.sqrt(spread)
        least = int(np.argmin(found))
        if found[least] > FAR * sigma:
            break
        stay = np.arange(len(at)) != least
        column = cofactor[stay, least] / spread[least]
        change = change[stay] - column * change[least]
        cofactor = cofactor[np.ix_(stay, stay)] - np.outer(column, cofactor[least, stay])
        at = at[stay]
    return np.sort(at)


def _weights(log_likelihood: Floats) -> Floats:
    w = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(w / w.sum())


def outlier_penalty(n: int, level: float = OUTLIER_LEVEL) -> float:
    """Penalty of taking one of n readings out, on the scale of the penalties of causes."""
    return float(special.chdtri(1, level / n))
