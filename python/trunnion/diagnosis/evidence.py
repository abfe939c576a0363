"""How well sets of causes explain readings, mean over all sizes that their causes may have.

The probability of a set is its mean likelihood times what is assumed of it beforehand (Kass and
Raftery 1995, Bayes factors). A cause acts with odds of one among all candidates. Its size, the root
of the sum of squares of what it changes in the readings, is from the least that is seen (the root
of what a cause has to gain, `.candidates.Candidates.chance`) to `RANGE` times as large,
logarithmically uniform and in any direction of its columns; a nonlinear parameter is any value of
its grid. Over that of the best sizes the mean likelihood of causes j with columns of unit length is
(Laplace's approximation) ::

    Π I_j · sqrt(|C| / Π |C_j|)

C: covariance of their sizes together, C_j: of one beside the others, I_j: the mean over the sizes
of one, that of a normal distribution about its estimate. So causes that cancel, of sizes many times
what they explain together, and causes of many columns are worth what they leave to chance.

A term of structure is weighed as a cause is: of one among all terms, and of sizes as they are. Were
its sizes free, it would take the place of causes of the same columns that are large.

Where the model says so (`.model.Model.together`) these odds are the mean: how often causes act is
not known, and one that acts makes others likelier (a beta-binomial prior, Scott and Berger 2010,
Bayes and empirical-Bayes multiplicity adjustment). Structure without a name is one that acts. That
matters where readings hardly say which.

Nor is it known then how large causes may be: the range of their sizes is from `LEAST_RANGE` to
`RANGE`, logarithmically uniform and one for all causes of a set. With the widest range alone most
causes would be larger than what others hide, and one that they may hide would be excluded.

Causes that are expected have their penalty instead: nothing is assumed of their sizes.

Sets by which readings in steps are equally probable have equal odds: a bow of a rail rounds to what
a kink does, and how wide the sizes are that do so says nothing of which of them is there.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.candidates import NAMING_LEVEL
from trunnion.diagnosis.selection import TINY, Search
from trunnion.diagnosis.supposed import Supposed

RANGE = 100.0  # of the sizes of a cause: the largest over the least that is seen
LEAST_RANGE = 10.0  # of these ranges, where they are not known: errors differ by a decade at least
SIZES = np.geomspace(1.0, RANGE, 33)  # of a cause, over the least
WIDEST = np.array([len(SIZES)])  # how many of the sizes are in the range
RANGES = 1 + np.rint((len(SIZES) - 1) * np.linspace(math.log(LEAST_RANGE, RANGE), 1, 5)).astype(int)
FAR = 8.0  # standard errors: the likelihood of larger sizes is narrow beside the range
NEGLIGIBLE = 14.0  # of -2 ln of the odds against the best set: less than 0.1 %
AT_ONCE = 256  # sets
TO_WEIGH = 20.0  # above the best score, to which sets are weighed


@dataclass(frozen=True)
class Evidence:
    """How well the sets of a search explain, with what is assumed of them beforehand.

    Attributes
    ----------
    search:
        The sets.
    supposed:
        What acts beside the sets that are weighed then: those that hold a candidate.
    best:
        The best score of all sets, of other searches too: those far above it weigh nothing.
    acting:
        How many processes act beside all sets.
    """

    search: Search
    supposed: Supposed | None = None
    best: float = math.inf
    acting: int = 0

    @cached_property
    def values(self) -> Mapping[int, float]:
        """-2 ln of the mean likelihood of sets times what is assumed of them, by their masks."""
        s, near = self.search, self.near
        self._weigh(near.values())
        known, of_variants = self._known
        rough = {m: known[b] + s.more.get(m, 0.0) for m, b in near.items() if b in known}
        out: dict[int, float] = {}
        least = math.inf
        ordered = sorted(rough.items(), key=lambda one: one[1])
        while ordered and ordered[0][1] <= least + NEGLIGIBLE:
            # The likeliest says how far; then many at once.
            count = AT_ONCE if out else 1
            some, ordered = ordered[:count], ordered[count:]
            some = [(mask, value) for mask, value in some if value <= least + NEGLIGIBLE]
            fresh = [near[mask] for mask, _ in some if near[mask] not in of_variants]
            of_variants |= zip(fresh, self._of_variants(fresh).tolist(), strict=True)
            out |= {mask: value + of_variants[near[mask]] for mask, value in some}
            least = min(out.values())
        same = [mask for mask in s.alike if mask in out]
        if same:  # only what was assumed beforehand distinguishes them
            out |= dict.fromkeys(same, float(np.mean([out[mask] for mask in same])))
        return out

    @cached_property
    def near(self) -> dict[int, tuple[int, ...]]:
        """Masks and blocks of the sets that are near the best score."""
        s, open_ = self.search, self.supposed
        most = min(s.best, self.best) + TO_WEIGH
        near = {
            mask: tuple(sorted(s.made[mask])) for mask, score in s.scores.items() if score <= most
        }
        if open_ is None:
            return near
        some = {mask: blocks for mask, blocks in near.items() if open_.within(mask)}
        every = itertools.chain.from_iterable(
            open_.fewer(mask, blocks) for mask, blocks in some.items()
        )
        return dict(every) | some

    @cached_property
    def _known(self) -> tuple[dict[tuple[int, ...], float], dict[tuple[int, ...], float]]:
        """What is known of sets, by their blocks: at the best values, and by all of grids."""
        s = self.search
        return (s.at_best, s.of_variants) if self.supposed is None else ({}, {})

    def _weigh(self, sets: Iterable[tuple[int, ...]]) -> None:
        """Find the odds of sets that are not known, at their values of nonlinear parameters.

        Of those that are not larger than the readings allow.
        """
        s = self.search
        rank = s.c.rank.tolist()
        known = self._known[0]
        if self.supposed is None and () not in known:
            rss = max(s.empty.core.rss, s.score.least)
            known[()] = float(s.score.floor.deviance(rss, s.c.dof))
        fresh = [
            one for one in sets if one not in known and sum(rank[b] for b in one) < s.c.dof - 2
        ]
        if fresh:
            known |= dict(zip(fresh, self._at_best(fresh).tolist(), strict=True))

    @cached_property
    def _assumed(self) -> tuple[Floats, Floats, Floats]:
        """Of each block the least size that is seen, what it costs beforehand, and its penalty.

        The latter of blocks that have a penalty only, else 0, and the reverse; shapes (b,).
        """
        c = self.search.c
        free = c.penalty == 0
        chance = c.chance
        # what is gained by chance may be more
        own = c.penalty - chance - 2 * np.log(c.level / NAMING_LEVEL)[c.owner]
        cost = np.where(free, c.penalty, 0.0)  # that of a cause which must explain may be inf
        return np.where(free, 0.0, np.sqrt(chance)), np.where(free, 0.0, own), cost

    def _at_best(self, sets: Sequence[tuple[int, ...]]) -> Floats:
        """-2 ln of the odds of sets, at their values of the nonlinear parameters, shape (s,)."""
        s, c = self.search, self.search.c
        count = np.array([len(one) for one in sets])
        blocks = np.fromiter(itertools.chain.from_iterable(sets), np.intp, count.sum())
        of = np.repeat(np.arange(len(sets)), count)  # the set of each block

        def summed(values: Floats | Integers) -> Floats:
            return np.asarray(np.bincount(of, values, len(sets)), dtype=np.float64)

        least, prior, penalty = (x[blocks] for x in self._assumed)
        rank = c.rank[blocks]
        size, paid = summed(rank), summed(rank * (least > 0))
        open_ = self.supposed
        cost = 0.0 if open_ is None else open_.cost
        gain, together, each, length = (open_ or s).sizes(sets, self._assumed[0] > 0)
        rss = np.maximum(s.empty.core.rss - gain, s.score.least)
        sigma = np.sqrt(np.maximum(s.score.floor.noise(rss, c.dof - size), TINY))[of]
        out = s.score.floor.deviance(rss, c.dof) + cost + summed(prior) - together
        out = out + summed(penalty) * c.dof / (c.dof - size / 2 - 1)
        ranges = RANGES if c.together else WIDEST
        likely = np.zeros((len(ranges), len(blocks)))
        for k in np.unique(rank[least > 0]).tolist():
            own = (rank == k) & (least > 0)
            error = np.exp(each[own] / (2 * k))
            likely[:, own] = _log_mean_likelihood(
                length[own] / sigma[own], error, k, least[own], ranges
            )
        out = out + summed(np.where(least > 0, each, 0.0))
        out = out - 2 * _log_mean(np.stack([summed(one) for one in likely]))
        if c.together:
            acting = self.acting + summed((least > 0).astype(np.intp))
            out = out - 2 * log_odds_together(c.multiplicity, acting)
        if c.stated:
            many = zip(sets, rss.tolist(), size.tolist(), strict=True)
            out = out + [s.contradicting(one, left, int(wide)) for one, left, wide in many]
        return np.asarray(out + _of_unknown_noise(c.dof, paid))

    def _of_variants(self, sets: Sequence[tuple[int, ...]]) -> Floats:
        """What sets cost of which the nonlinear parameters may have any value of their grids."""
        s, c = self.search, self.search.c
        source = self.supposed or s.reach
        c.prepare(b for blocks in sets for b in blocks)
        found = [(i, one) for i, blocks in enumerate(sets) for one in source.at_variants(blocks)]
        if not found:
            return np.zeros(len(sets))
        at, count, rss = (
            np.concatenate(x) for x in zip(*((x.at, x.count, x.rss) for _, x in found), strict=True)
        )
        first = np.cumsum(count) - count
        deviance = s.score.floor.deviance(np.maximum(rss, s.score.least), c.dof)
        likely = np.exp((np.repeat(deviance[first + at], count) - deviance) / 2)
        of = np.repeat([i for i, _ in found], [len(x.at) for _, x in found])
        if c.positive:
            positive = [not c.positive.isdisjoint(s.owner[b] for b in blocks) for blocks in sets]
            # what explains more than the values that were found has a cause of the wrong sign
            likely[np.repeat(np.array(positive)[of], count) & (likely > 1.0)] = 0.0
        mean = np.add.reduceat(likely, first) / count
        return np.asarray(
            np.bincount(of, -2 * np.log(np.maximum(mean, TINY)), len(sets)), dtype=np.float64
        )


def log_odds_together(candidates: float, count: Floats | Integers | int) -> Floats:
    """Logarithm of the odds of so many causes together, over those if each acted by itself.

    The latter are one among all candidates for each; the chance that one acts is not known, beta
    distributed with a = 1 and b = ``candidates``.
    """
    n = np.maximum(candidates, np.maximum(count, 1))  # some may have odds of their own
    together = special.betaln(1.0 + count, 2 * n - count) - special.betaln(1.0, 2 * n)
    return np.asarray(together - count * np.log(1 / n))


def _of_unknown_noise(dof: int, columns: Floats) -> Floats:
    """What the likelihood, mean over the noise too, adds to -2 ln of that of the best noise."""
    more = dof - columns
    of_all = special.gammaln(dof / 2) - special.gammaln(more / 2)
    return np.asarray(2 * of_all - columns * np.log(more / 2))


def _log_mean_of_directions(x: Floats, columns: int) -> Floats:
    """Logarithm of the mean of exp(x cos a - x) over all directions of vectors of so many columns.

    A Bessel function, of few columns one of a simpler form; x is not negative.
    """
    if columns == 1:
        return np.asarray(np.log1p(np.exp(-2 * x)) - math.log(2))
    order, x = columns / 2 - 1, np.maximum(x, 1e-9)
    if columns == 2:
        return np.asarray(np.log(special.i0e(x)))
    if columns == 3:
        return np.asarray(np.log(-np.expm1(-2 * x) / (2 * x)))
    turned = special.i1e(x) if columns == 4 else special.ive(order, x)
    mean = np.log(np.maximum(turned, TINY)) + order * np.log(2 / x) + math.lgamma(columns / 2)
    # it underflows far below its order
    return np.where(turned > TINY, mean, x**2 / (2 * columns) - x)


def sizes_assumed(together: bool) -> Floats:
    """Probability of each of `SIZES` of a cause, mean over the ranges that they may have."""
    ranges = RANGES if together else WIDEST
    return np.asarray(np.mean((np.arange(len(SIZES)) < ranges[:, None]) / ranges[:, None], axis=0))


def _log_mean(ln: Floats) -> Floats:
    """Logarithm of the mean over the first axis of what has the logarithms ``ln``."""
    largest = ln.max(axis=0)
    return np.asarray(largest + np.log(np.mean(np.exp(ln - largest), axis=0)))


def _log_mean_likelihood(
    size: Floats, error: Floats, columns: int, least: Floats, ranges: Integers
) -> Floats:
    """Logarithm of the mean over the sizes of causes of the likelihood over that of the best.

    Of each range, (r, s). size, error: estimate, the length of a vector of so many columns, and the
    standard error of each; least: that is seen. All in standard deviations of the noise. ranges:
    how many of `SIZES` are in each.
    """
    of_sphere = math.lgamma(columns / 2)
    area = math.log(2) + columns / 2 * math.log(math.pi) - of_sphere
    volume = columns * np.log(math.sqrt(2 * math.pi) * error / np.maximum(size, TINY))
    largest = SIZES[ranges - 1][:, None]
    out = volume - area - np.log(np.log(largest))
    # what is larger than the widest range is a cause all the same
    out = np.where((size > largest * least) & (largest < RANGE), -np.inf, out)
    near = (size <= FAR * error) | (size <= least + 3 * error)
    if near.any():
        b, e = size[near, None], error[near, None]
        sizes = least[near, None] * SIZES
        ln = _log_mean_of_directions(sizes * b / e**2, columns) - (sizes - b) ** 2 / (2 * e**2)
        best = ln.max(axis=1, keepdims=True)
        upto = np.cumsum(np.exp(ln - best), axis=1)[:, ranges - 1] / ranges
        out[:, near] = (best + np.log(np.maximum(upto, TINY))).T
    return np.asarray(out)
