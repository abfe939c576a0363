"""How probable the sets of causes are that a search looked at.

A set S has the weight exp(-score(S) / 2), its penalised likelihood: the penalty of a cause stands
for what is assumed of it beforehand (:mod:`.selection`). Sets are identified by the causes of the
catalogue that act in them, with or without unexplained structure beside these; the weights of all
sets that the search looked at, of the plain model (no cause) and of structure without a cause add
up to 1. Candidates that change the readings alike share their sets' weights evenly.

A cause is said to act where it is large enough to be seen: beforehand its size, in standard errors,
is at least z₀ = √penalty. Where it is seen to be z < z₀, the set without it explains the readings
better, and what is left of the likelihood above z₀ is Φ(z - z₀), beside the half of one at z₀.

An effect that may hide behind others (:attr:`.effect.Effect.least`) is supposed and not fitted: its
sets have the weight of the likelihood times the odds of one more cause beforehand, one among all
candidates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.selection import Search

Members = frozenset[int]


@dataclass(frozen=True)
class Behind:
    """A set with an effect behind it: its candidates, and its distance to the best set."""

    members: Members
    distance: float


class Weighed(Protocol):
    """Probabilities of sets of candidates, by the candidates' numbers."""

    @property
    def behind(self) -> Sequence[Behind]:
        """Sets with an effect behind the others."""
        ...

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


@dataclass(frozen=True)
class Only:
    """Sets that fit exactly: one of them is it, and no data say which."""

    sets: frozenset[Members]
    behind: Sequence[Behind] = ()
    none: float = 0.0

    def of_set(self, members: Members) -> float:
        """Probability that just these causes of the catalogue act."""
        return float(members in self.sets) / len(self.sets)

    def of_cause(self, member: int) -> float:
        """Probability that a cause acts, alone or with others."""
        return sum(member in s for s in self.sets) / len(self.sets)


@dataclass(frozen=True)
class Probabilities:
    """Probabilities of sets of candidates, by the candidates' numbers.

    Attributes
    ----------
    search:
        The sets with their scores; candidates from ``count`` on are unexplained structure.
    candidates:
        The candidates of the catalogue.
    behind:
        Sets with an effect behind the others.
    """

    search: Search
    candidates: Candidates
    behind: Sequence[Behind] = ()

    @property
    def none(self) -> float:
        """Probability that no cause of the catalogue acts."""
        return self.of_set(frozenset())

    def of_set(self, members: Members) -> float:
        """Probability that just these causes of the catalogue act."""
        if members in self._hidden:
            return self._hidden[members] / self._total
        leaders = frozenset(self._leader.get(m, m) for m in members)
        return self._sets.get(leaders, 0.0) / self._total

    def of_cause(self, member: int) -> float:
        """Probability that a cause acts, alone or with others."""
        leader = self._leader.get(member, member)
        own = sum(
            w * self._count(s) / len(self.candidates.alike[leader])
            for s, w in self._sets.items()
            if leader in s
        )
        return (own + sum(w for s, w in self._hidden.items() if member in s)) / self._total

    @cached_property
    def _leader(self) -> dict[int, int]:
        """Which candidate stands for each of those that change the readings alike."""
        return {j: home for home, alike in self.candidates.alike.items() for j in alike}

    @cached_property
    def _sets(self) -> dict[Members, float]:
        """Weight of each set of leaders, of one of the sets that it stands for."""
        out: dict[Members, float] = {}
        catalogue = (1 << self.candidates.count) - 1
        for mask, score in self.search.scores.items():
            members = _members(mask & catalogue)
            if score > self.search.best:  # with too few readings both are infinite
                weight = float(np.exp((self.search.best - score) / 2))
            else:
                weight = 1.0
            out[members] = out.get(members, 0.0) + weight * self._large_enough(mask, members, score)
        return out

    def _large_enough(self, mask: int, members: Members, score: float) -> float:
        """How likely the weakest cause of a set is one that can be seen, 1 where it pays."""
        short = 0.0
        for member in members:
            alone = self.search.scores.get(mask ^ (1 << member), np.inf)
            if alone < score:  # it is better without
                least = self._least[member]
                seen = max(alone - score + least, 0.0)
                short = max(short, math.sqrt(least) - math.sqrt(seen))
        return math.erfc(short / math.sqrt(2.0))

    @cached_property
    def _least(self) -> dict[int, float]:
        """Least penalty of each leader."""
        c = self.candidates
        least = np.minimum.reduceat(c.penalty, c.first_of_leader)
        return dict(zip(c.leaders.tolist(), least.tolist(), strict=True))

    @cached_property
    def _hidden(self) -> dict[Members, float]:
        odds = 1.0 / max(self.candidates.multiplicity, 1.0)
        return {b.members: odds * float(np.exp(-b.distance / 2)) for b in self.behind}

    @cached_property
    def _total(self) -> float:
        all_ = sum(w * self._count(s) for s, w in self._sets.items())
        return all_ + sum(self._hidden.values())

    def _count(self, leaders: Members) -> int:
        """How many sets one of leaders stands for."""
        return math.prod(self._many[m] for m in leaders if m in self._many)

    @cached_property
    def _many(self) -> dict[int, int]:
        """How many candidates a leader stands for, where it is more than itself."""
        sizes = ((leader, len(alike)) for leader, alike in self.candidates.alike.items())
        return {leader: count for leader, count in sizes if count > 1}


def _members(mask: int) -> Members:
    """Candidates of a set, from the bits of its mask."""
    out = []
    while mask:
        low = mask & -mask
        out.append(low.bit_length() - 1)
        mask ^= low
    return frozenset(out)
