"""Structure without a name: which terms may stand for causes, and which say what they leave."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import special

from trunnion.base.statistics import MANY_ROWS, Spanned
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.columns import inners
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.functions import DEPENDENT
from trunnion.diagnosis.moments import moments_of, without_one
from trunnion.diagnosis.scan import SCAN_LEVEL, UNNAMED_TERM_PENALTY
from trunnion.diagnosis.scorer import SCORE_DIGITS
from trunnion.diagnosis.selection import WITHIN, Found
from trunnion.diagnosis.term import Place, Term
from trunnion.diagnosis.whitening import Whiteners

MAX_TERMS = 10
MAX_SENTENCES = 3
MAX_SUMS = 64  # of causes of a set that are compared with terms, those of few first
LARGE = 30.0  # of -2 ln L, a gain of which the scan's places may miss what decides between causes
MIN_LEFT = 1e-14  # of a sum of squares: rounding
OF_OTHERS = 1e-12  # of squares: rounding of what is fitted in other readings, too
TINY = 1e-300


class Competing(NamedTuple):
    """A term that competes with causes; a jump or a local error at places between the scan's."""

    term: int
    places: tuple[Place, ...] = ()


def term_penalty(case: Case, f: Fit) -> Floats:
    """Penalty of terms beside a fit, on the scale of the penalties of causes."""
    return case.dictionary.chance(f) * case.term_inflation(f) + UNNAMED_TERM_PENALTY


def one_term_score(case: Case, plain: Fit) -> float:
    """Score of the best single term on the plain model."""
    d = case.dictionary
    found, rank = d.of_fit(plain)
    gain = d.refined(found[:, None], plain.white[:, None], plain.basis)[:, 0]
    m = plain.dof
    left = case.floor.deviance(np.maximum(plain.rss - gain, MIN_LEFT * plain.rss), m)
    penalty = term_penalty(case, plain) * m / np.maximum(m - rank - 1, 1)
    return float(np.min(np.where(rank > 0, left + penalty, np.inf), initial=np.inf))


def stands_for_causes(case: Case, best: Found) -> bool:
    """Whether one term explains more than a set, or about what several of its causes do together.

    Causes that add up to a cubic none of them makes are a cubic, perhaps. One that has sizes of its
    own in each class of readings may be what is alike in all of them.
    """
    if any(case.effects[j].spread is not None for j in best.members):
        return True
    if len(best.blocks) < 2:
        return False
    if one_term_score(case, case.plain) < best.score:
        return True
    plain, d = case.plain, case.dictionary
    made = _Made.of(case, best, 2)
    if not len(made.paid):  # each in a measurement of its own
        return False
    gain, rank = d.gains(made.columns, plain.basis, made.weights)
    gain = d.refined(gain, made.columns, plain.basis, made.weights)
    left = made.squares - gain
    worse = left / case.floor.noise(best.rss, plain.dof) - made.paid
    worse += term_penalty(case, plain)[:, None]
    return bool(np.any(worse[rank > 0] < 2 * WITHIN))


def standing_at_once(case: Case, best: Found) -> list[int]:
    """Terms in all components at once that may be there instead of some causes of a set.

    Or of one: no term of one component says what such a term does, so that causes of the other
    components would say the rest. Likeliest first, two at most of a covariate and kind.
    """
    d, plain = case.dictionary, case.plain
    if not (best.blocks and d.at_once):
        return []
    instead = _Instead.of(case, best)
    gain, rank, penalty = _at_once(case, plain, *instead.gains())
    about = np.where(rank > 0, instead.worse(gain, penalty), np.inf)
    some = np.flatnonzero(about < 2 * WITHIN)
    value = instead.exactly((d.count + some).tolist(), penalty[some])
    order = np.argsort(value, kind="stable")
    return _few_of_a_kind(case, d.count + some[order[value[order] < 2 * WITHIN]])


@dataclass(frozen=True, eq=False)
class _Made:
    """What some causes of a set make together: sums of what each of them makes.

    columns: What each makes, (n, c). weights: Of each in the sums, (c, s). paid: Penalties of the
    causes of each sum, (s,).
    """

    columns: Floats
    weights: Floats
    paid: Floats

    @classmethod
    def of(cls, case: Case, best: Found, least: int) -> "_Made":
        """Return that of ``least`` or more causes of a set."""
        parts = _parts(case, best, case.plain.white)
        together = _together(case, parts, least)
        weights = np.zeros((len(parts), len(together)))
        for i, some in enumerate(together):
            weights[list(some), i] = 1.0
        paid = case.candidates.penalty[list(best.blocks)] @ weights
        return cls(np.stack(parts, axis=1), weights, np.asarray(paid))

    def beside(self, left: Floats) -> "_Made":
        """Return the same with what is left beside all causes of the set, (n,)."""
        columns = np.column_stack([self.columns, left])
        weights = np.concatenate([self.weights, np.ones((1, len(self.paid)))])
        return replace(self, columns=columns, weights=weights)

    @cached_property
    def squares(self) -> Floats:
        """Sum of squares of each sum, (s,)."""
        products = self.columns.T @ self.columns
        return np.asarray(np.einsum("is,is->s", self.weights, products @ self.weights))


