"""Places between those of a grid, at which a large candidate explains more.

A grid of time constants is close enough for a cause of a few times the noise. What is left of one
of a hundred times the noise at the nearest place of the grid looks like outliers, or like further
causes. Where it explains most by itself is not where it does beside the causes that act with it: a
wave beside a scale is sought beside the scale, or a curve takes the place of both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.rows import where
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.along import MIN_PLACES, Along, Beside, of_ratios
from trunnion.diagnosis.around import best_around
from trunnion.diagnosis.candidates_of import with_places
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.selection import WITHIN, Search, search

if TYPE_CHECKING:
    from trunnion.diagnosis.candidates import Candidates
    from trunnion.diagnosis.case import Case

LOST = 0.5  # of -2 ln L, that a grid may lose of what a candidate explains
LARGE = 30.0  # of -2 ln L, a gain of which a grid may miss what decides between causes
COMPANIES = 4  # best sets, beside whose causes places are sought
MAX_ROUNDS = 3

_Blocks = tuple[int, ...]
_Places = tuple[tuple[float, ...], ...]  # candidate and place of each of some blocks
_Key = tuple[_Places, tuple[float, ...]]  # beside which; the candidate, and about what places


def search_between(case: Case) -> Search:
    """Search the sets of causes of a case, at places that are best beside the others of a set.

    The candidates of the case have these places from then on.
    """
    white, basis, floor = case.plain.white, case.plain.basis, case.floor
    s = search(case.candidates, white, floor=floor)
    few = len(white) < MANY_ROWS  # columns of many rows take memory
    alone = Beside(case.linearised.nuisance, basis, white, few)
    looked_at, around = dict[_Key, Along](), dict[_Key, tuple[float, Values]]()
    for _ in range(0 if case.dependent else MAX_ROUNDS):
        further = _beside_others(case, s, alone, looked_at, around)
        if not further:
            break
        case.candidates = with_places(case, case.candidates, further)
        case.fits.clear()
        s = search(case.candidates, white, floor=floor)
    return s


def _beside(alone: Beside, c: Candidates, blocks: Sequence[int]) -> Beside:
    """What blocks of candidates leave of what the nuisance alone does."""
    if not blocks:
        return alone
    columns, r = np.concatenate([c.columns(b) for b in blocks]), alone.residual.copy()
    # What is one measurement's own is zero in all others.
    acting = where(np.any(columns != 0, axis=0))
    own = np.linalg.qr(columns[:, acting].T.astype(np.float64))[0]
    more = np.zeros((len(r), own.shape[1]))
    more[acting] = own
    r[acting] -= own @ (own.T @ r[acting])
    return replace(alone, more=more, residual=r)


def _beside_others(
    case: Case,
    s: Search,
    alone: Beside,
    looked_at: dict[_Key, Along],
    around: dict[_Key, tuple[float, Values]],
) -> dict[int, Values]:
    """Places of candidates that are better beside others than those of a search, by their number.

    A place is left only for one at which the sets that the candidate is in are better. ``alone``:
    what is fitted beside no candidate. ``looked_at``, ``around``: what is known of searches before.
    """
    c, scores, found = s.c, _of_further(case, s), dict[int, Values]()
    beside = dict[_Places, Beside]()
    for rest, rss, known, near in _companies(s, few=len(case.plain.white) < MANY_ROWS):
        j = s.owner[near[0]]
        anywhere = case.effects[j].near_any
        free = None if anywhere else of_ratios(case.effects[j])
        if free is None and not anywhere:
            continue
        together = [*rest, int(near[0])]
        size, penalty = int(c.rank[together].sum()), float(c.penalty[together].sum())
        worst = min(s.best + WITHIN, float(s.score(rss - known, size, penalty)) - LOST)
        seen = s.reach.that_matter(rest, j)
        at = _places(case, c, seen)
        if free is None:
            start = case.values[j][int(c.variant[near[0]])]
            key = at, (j, *start.values())
            if key not in around:
                if at not in beside:
                    beside[at] = _beside(alone, c, seen)
                enough = _below(s, rss, size, penalty, worst)
                around[key] = best_around(case, case.effects[j], beside[at], start, enough)
            gain, values = around[key]
            score = float(s.score(rss - gain, size, penalty))
            if score <= min(worst, scores.get(j, np.inf)):
                found[j], scores[j] = values, score
            continue
        about = [case.values[j][v][free.name] for v in c.variant[near].tolist()]
        key = at, (j, *sorted(about))
        if (along := looked_at.get(key)) is None:
            if at not in beside:
                beside[at] = _beside(alone, c, seen)
            along = looked_at[key] = Along.of(case, case.effects[j], free, beside[at], about)
        for top, most in zip(*along.peaks(), strict=True):
            worst = min(worst, scores.get(j, np.inf))
            if s.score(rss - most, size, penalty) > worst:
                break  # the best come first
            gain, place = along.best_about(top)
            score = float(s.score(rss - gain, size, penalty))
            # Beyond a grid nothing is supposed of it, unless nothing else explains as much.
            if score <= (worst if along.on_grid(place) else min(worst, s.best - LOST)):
                found[j], scores[j] = along.values(place), score
    return found


def _below(
    s: Search, rss: float, size: int, penalty: float, worst: float
) -> Callable[[float], bool]:
    """Whether a gain leaves so little that a set of so many columns scores at most so much."""
    return lambda gain: bool(s.score(rss - gain, size, penalty) <= worst)


def _places(case: Case, c: Candidates, blocks: Iterable[int]) -> _Places:
    """Say where some blocks are."""
    of = ((int(c.owner[b]), int(c.variant[b])) for b in blocks)
    return tuple((j, *case.values[j][v].values()) for j, v in of)


def _of_further(case: Case, s: Search) -> dict[int, float]:
    """Scores that sets with another place of a candidate have to reach, by its number.

    Those of the sets with its place that is not of its grid.
    """
    scores: dict[int, float] = {}
    for f in s.found:
        for b in f.blocks:
            j = s.owner[b]
            if case.values[j][int(s.c.variant[b])] is case.linearised.further.get(j):
                scores[j] = min(f.score - LOST, scores.get(j, np.inf))
    return scores


@dataclass(frozen=True, eq=False)
class _Gains:
    """What blocks gain beside some others: which may be in a set as good as those near the best.

    rss: What the others leave. gains: Of each block (b,). known: Of the best one of each candidate
    (c,). large: Whether that is enough for what a grid may miss of it (c,). near: Blocks that may
    gain enough.
    """

    rss: float
    gains: Floats
    known: Floats
    large: Flags
    near: Integers

    @classmethod
    def beside(cls, s: Search, others: Sequence[int], several: Flags) -> _Gains:
        """Return those beside some blocks. several: Blocks whose candidate has several places."""
        c, blocks = s.c, list(others)
        rss, gains = s.reach.gains_beside(others, range(len(c.owner)))
        most = gains + _above_neighbours(c.owner, gains)
        size, penalty = c.rank[blocks].sum(), c.penalty[blocks].sum()
        reached = s.score(rss - most, size + c.rank, penalty + c.penalty)
        known = np.zeros(c.count)
        np.maximum.at(known, c.owner, gains)
        large = s.score(rss, 0, 0.0) - s.score(rss - known, 0, 0.0) > LARGE
        near = several & (reached <= s.best + WITHIN)
        return cls(rss, gains, known, large, np.flatnonzero(near))


def _companies(s: Search, *, few: bool) -> Iterator[tuple[_Blocks, float, float, Integers]]:
    """Blocks beside which a candidate may explain more, what they leave, its gain, and its blocks.

    Those about which it may gain enough, best first; all of them, if it is in the set. Beside the
    best sets, and these without one cause: that which takes the place of what is missed at places
    of the grid. Of many readings, whose columns take time, only the block of a cause that is in a
    set.
    """
    c, seen = s.c, set[tuple[frozenset[int], int]]()
    several = np.bincount(c.owner, minlength=c.count)[c.owner] >= MIN_PLACES
    known_beside = dict[_Blocks, _Gains]()
    for rest, ones, touched in _left_out(s, few=few):
        for one in (None, *(b for b in ones if several[b])):
            others = tuple(b for b in rest if b != one)
            if others not in known_beside:
                known_beside[others] = _Gains.beside(s, others, several)
            found = known_beside[others]
            own = () if one is None else (s.owner[one],)
            near = found.near if few else np.array([] if one is None else [one], dtype=np.intp)
            acting = {s.owner[b] for b in others}
            apart = c.not_beside(sum(1 << j for j in acting)) if c.apart else 0
            for j in sorted({*c.owner[near].tolist(), *own} - acting):
                changes = (j in own or touched >> j & 1) and not apart >> j & 1
                if found.large[j] and changes and (key := (frozenset(others), j)) not in seen:
                    seen.add(key)
                    every = np.flatnonzero(c.owner == j)
                    blocks = every if few and j in own else np.intersect1d(near, every)
                    best_first = np.argsort(-found.gains[blocks], kind="stable")
                    yield others, found.rss, float(found.known[j]), blocks[best_first]


def _left_out(s: Search, *, few: bool) -> Iterator[tuple[_Blocks, _Blocks, int]]:
    """The best sets, and of few readings these without one cause.

    With those of which one more is left out, and the candidates that are looked at then (bits):
    those that the first has something in common with. What others explain is the same beside it.
    """
    for f in s.found[:COMPANIES]:
        yield f.blocks, f.blocks, -1
        for part, touched in s.reach.parts(f.blocks) if few else ():
            for k in part:
                rest = tuple(b for b in f.blocks if b != k)
                yield rest, tuple(b for b in part if b != k), touched


def _above_neighbours(owner: Integers, gains: Floats) -> Floats:
    """How much more the gain of each block is than the lower one of its candidate's neighbours."""
    same = np.append(owner[1:] == owner[:-1], False)
    before = np.where(np.append(False, same[:-1]), np.append(0.0, gains[:-1]), gains)
    after = np.where(same, np.append(gains[1:], 0.0), gains)
    return np.asarray(gains - np.minimum(np.minimum(before, after), gains))
