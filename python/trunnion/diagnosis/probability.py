"""How probable the sets of causes are that a search looked at.

A set S has its evidence as weight: its mean likelihood over all sizes that its causes may have,
times the odds that they have beforehand (:mod:`.evidence`). Sets are identified by the causes of
the catalogue that act in them, with or without unexplained structure beside these; the weights of
all sets that the search looked at, of the plain model (no cause) and of structure without a cause
add up to 1. Candidates that change the readings alike share their sets' weights evenly.

Beside others that would make about the same of the readings (a cubic in time beside a drift, a
tilt beside a taper) a cause that is large enough to be seen by itself need not be seen. Readings
say little of it, and it keeps the odds that it has beforehand, one among all candidates, times the
mean likelihood of its sizes, even where the search did not look at it, or not at it again because
nothing determines its size.

The constant of a smooth curve without a name (the mean of a drift, beside the length of a ball-bar)
may be all that is seen of a cause: the weight of a set is shared with that without it, by the mean
likelihood of its sizes as far as they are known (:func:`chance_in_doubt`).

An effect that may hide behind others (:attr:`.effect.Effect.least`) is supposed and not fitted: its
sets have the weight of the likelihood times the odds of one more cause beforehand.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy import special

from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import NAMING_LEVEL, Candidates
from trunnion.diagnosis.evidence import (
    RANGE,
    SIZES,
    Evidence,
    log_odds_together,
    sizes_assumed,
)
from trunnion.diagnosis.scorer import SCORE_DIGITS
from trunnion.diagnosis.selection import TINY, WITHIN, Found, Search
from trunnion.diagnosis.supposed import Supposed

Members = frozenset[int]

NEAR_ODDS = 5.0  # of the likeliest set of a good score over one that may be instead of it
OVERRULED = 10.0  # of the likeliest set of all over that of a good score, which it replaces
HIDDEN = 0.25  # left of a squared unit column, below which a set hides a cause
MIN_WEIGHT = 0.01  # of a set, by which causes are asked for that it hides


@dataclass(frozen=True)
class Behind:
    """A set with an effect behind it: its candidates, the one behind, the distance to the best.

    Without one behind, None, all of its causes are paid for in the distance.
    """

    members: Members
    behind: int | None
    distance: float


@dataclass(frozen=True, eq=False)
class Beside:
    """Sets of causes beside a smooth process along a quantity.

    ``cost``: what it adds to -2 ln L of each; ``quantity``: its number.
    """

    search: Search
    cost: float
    quantity: int


class Weighed(Protocol):
    """Probabilities of sets of candidates, by the candidates' numbers."""

    @property
    def none(self) -> float:
        """Probability that no cause of the catalogue acts."""
        ...

    def of_set(self, members: Members) -> float:
        """Probability that just these causes of the catalogue act."""
        ...

    def of_cause(self, member: int) -> float:
        """Probability that a cause acts, alone or with others."""
        ...

    def with_behind(self, behind: Sequence[Behind]) -> Weighed:
        """Return those with these sets that have an effect behind the others."""
        ...

    def in_doubt(self, chances: Mapping[int, float]) -> Weighed:
        """Return those of which causes, where a set has them, act with such a probability."""
        ...


@dataclass(frozen=True)
class Only:
    """Sets that fit exactly: one of them is it, and no data say which."""

    sets: frozenset[Members]
    none: float = 0.0

    def of_set(self, members: Members) -> float:
        """Probability that just these causes of the catalogue act."""
        return float(members in self.sets) / len(self.sets)

    def of_cause(self, member: int) -> float:
        """Probability that a cause acts, alone or with others."""
        return sum(member in s for s in self.sets) / len(self.sets)

    def with_behind(self, behind: Sequence[Behind]) -> Only:  # noqa: ARG002
        """Return these: nothing more than they fits exactly."""
        return self

    def in_doubt(self, chances: Mapping[int, float]) -> Only:  # noqa: ARG002
        """Return these: nothing is left that would leave a cause open."""
        return self