@dataclass(frozen=True, eq=False)
class _Instead:
    """What some causes of a set make, with what the set leaves: a term may be there instead.

    least: -2 ln L that the set has, with what these causes cost (s,).
    """

    case: Case
    made: _Made
    least: Floats

    @classmethod
    def of(cls, case: Case, best: Found) -> "_Instead":
        """Return that of a set."""
        white, dof = case.plain.white, case.plain.dof
        made = _Made.of(case, best, 1)
        made = made.beside(white - made.columns.sum(axis=1))
        return cls(case, made, case.floor.deviance(best.rss, dof) + made.paid)

    def gains(self) -> tuple[Floats, Integers]:
        """Gains of the terms of one component, (t, s), and how many columns they add, (t,)."""
        d, basis = self.case.dictionary, self.case.plain.basis
        return d.gains(self.made.columns, basis, self.made.weights)

    def worse(self, gain: Floats, penalty: Floats) -> Floats:
        """By how much less is explained with terms instead, which gain so much, (t, s): (t,)."""
        plain, floor = self.case.plain, self.case.floor
        left = np.maximum(self.made.squares - gain, MIN_LEFT * plain.rss)
        more = np.min(floor.deviance(left, plain.dof) - self.least, axis=1, initial=np.inf)
        return np.asarray(more + penalty)

    def exactly(self, terms: Sequence[int], penalty: Floats) -> Floats:
        """Return the same by all that terms add to what is fitted, (t,)."""
        columns, weights = self.made.columns, self.made.weights
        each = [
            np.sum((directions(self.case, i).T @ columns @ weights) ** 2, axis=0) for i in terms
        ]
        return self.worse(np.reshape(each, (len(terms), weights.shape[1])), penalty)


def with_places(case: Case, terms: Sequence[int], fits: Sequence[Fit]) -> list[Competing]:
    """Terms, and of jumps and local errors the places at which they gain most beside some fits.

    A reading on the wrong side of a jump costs more than causes that are not there, and so does
    what a large local error leaves of one a little narrower.
    """
    d, jumps = case.dictionary, set(case.dictionary.of_kind("jump").tolist())
    places: dict[int, set[Place]] = {i: set() for i in terms}
    for i in jumps.intersection(terms):
        places[i] |= {d.place_of_jump(i, f.white, f.basis)[0] for f in fits}
    for i, place in _places_of_local(case, terms, fits):
        places[i].add(place)
    return [Competing(i, tuple(sorted(places[i]))) for i in terms]


def _places_of_local(
    case: Case, terms: Sequence[int], fits: Sequence[Fit]
) -> Iterator[tuple[int, Place]]:
    """Local errors, those that gain most of a quantity in a component, and where they do.

    Beside some fits, and beside these without one cause that acts in the same measurement: a bump
    that the cause makes in part is another one beside it.
    """
    d = case.dictionary
    every = sorted(set(d.of_kind("local").tolist()).intersection(terms))
    for f in fits if every else ():
        beside: list[tuple[Floats | Spanned, Floats, list[int]]] = [(f.basis, f.white, every)]
        # of many readings the bases take time
        for e in case.effects if len(f.white) < MANY_ROWS else ():
            if e.id in f.effects:
                changed = _changed(case, e, f)[case.rows]
                if some := [i for i in every if np.any(changed[d.readings(i)])]:
                    beside.append((*without_one(case, e, f), some))
        for basis, left, some in beside:
            least = float(left @ left) * -np.expm1(-LARGE / f.dof)
            best: dict[tuple[str, str], tuple[float, int, Place]] = {}
            for i in some:
                place, gain = d.place_of_local(i, left, basis, least)
                key = d.term(i).covariate, d.term(i).component
                best[key] = max(best.get(key, (least, i, place)), (gain, i, place))
            yield from ((i, place) for gain, i, place in best.values() if gain > least)


