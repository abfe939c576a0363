"""Which sets of causes explain the residuals best.

Everything here is linear algebra on arrays: residuals ``r`` of the plain model and, for every
candidate, the columns by which it would change them. What the nuisance parameters can absorb is
projected out first, so that a candidate is judged by what only it can explain.

A set of causes S with K columns, of m degrees of freedom left by the nuisance, is scored by ::

    score(S) = m ln RSS(S) + P / (1 - x) * m / M,    P = sum of penalties,
    M = m - K / 2 - 1,    x = (K - 2) (P + K + 2) / (24 M²)

that is -2 ln L, profiled over the noise (from its floor up where readings are recorded in steps,
:class:`trunnion.base.resolution.Floor`). The penalty of a cause with k columns is the quantile of
chi² with k degrees of freedom at the family-wise level divided by the number of candidates (times
the number of places a nonlinear parameter can take): a cause is worth its name if it gains what no
candidate would gain by chance. What many readings gain by chance is chi²; m ln(RSS / RSS(S)) of few
readings gains more, and the factor of P is what it takes for the same chance: Bartlett's factor
m / M and the next term of the series (Box 1949, A general distribution theory for a class of
likelihood criteria, Biometrika 36), within 2 % of the quantile of F where K is at most 2/3 of m.

The search is over sets, not one cause after the other: a beam keeps the best sets of each size,
then every cause of the best sets is tried against every other.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np

from trunnion._core import CauseBlocks, CauseSet, sizes_of_sets
from trunnion.base.resolution import NO_FLOOR, Floor
from trunnion.base.units import Flags, Floats
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.reach import Reach
from trunnion.diagnosis.scorer import SCORE_DIGITS, Scorer

WITHIN = 6.0  # "within 6 of the best": a likelihood ratio of exp(3) = 20
BEAM = 20
BEAM_OF_SEVERAL = 32  # measurements: many sets of a size differ in what explains nothing
REACH = 30.0  # above the best score, to which sets are weighed: a likelihood ratio of 3e6
SAME_SCORE = 1e-9
MAX_CAUSES = 12
FEW = 4  # sets of each size that are taken one by one, of candidates that exclude others
EXCHANGES = 4
EXCHANGED_SETS = 4
CANCELLING = 3.0  # times the residuals, that a contribution may be without costing much
SETTLED = 12.0  # above the best score, to which sets are weighed by the size of contributions
TINY = 1e-300


@dataclass(frozen=True)
class Found:
    """One set of causes: score (lower is better), RSS, columns, and the variant of each cause."""

    members: frozenset[int]
    score: float
    rss: float
    columns: int
    blocks: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _State:
    """A set in the beam: its blocks, and what the core knows of them."""

    mask: int
    blocks: tuple[int, ...]
    core: CauseSet


def search(
    c: Candidates,
    r: Floats,
    *,
    floor: Floor = NO_FLOOR,
    most: int = MAX_CAUSES,
    after: "Search | None" = None,
) -> "Search":
    """Search the sets of causes that explain residuals.

    ``r``: residuals with the nuisance projected out, shape (n,). ``floor``: of the variance of a
    reading. ``most``: causes of a set. ``after``: a search among the first of these candidates, of
    which no good set is to be lost.
    """
    s = Search(c, r, floor)
    if len(c.leaders):
        # what a search before knows is not lost: only sets with what is new are sought
        s.widen(s.beam if after is None else BEAM, most)
        if after is not None:
            s.take_over(after)
        s.exchange()
        s.settle()
    return s


def one_by_one(c: Candidates, r: Floats, *, floor: Floor = NO_FLOOR) -> Found:
    """Return the best of the sets that begin with one cause and take the best next one each time.

    What it leaves is about what the best of all sets leaves: where a cause stands for another, or
    several for a few, it explains as much. One that another excludes may not: then the best sets of
    each size are a few. ``r``, ``floor``: as of :func:`search`.
    """
    s = Search(c, r, floor)
    if len(c.leaders):
        s.widen(FEW if c.apart else 1, MAX_CAUSES)
    return min(s.known.values(), key=lambda f: f.score)


class Search:
    """All sets that were looked at.

    Attributes
    ----------
    beam:
        How many sets of each size are kept.
    best:
        The best score, of the empty set too.
    nothing:
        The empty set.
    scores:
        Score of each set by its mask (a bit a candidate), up to about ``REACH`` above the best.
    made:
        Blocks of each of these sets.
    more:
        What was added to scores of sums of squares where sets were scored otherwise, by masks.
    alike:
        Masks of sets by which what was read, in steps, is as probable.
    reach:
        What candidates gain beside sets.
    at_best, of_variants:
        What is known of the evidence of sets, by their blocks in order (:mod:`.evidence`).
    """

    def __init__(self, c: Candidates, r: Floats, floor: Floor) -> None:
        self.c = c
        self.beam = BEAM_OF_SEVERAL if c.several else BEAM
        rss = float(r @ r)
        self.score = Scorer(c.dof, floor, 1e-14 * rss)
        self.residual = c.products(r)
        self.core = self._core()
        self.empty = _State(0, (), self.core.empty(self.residual, rss))
        self.reach = Reach(c, self.core, self.empty.core)
        self._path = [self.empty]  # of the last set that was built, block by block
        self.owner: list[int] = c.owner.tolist()
        self.bits: list[int] = [1 << j for j in self.owner]
        self.nothing = Found(frozenset(), float(self.score(rss, 0, 0.0)), rss, 0, ())
        self.known = {0: self.nothing}
        self.scores = {0: self.nothing.score}
        self.made: dict[int, tuple[int, ...]] = {0: ()}
        self.best = self.nothing.score
        self.more: Mapping[int, float] = {}
        self.alike: Sequence[int] = ()
        self.at_best: dict[tuple[int, ...], float] = {}
        self.of_variants: dict[tuple[int, ...], float] = {}

    @property
    def found(self) -> list[Found]:
        """Sets whose score lies within `WITHIN` of the best, best first; none is empty."""
        near = (f for f in self.known.values() if f.score <= self.best + WITHIN and f.members)
        return sorted(near, key=lambda f: f.score)

    @property
    def top(self) -> Found:
        """The best set that is not empty, if there is one near the best score; else the empty."""
        return next(iter(self.found), self.nothing)

    def widen(self, beam: int, most: int, begin: Sequence[_State] = ()) -> None:
        """Keep the best sets of each size and add every candidate to them, while that helps.

        ``begin``: sets to begin with; by default what costs nothing to name.
        """
        states = list(begin) or [self.expected()]
        most = min(most, len(self.c.leaders), self.c.dof - 2)
        for _ in range(most - max(len(s.blocks) for s in begin) if begin else most):
            before = self.best
            chosen = self.grow(states, beam)
            scores = [self.known[s.mask | self.bit(block)].score for s, block in chosen]
            if not scores or min(scores) > before + WITHIN:
                break
            self.c.prepare(block for _, block in chosen)
            states = [self.extended(s, block) for s, block in chosen]

    def take_over(self, other: "Search") -> None:
        """Know the sets of a search among fewer candidates; try every other beside the best."""
        self._recall(other, other.made)
        self.at_best, self.of_variants = dict(other.at_best), dict(other.of_variants)
        if near := [self.built(f.blocks) for f in other.found[: self.beam]]:
            self.grow(near, self.beam)

    def _recall(self, other: "Search", masks: Collection[int]) -> None:
        """Know some sets of another search, with their scores before they were settled."""
        for mask in masks:
            if mask in other.scores and mask not in self.scores:
                self.scores[mask], self.made[mask] = other.scores[mask], other.made[mask]
        near = {mask: other.known[mask] for mask in masks if mask in other.known}
        rss, columns = np.array([(f.rss, f.columns) for f in near.values()]).T
        penalty = np.array([np.sum(self.c.penalty[list(f.blocks)]) for f in near.values()])
        scores = self.score(rss, columns, penalty).tolist()
        for (mask, f), score in zip(near.items(), scores, strict=True):
            self.scores[mask], self.made[mask] = score, f.blocks
            self.remember(mask, f.blocks, score, f.rss, f.columns)
        self.best = min(f.score for f in self.known.values())

    def without(self, banned: Collection[int]) -> "Search":
        """Search again without some candidates, which are banned now.

        It begins with the best sets that have none of them, and what they leave of others.
        """
        gone = sum(1 << j for j in banned)
        new = copy(self)
        new.known, new.scores, new.made = {0: self.nothing}, {0: self.nothing.score}, {0: ()}
        new.core = new._core()
        new.empty = _State(0, (), new.core.empty(self.residual, self.nothing.rss))
        new._path, new.reach = [new.empty], Reach(self.c, new.core, new.empty.core)
        new._recall(self, [mask for mask in self.made if not mask & gone])
        left = [tuple(b for b in f.blocks if self.owner[b] not in banned) for f in self.found]
        begin = [new._noted(blocks) for blocks in dict.fromkeys(left)]
        near = sorted(new.known.values(), key=lambda f: f.score)[: self.beam]
        known = {s.mask for s in begin}
        new.scores |= {mask: new.known[mask].score for mask in known}
        begin += [s for s in (new.built(f.blocks) for f in near) if s.mask not in known]
        new.widen(self.beam, MAX_CAUSES, begin)
        new.exchange()
        new.settle()
        return new

    def exchange(self) -> None:
        """Try each cause of the best sets against every other candidate."""
        tried = set[int]()
        for _ in range(EXCHANGES):
            near = [f for f in self.known.values() if f.score <= self.best + WITHIN]
            near.sort(key=lambda f: f.score)
            fresh: list[_State] = []
            for f in near[:EXCHANGED_SETS]:
                last = reversed(range(len(f.blocks)))  # what they begin with stays built
                without = (f.blocks[:leave] + f.blocks[leave + 1 :] for leave in last)
                some = chain(self._split(f), without)
                fewer = [self._noted(x) for x in some if self._untried(x, tried)]
                for one in fewer:  # places of a set that were known may be better
                    best = self.known[one.mask]
                    self.scores[one.mask], self.made[one.mask] = best.score, best.blocks
                fresh += reversed(fewer)
            if not fresh:
                break
            self.grow(fresh, 0)

    def _untried(self, blocks: Sequence[int], tried: set[int]) -> bool:
        """Whether a set was not tried, as it is from now on."""
        mask = sum(self.bit(b) for b in blocks)
        new = mask not in tried
        tried.add(mask)
        return new

    def _split(self, f: Found) -> Iterator[tuple[int, ...]]:
        """Sets with all the causes that one of a set stands for, without as many of its causes.

        Or without fewer. One after the other they may explain less than what stands for all, beside
        causes that make up for the differences.
        """
        for block in f.blocks:
            every = self.c.stands_for(self.owner[block])
            if len(every) < 2:
                continue
            own = tuple(self.owner.index(j) for j in every)
            rest = [b for b in f.blocks if b != block and self.owner[b] not in every]
            some = (combinations(rest, k) for k in range(len(every)))
            for leave in chain.from_iterable(some):
                blocks = (*(b for b in rest if b not in leave), *own)
                mask = sum(self.bit(b) for b in blocks)
                if not self.c.not_beside(mask) & mask:
                    yield blocks

    def settle(self) -> None:
        """Add to the scores of the best sets what causes cost that cancel or contradict.

        A cause is as likely beforehand as its size allows: contributions are supposed to be normal,
        of at most `CANCELLING` times the size of the residuals. Three causes that add up to a cubic
        none of them makes are each twenty times as large as what they explain. Where something is
        stated of a cause (a certificate), it is as likely as that allows.
        """
        least, costs = np.inf, dict[int, float]()
        order = sorted(self.known, key=lambda k: self.known[k].score)
        for mask in order:
            f = self.known[mask]
            if f.score > least + SETTLED:
                break
            if mask not in costs:  # of all at once that are about as good
                near = [k for k in order if f.score <= self.known[k].score <= f.score + SETTLED]
                found = self._cancelling([self.known[k].blocks for k in near])
                costs |= dict(zip(near, found.tolist(), strict=True))
            more = costs[mask] + self.contradicting(f.blocks, f.rss, f.columns)
            if more > 0:
                self.known[mask] = replace(f, score=float(np.round(f.score + more, SCORE_DIGITS)))
                self.scores[mask] = self.known[mask].score
            least = min(least, self.known[mask].score)
        self.best = min(f.score for f in self.known.values())

    def scored(
        self, scores: Mapping[tuple[int, ...], float], alike: Collection[tuple[int, ...]]
    ) -> "Search":
        """Return the search with only these sets, each scored otherwise (lower is better).

        ``scores``: by blocks; what they count from is the same for all of them. The best score
        stays as it is. ``alike``: blocks of sets by which the readings are as probable.
        """
        new = copy(self)
        new.known, new.scores, new.made, new.more = {}, {}, {}, {}
        more: dict[int, float] = {}
        cancelling = dict(zip(scores, self._cancelling([*scores]).tolist(), strict=True))
        for blocks, own in scores.items():
            left = self.built(blocks).core
            rss = max(left.rss, self.score.least)
            cost = cancelling[blocks] + self.contradicting(blocks, rss, left.columns)
            mask = sum(self.bits[b] for b in blocks)
            if mask in more and new.scores[mask] <= own + cost:
                continue
            new.scores[mask], new.made[mask] = own + cost, blocks
            more[mask] = own - float(self.score(rss, left.columns, left.penalty))
            members = frozenset(self.owner[b] for b in blocks)
            new.known[mask] = Found(members, own + cost, rss, left.columns, blocks)
        off = self.best - min(new.scores.values())
        for mask, f in new.known.items():
            new.scores[mask] = float(np.round(f.score + off, SCORE_DIGITS))
            new.known[mask] = replace(f, score=new.scores[mask])
        new.more = {mask: own + off for mask, own in more.items()}
        new.alike = [mask for mask, blocks in new.made.items() if blocks in alike]
        new.nothing = new.known[0]
        return new

    def sizes(
        self, sets: Sequence[Sequence[int]], counted: Flags
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """What sets explain (s,), and how closely they determine the sizes of their causes.

        The latter as logarithms of determinants of covariances: of the sizes of each set together
        (s,), of those blocks that are ``counted`` (b,), and of those of each block by itself. Last,
        the length of the sizes of each block. Blocks of all sets one after the other.
        """
        c = self.c
        together = sorted({b for one in sets if len(one) > 1 for b in one})
        used = [*together, *sorted({b for one in sets for b in one}.difference(together))]
        every = np.concatenate([c.start[b] + np.arange(c.rank[b]) for b in used])
        gram = np.zeros((len(every), len(every)))
        if together:  # the columns of a block are orthonormal
            own = c.gram(together)
            gram[: len(own), : len(own)] = own
        place = {b: i for i, b in enumerate(used)}
        return sizes_of_sets(
            [[place[b] for b in one] for one in sets],
            rank=c.rank[used].tolist(),
            counted=counted[used].tolist(),
            gram=gram,
            residual=self.residual[every],
            dependent=c.dependent,
        )

    def _cancelling(self, sets: Sequence[tuple[int, ...]]) -> Floats:
        """What the sizes of the contributions of some sets cost, (s,)."""
        count = np.array([len(one) for one in sets])
        several = [one for one in sets if len(one) > 1]
        if not several:
            return np.zeros(len(sets))
        lengths = self.sizes(several, np.zeros(len(self.owner), dtype=bool))[3]
        cancels = np.maximum(lengths**2 / self.nothing.rss - 1.0, 0.0) / CANCELLING**2
        paid = self.c.penalty[np.concatenate(several)] > 0
        of = np.repeat(np.flatnonzero(count > 1), count[count > 1])
        return np.asarray(np.bincount(of, cancels * paid, len(sets)), dtype=np.float64)

    def _joined(self, blocks: Sequence[int]) -> tuple[Floats, Floats]:
        """Inner products of the columns of a set of blocks (K, K), and with the residuals (K,)."""
        along = np.concatenate([self.residual[self.c.span(b)] for b in blocks])
        return self.c.gram(blocks), along

    def contradicting(self, blocks: Sequence[int], rss: float, size: int) -> float:
        """What a set costs that is larger than what is stated of its causes: of -2 ln L.

        ``rss``: what it leaves; ``size``: count of its columns.
        """
        c = self.c
        held = [c.stated.get(int(c.owner[b]), np.inf) for b in blocks]
        if not np.isfinite(held).any():
            return 0.0
        gram, along = self._joined(blocks)
        noise = float(self.score.floor.noise(rss, max(c.dof - size, 1)))
        less = np.repeat(noise / np.maximum(np.square(held), TINY), [c.rank[b] for b in blocks])
        free = along @ np.linalg.lstsq(gram, along, rcond=c.dependent)[0]
        kept = along @ np.linalg.lstsq(gram + np.diag(less), along, rcond=c.dependent)[0]
        return max(float(free - kept), 0.0) / max(noise, TINY)

    def expected(self) -> _State:
        """Set of what costs nothing to name; the empty one if there is none."""
        return self._noted(tuple(map(int, np.flatnonzero(self.c.penalty == 0))))

    def _noted(self, blocks: tuple[int, ...]) -> _State:
        """State of a set, which is known from now on."""
        state = self.built(blocks)
        if blocks:
            columns, rss = state.core.columns, state.core.rss
            score = float(self.score(rss, columns, state.core.penalty))
            self.best = min(self.best, score)
            self.remember(state.mask, blocks, score, rss, columns)
            self.made[state.mask] = blocks
        return state

    def bit(self, block: int) -> int:
        """Bit of a block's candidate in the mask of a set."""
        return self.bits[block]

    def extended(self, state: _State, block: int) -> _State:
        """State with one more block."""
        core = self.core.extended(state.core, block, self.c.gram_rows(block))
        return _State(state.mask | self.bits[block], (*state.blocks, block), core)

    def built(self, blocks: Sequence[int]) -> _State:
        """State of a set of blocks, from what it begins with like the last one that was built."""
        path = self._path
        while path[-1].blocks != tuple(blocks[: len(path) - 1]):
            path.pop()
        for b in blocks[len(path) - 1 :]:
            path.append(self.extended(path[-1], b))
        return path[-1]

    def beside(self, blocks: Sequence[int]) -> tuple[Floats, Floats]:
        """What a set leaves of the squared unit columns, and of the residuals along them.

        Means over the columns of each block, shapes (b,).
        """
        c = self.c
        taken, residual = self.built(blocks).core.products()
        free = 1.0 - np.einsum("km,km->m", taken, taken)
        along = np.where(free > c.dependent, residual**2 / np.maximum(free, c.dependent), 0.0)
        total = np.cumsum(np.stack([np.maximum(free, 0.0), along]), axis=1)
        total = np.concatenate([np.zeros((2, 1)), total], axis=1)
        left, seen = (total[:, c.start + c.rank] - total[:, c.start]) / c.rank
        return left, seen

    def _core(self) -> CauseBlocks:
        """Return the blocks as the core knows them."""
        c = self.c
        return CauseBlocks(
            width=c.width,
            start=c.start.tolist(),
            rank=c.rank.tolist(),
            candidate=c.owner.tolist(),
            penalty=c.penalty,
            positive=np.isin(c.owner, sorted(c.positive)).tolist(),
            dependent=c.dependent,
            degrees_of_freedom=c.dof,
            floor=self.score.floor.variance,
            least=self.score.least,
        )

    def grow(self, states: list[_State], keep: int) -> list[tuple[_State, int]]:
        """Try every candidate on every state; remember all sets near the best, and the best `keep`.

        Return the latter: a state each, and the block that was added to it.
        """
        columns = max(s.core.columns for s in states)
        # A set of so many causes is found from as many sets, at most.
        many = (keep + 1) * (columns + 2)
        tried = self.core.tried([s.core for s in states], self.best, REACH, many)
        if banned := [self.c.not_beside(s.mask) for s in states if self.c.apart]:
            tried = [t for t in tried if not self.bits[t[2]] & banned[t[1]]]
        if not tried:
            return []
        self.best = best = min(self.best, tried[0][0])
        chosen: list[tuple[_State, int]] = []
        seen: set[int] = set()
        scores, made, bits = self.scores, self.made, self.bits
        for value, i, block, rss, columns in tried:
            full = len(chosen) >= keep and value > best + WITHIN
            if full and value > best + REACH:
                break
            state = states[i]
            mask = state.mask | bits[block]
            if mask in seen:
                continue
            seen.add(mask)
            blocks = (*state.blocks, block)
            if value < scores.get(mask, np.inf):
                scores[mask], made[mask] = value, blocks
            if full:
                continue
            self.remember(mask, blocks, value, rss, columns)
            if len(chosen) < keep:
                chosen.append((state, block))
        return chosen

    def remember(
        self, mask: int, blocks: tuple[int, ...], score: float, rss: float, columns: int
    ) -> None:
        """Note a set unless it is known with as good a score."""
        old = self.known.get(mask)
        if old is None or score < old.score - SAME_SCORE:
            members = frozenset(self.owner[b] for b in blocks)
            self.known[mask] = Found(members, score, rss, columns, blocks)