@dataclass(frozen=True)
class Probabilities:
    """Probabilities of sets of candidates, by the candidates' numbers.

    Attributes
    ----------
    search:
        The sets with their scores; candidates from ``count`` on are unexplained structure.
    candidates:
        The candidates of the catalogue.
    processes:
        Smooth errors of no known form that stand in the noise instead, with their sets.
    behind:
        Sets with an effect behind the others.
    doubts:
        Probabilities of causes that may be in a set and need not act: something else makes that.
    supposed:
        What acts in the sets that hold a candidate.
    """

    search: Search
    candidates: Candidates
    processes: Sequence[Beside] = ()
    behind: Sequence[Behind] = ()
    doubts: Mapping[int, float] = field(default_factory=dict)
    supposed: Sequence[Supposed] = ()

    def with_behind(self, behind: Sequence[Behind]) -> Probabilities:
        """Return those with these sets that have an effect behind the others."""
        return replace(self, behind=behind)

    def in_doubt(self, chances: Mapping[int, float]) -> Probabilities:
        """Return those of which causes, where a set has them, act with such a probability."""
        doubts = {self._leader.get(j, j): p for j, p in chances.items()}
        return replace(self, doubts={**self.doubts, **doubts})

    @property
    def none(self) -> float:
        """Probability that no cause of the catalogue acts."""
        return self.of_set(frozenset())

    @cached_property
    def likeliest(self) -> list[Found]:
        """Sets near the best score, the likeliest first, then others about as probable as it.

        None is empty. A good score of sets that are next to impossible (a curve of ten parameters
        for a difference of two) names none of them.
        """
        best = min(f.score for f in self.known.values()) + WITHIN
        near = {mask for mask, f in self.known.items() if mask and f.score <= best}
        weights = {m: w for m, w in self._weights.items() if m in self.known}
        least = max((weights.get(m, 0.0) for m in near), default=math.inf) / NEAR_ODDS
        most = max((w for m, w in weights.items() if m), default=0.0)
        if most > OVERRULED * NEAR_ODDS * least:
            near, least = {m for m, w in weights.items() if m and w == most}, most / NEAR_ODDS
        more = {m for m, w in weights.items() if w > least}
        # Sets that explain the same are ordered by the catalogue, not by rounding.
        ranked = [
            (m not in near, -round(weights.get(m, 0.0), SCORE_DIGITS), m) for m in near | more if m
        ]
        found = self.known
        ranked.sort(key=lambda one: (*one[:2], found[one[2]].score))
        return [found[m] for *_, m in ranked]

    @cached_property
    def unnamed(self) -> float:
        """Probability that structure without a name acts, alone or beside causes."""
        every = sum(self._weights.values())
        return sum(w for m, w in self._weights.items() if m > self._catalogue) / every

    def of_noise(self, named: Found) -> float:
        """How many times as probable as a set it is that nothing acts, no structure either."""
        own = self._weights.get(_mask(named.members), 0.0)
        return self._weights.get(0, 0.0) / own if own > 0 else math.inf

    def of_set(self, members: Members) -> float:
        """Probability that just these causes of the catalogue act."""
        if members in self._hidden:
            return self._hidden[members] / self._total
        leaders = {self._leader.get(m, m) for m in members}
        return self._sets.get(_mask(leaders), 0.0) / self._total

    def of_cause(self, member: int) -> float:
        """Probability that a cause acts, alone or with others."""
        leader = self._leader.get(member, member)
        own = sum(w for s, w in self._together.items() if s >> leader & 1)
        own /= len(self.candidates.alike.get(leader, [leader]))
        return (own + sum(w for s, w in self._hidden.items() if member in s)) / self._total

    @cached_property
    def _leader(self) -> dict[int, int]:
        """Which candidate stands for each of those that change the readings alike."""
        return {j: home for home, alike in self.candidates.alike.items() for j in alike}

    @cached_property
    def _sets(self) -> dict[int, float]:
        """Weight of each set of leaders, by its mask, of one of the sets that it stands for."""
        out: dict[int, float] = {}
        weights = dict(self._weights)
        for mask, weight in self._unseen():
            weights[mask] = max(weight, weights.get(mask, 0.0))
        for j, chance in self.doubts.items():
            for mask in [mask for mask in weights if mask >> j & 1]:
                without = mask ^ 1 << j
                weights[without] = weights.get(without, 0.0) + (1.0 - chance) * weights[mask]
                weights[mask] *= chance
        for mask, weight in weights.items():
            causes = mask & self._catalogue
            out[causes] = out.get(causes, 0.0) + weight
        return out

    @cached_property
    def _catalogue(self) -> int:
        """Bits of the causes in the mask of a set."""
        return (1 << self.candidates.count) - 1

    @cached_property
    def _weights(self) -> dict[int, float]:
        """Odds of each set against the best one, by its mask; of two processes, the greater."""
        values = dict(self._values[0])
        for own in self._values[1:]:
            for mask, value in own.items():
                values[mask] = min(value, values.get(mask, math.inf))
        return {mask: self._weight(value) for mask, value in values.items()}

    @cached_property
    def _values(self) -> list[dict[int, float]]:
        """-2 ln of the odds of sets, by their masks: of the search, then beside each process."""
        best = min([self.search.best, *(one.search.best + one.cost for one in self.processes)])
        values = dict(Evidence(self.search, best=best).values)
        for open_, within in self._supposed:
            values = {mask: value for mask, value in values.items() if not open_.within(mask)}
            values |= within.values
        every = [values]
        for bit, one in self._beside():
            own = Evidence(one.search, best=best - one.cost, acting=1).values
            every.append({mask | bit: value + one.cost for mask, value in own.items()})
        # with too few readings nothing is known of any set, and no cause is named
        return every if any(every) else [{0: 0.0}, *every[1:]]

    @cached_property
    def _least(self) -> float:
        return min(value for own in self._values for value in own.values())

    def _weight(self, value: float) -> float:
        return math.exp((self._least - value) / 2)

    @cached_property
    def _supposed(self) -> list[tuple[Supposed, Evidence]]:
        """What is supposed with the sets that it acts in."""
        return [(x, Evidence(self.search, x)) for x in self.supposed]

    def _beside(self) -> Iterator[tuple[int, Beside]]:
        """Processes with their bits in the mask of a set, those after all candidates.

        Two along one quantity are the same hypothesis: of these the likelier counts.
        """
        return ((1 << self.search.c.count + one.quantity, one) for one in self.processes)

    @cached_property
    def known(self) -> dict[int, Found]:
        """Sets near the best with their scores, by their masks; processes are members, too."""
        out = dict(self.search.known)
        for bit, one in self._beside():
            own = frozenset({bit.bit_length() - 1})
            for mask, f in one.search.known.items():
                score = f.score + one.cost
                if (mask | bit) not in out or score < out[mask | bit].score:
                    out[mask | bit] = replace(f, members=f.members | own, score=score)
        return out

    def _unseen(self) -> Iterator[tuple[int, float]]:
        """Sets with one or two more causes that they hide, and their weights."""
        for mask, weight, odds in self._hiding():
            for j, own in odds.items():
                yield mask | 1 << j, weight * own * self._more(mask, 1)
            for (i, one), (j, other) in itertools.combinations(odds.items(), 2):
                if not self.candidates.not_beside(1 << i) >> j & 1:
                    yield mask | 1 << i | 1 << j, weight * one * other * self._more(mask, 2)

    def _more(self, mask: int, further: int) -> float:
        """Odds of so many further causes beside a set, over those if each acted by itself."""
        if not self.candidates.together:
            return 1.0
        count, n = mask.bit_count(), self.candidates.multiplicity
        return math.exp(log_odds_together(n, count + further) - log_odds_together(n, count))

    def _hiding(self) -> Iterator[tuple[int, float, dict[int, float]]]:
        """Sets with their weights and the odds of the causes that each hides."""
        beside = ((bit, one.search) for bit, one in self._beside())
        for values, (bit, searched) in zip(self._values, ((0, self.search), *beside), strict=True):
            for mask, f in searched.known.items():
                weight = self._weight(values.get(mask | bit, math.inf))
                supposed = not bit and any(one.within(mask) for one in self.supposed)
                if weight > MIN_WEIGHT and not supposed:
                    left = *searched.beside(f.blocks), f.rss, f.columns
                    yield mask | bit, weight, self._odds_unseen(searched, f.blocks, *left)
        for open_, own in self._supposed:
            for mask, blocks in own.near.items():
                weight = self._weights.get(mask, 0.0)
                if weight > MIN_WEIGHT:
                    left = open_.left_by(blocks)
                    yield mask, weight, self._odds_unseen(open_.search, blocks, *left)

    def _odds_unseen(
        self,
        searched: Search,
        blocks: Sequence[int],
        left: Floats,
        along: Floats,
        rss: float,
        columns: int,
    ) -> dict[int, float]:
        """Odds of each cause that a set of a search hides, beside this set.

        ``left``, ``along``, ``rss``: what it leaves of other blocks, of the residuals along them,
        and of their sum of squares; ``columns``: their count.
        """
        c = searched.c
        members = {searched.owner[b] for b in blocks}
        left = left * c.kept
        hidden = (left < HIDDEN) & (c.owner < self.candidates.count)
        hidden &= c.penalty > 0.0
        excluded = c.not_beside(sum(1 << j for j in members))
        noise = float(searched.score.floor.noise(rss, max(c.dof - columns, 1)))
        chance, out = c.chance, {}
        assumed = sizes_assumed(c.together)
        for j in np.unique(c.owner[hidden]).tolist():
            own = c.owner == j
            if j not in members and not excluded >> j & 1:
                least = chance[own]
                # fitted exactly, nothing is seen of what is not determined
                fitted = np.where(np.isinf(c.penalty[own]), 0.0, along[own])
                seen = np.sqrt(np.minimum(fitted / max(noise, TINY), least))
                likely = _mean_likelihood(seen, np.sqrt(least * left[own]), assumed=assumed)
                out[j] = float(np.mean(likely)) * float(c.level[j]) / NAMING_LEVEL
        return out

    @cached_property
    def _hidden(self) -> dict[Members, float]:
        # their distance is that of scores, to the set of the best score
        best = _mask(self.search.top.members)
        own, weight = self.candidates.level / NAMING_LEVEL, self._weights.get(best, 1.0)
        return {
            b.members: weight
            * math.exp(-b.distance / 2)
            * (1.0 if b.behind is None else float(own[b.behind]))
            for b in self.behind
        }

    @cached_property
    def _total(self) -> float:
        return sum(self._together.values()) + sum(self._hidden.values())

    @cached_property
    def _together(self) -> dict[int, float]:
        """Weight of all sets together that each set of leaders stands for, by its mask."""
        sizes = ((leader, len(alike)) for leader, alike in self.candidates.alike.items())
        many = [(leader, count) for leader, count in sizes if count > 1]
        return {
            s: w * math.prod(count for leader, count in many if s >> leader & 1)
            for s, w in self._sets.items()
        }