def jumps_instead(case: Case, f: Fit) -> list[Competing]:
    """Jumps that may be there instead of a cause of a fit that begins at a moment.

    In each component that which explains most, of readings that the cause changes.
    """
    places: dict[int, set[Place]] = {}
    for effect in case.effects:
        if effect.id in f.effects and moments_of(case, effect, f):
            basis, left = without_one(case, effect, f)
            changed = _changed(case, effect, f)
            for i, place in case.dictionary.best_jumps(left, basis, changed):
                places.setdefault(i, set()).add(place)
    return [Competing(i, tuple(sorted(some))) for i, some in places.items()]


def _changed(case: Case, effect: Effect, f: Fit) -> Flags:
    """Which readings an effect of a fit changes, (n,)."""
    return np.asarray(np.any(f.jacobian[:, case.columns_of(effect, f)] != 0.0, axis=1))


def _together(case: Case, parts: Sequence[Floats], least: int) -> list[tuple[int, ...]]:
    """``least`` or more causes that act in one measurement, of those of a set; few of them first.

    A term of one measurement stands for nothing of another one.
    """
    whole = [slice(None)]
    measured = [at for at, _ in case.whiten.parts] if isinstance(case.whiten, Whiteners) else whole
    acting = [[i for i, own in enumerate(parts) if np.any(own[at])] for at in measured]
    sizes = range(least, max(map(len, acting)) + 1)
    every = (itertools.combinations(some, k) for k in sizes for some in acting)
    distinct = dict.fromkeys(itertools.chain.from_iterable(every))
    return list(itertools.islice(distinct, MAX_SUMS))


def _parts(case: Case, f: Found, whole: Floats) -> list[Floats]:
    """What each cause of a set makes of what they make together of some columns, each (n, ...)."""
    columns = [case.candidates.columns(b) for b in f.blocks]
    sizes = _sizes(case, f, columns, whole)
    return [x.T @ own for x, own in zip(columns, sizes, strict=True)]


def _sizes(case: Case, f: Found, columns: Sequence[Floats], whole: Floats) -> list[Floats]:
    """Sizes in some columns of the causes of a set, of each block of its ``columns``."""
    c = case.candidates
    if len(whole) < MANY_ROWS:
        sizes = np.linalg.lstsq(np.concatenate(columns).T, whole, rcond=c.dependent)[0]
    else:  # the search has their inner products; these have the square of the singular values
        products = np.concatenate(inners(columns, whole))
        sizes = np.linalg.lstsq(c.gram(f.blocks), products, rcond=c.dependent**2)[0]
    return np.split(sizes, np.cumsum([len(x) for x in columns])[:-1])


def _evidence(case: Case, f: Fit, gain: Floats, rank: Integers, penalty: Floats) -> Floats:
    """Drop of -2 ln L of terms less their penalties, shapes (t,)."""
    left = np.maximum(f.rss - gain, MIN_LEFT * f.rss)
    drop = case.floor.deviance(f.rss, f.dof) - case.floor.deviance(left, f.dof)
    value = np.where(rank > 0, drop - penalty, -np.inf)
    # Terms that say the same are ordered by the dictionary, not by rounding.
    return np.asarray(np.round(value, SCORE_DIGITS))


def _of_each(case: Case, f: Fit) -> Floats:
    """Evidence of each term beside a fit, (t,)."""
    return _evidence(case, f, *case.dictionary.of_fit(f), term_penalty(case, f))


def _of_all(case: Case, f: Fit) -> Floats:
    """Evidence of each term in all components at once beside a fit, (s,)."""
    return _evidence(case, f, *_at_once(case, f, *case.dictionary.of_fit(f)))


def _at_once(case: Case, f: Fit, gain: Floats, rank: Integers) -> tuple[Floats, Integers, Floats]:
    """Gains, ranks and penalties of terms in all components at once (s, ...).

    From ``gain`` and ``rank`` of the terms of one component (t, ...). Approximate: as if what the
    components make were orthogonal beside a fit.
    """
    d, several = case.dictionary, case.dictionary.at_once
    if not several:
        return gain[:0], rank[:0], np.zeros(0)
    members, first = np.concatenate(several), np.cumsum([0, *map(len, several[:-1])])
    gain, rank = (np.add.reduceat(x[members], first, axis=0) for x in (gain, rank))
    more = np.maximum.reduceat(case.term_inflation(f)[members], first)
    return gain, rank, d.chance_of(rank) * more + UNNAMED_TERM_PENALTY


def by_rounding(case: Case, terms: Sequence[int]) -> Floats:
    """What terms gain more by rounding than by noise beside the plain model, of -2 ln L (t,)."""
    d, plain = case.dictionary, case.plain
    factor, rank = case.term_inflation(plain), d.of_fit(plain)[1]
    members = [list(d.in_each(i)) for i in terms]
    more = np.array([factor[own].max() - 1.0 for own in members])
    return np.asarray(more * d.chance_of(np.array([rank[own].sum() for own in members])))