def chance_in_doubt(c: Candidates, cause: int, certain: float, known: float) -> float:
    """Probability that a cause of a set acts, of which something else may make a part.

    Its size over the standard error, as if nothing else did, and as far as it is known.
    """
    own = np.flatnonzero(c.owner == cause)
    least = np.sqrt(c.chance[own].min()) * known / certain
    # one that is larger than the range is a cause of that size all the same
    times = max(1.0, 2 * known / (RANGE * least))
    longer = 1.0 + math.log(times) / math.log(RANGE)
    likely = _mean_likelihood(np.array([known]), np.array([least]), SIZES**longer)
    odds = likely[0] * longer * c.level[cause] / NAMING_LEVEL
    return float(special.expit(np.log(odds)))  # they may be inf


def _mask(members: Collection[int]) -> int:
    """Set of candidates as a bit each."""
    return sum(1 << m for m in members)


def _mean_likelihood(
    seen: Floats, least: Floats, sizes: Floats = SIZES, assumed: Floats | None = None
) -> Floats:
    """Likelihood of a cause over that without it, mean over its sizes, shape (b,).

    ``seen``: what is seen of it beside the others, in standard errors; ``least``: what would be of
    the smallest that is seen by itself; ``sizes``: over that; ``assumed``: how probable each is,
    None: equally.
    """
    size = sizes[:, None] * least
    either = np.exp(size * (seen - size / 2)) + np.exp(-size * (seen + size / 2))
    return np.asarray(np.average(either, axis=0, weights=assumed) / 2)