def directions(case: Case, term: int) -> Floats:
    """Directions of a term that are not always fitted, orthonormal (n, k).

    Zero in other measurements than that of the term, unless something is fitted in several.
    """
    d, at = case.dictionary, case.dictionary.readings(term)
    columns, basis = d.own_block(term), case.plain.basis[at]
    taken = basis.T @ columns
    within = basis @ taken
    out = np.zeros((len(case.plain.basis), columns.shape[1]))
    if np.sum(taken**2) - np.sum(within**2) > OF_OTHERS * np.sum(columns**2):
        out -= case.plain.basis @ taken
        out[at] += columns
        own, size, _ = np.linalg.svd(out, full_matrices=False)
        return np.asarray(own[:, size**2 > DEPENDENT])
    own, size, _ = np.linalg.svd(columns - within, full_matrices=False)
    out[at] = own
    return np.asarray(out[:, size**2 > DEPENDENT])


def promising(case: Case, best: Found, fits: Sequence[Fit], *, at_once: bool) -> list[int]:
    """Terms with the most evidence under each fit, two at most of a covariate and kind.

    Those of one component and, if ``at_once``, as many in all at once. None that explains next to
    nothing beside any of the fits, nor instead of causes of the best set.
    """
    picked, evident = list[int](), set[int]()
    for f in fits:
        found = [(0, _of_each(case, f))]
        found += [(case.dictionary.count, _of_all(case, f))] if at_once else []
        for first, value in found:
            picked += _few_of_a_kind(case, first + np.argsort(-value, kind="stable"), picked)
            evident |= {first + int(i) for i in np.flatnonzero(value > -2 * WITHIN)}
    rest = [i for i in picked if i not in evident]
    if rest and best.blocks:
        worse = _Instead.of(case, best).exactly(rest, _penalties(case, rest))
        evident |= {i for i, more in zip(rest, worse.tolist(), strict=True) if more < 2 * WITHIN}
    return [i for i in picked if i in evident]


def _penalties(case: Case, terms: Sequence[int]) -> Floats:
    """Penalty of some terms beside the plain fit (t,)."""
    plain, d = case.plain, case.dictionary
    each, together = term_penalty(case, plain), _at_once(case, plain, *d.of_fit(plain))[2]
    return np.array([each[i] if i < d.count else together[i - d.count] for i in terms])


def _few_of_a_kind(case: Case, order: Integers, known: Sequence[int] = ()) -> list[int]:
    """The first of some terms that are not known, two at most of a covariate and kind."""
    per: dict[tuple[str, str], int] = {}
    picked: list[int] = []
    for i in map(int, order):
        term = case.dictionary.term(i)
        key = (term.covariate, term.kind)
        if per.get(key, 0) < 2 and i not in known:
            per[key] = per.get(key, 0) + 1
            picked.append(i)
        if len(picked) >= MAX_TERMS:
            break
    return picked


def _lowest_degree(case: Case, f: Fit, term: int) -> int:
    """Polynomial of the lowest degree that explains as much as one does but for chance, or a term.

    Of the same quantity in the same component. A degree that is worth its columns among all terms
    may be worth no more than chance beside a lower one, which is in it.
    """
    d = case.dictionary
    every: list[int] = d.of_kind("polynomial").tolist()
    if term not in every:
        return term
    of, (gain, rank) = d.term(term), d.of_fit(f)
    left = case.floor.deviance(np.maximum(f.rss - gain, MIN_LEFT * f.rss), f.dof)
    for i in every:  # degrees ascend
        low, further = d.term(i), int(rank[term] - rank[i])
        if (low.covariate, low.component) == (of.covariate, of.component) and rank[i] > 0:
            chance = special.chdtri(further, SCAN_LEVEL) if further > 0 else np.inf
            if left[i] - left[term] < chance:
                return i
    return term


def best_terms(case: Case, fitted: Fit) -> list[tuple[Term, float]]:
    """Terms that explain the unnamed part about as well, one a quantity, best first."""
    d, value = case.dictionary, _of_each(case, fitted)
    found: dict[str, tuple[Term, float]] = {}
    for i in map(int, np.argsort(-value, kind="stable")):
        if value[i] < value.max() - WITHIN or len(found) >= MAX_SENTENCES:
            break
        if (name := d.term(i).covariate) not in found:
            term, gain = d.placed(_lowest_degree(case, fitted, i), fitted)
            found[name] = term, min(1.0, gain / max(fitted.rss, TINY))
    return list(found.values())
