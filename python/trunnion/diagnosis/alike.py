"""Which terms of structure are what causes make: they compete with no cause.

A sentence that says what depends on what is more than a name, unless a cause makes just that.
"""

from collections.abc import Sequence

import numpy as np

from trunnion.base.units import Flags, Floats
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.columns import inners
from trunnion.diagnosis.functions import DEPENDENT
from trunnion.diagnosis.selection import Found
from trunnion.diagnosis.terms import directions

SAME = 0.9  # correlation from which a cause makes what a term does
SAME_SHARE = 1e-3  # of the variance of a term, that causes which make it may leave
# Singular value of unit columns, from which they make one more direction of a term.
MIN_OF_A_WAY = 0.3


class Alike:
    """Some terms, and what each block of the candidates makes of them.

    ways: Orthonormal directions of each term that are not always fitted, (n, k).
    made: Share of each direction that each block makes, (b, k).
    """

    def __init__(self, case: Case, terms: Sequence[int]) -> None:
        self._case, self._terms = case, terms
        self.ways = {term: directions(case, term) for term in terms}
        every = [np.zeros((len(case.plain.white), 0)), *self.ways.values()]
        ends = np.cumsum([own.shape[1] for own in every])
        gains = case.candidates.gains(np.concatenate(every, axis=1))
        self.made = dict(zip(terms, np.split(gains, ends[:-1], axis=1)[1:], strict=True))

    def with_a_name(self) -> set[int]:
        """Terms that a cause alone makes: readings that show them show the cause.

        Or, beside what is linear, all that any smooth function of their quantity makes. Causes that
        make much of anything do not count. One of sizes of its own in each class of readings makes
        a term if it does by one size in all: others that agree are a coincidence. Of a term in all
        components at once a cause of no more columns has to make just that: a knock nearly is a
        drift, and what it does to each component tells which of the two.
        """
        c, d, found = self._case.candidates, self._case.dictionary, set[int]()
        free = np.flatnonzero(np.isfinite(c.penalty) & ~np.isin(c.owner, [*c.near_any]))
        rank = c.rank[free]
        for term, ways in self.ways.items():
            nearly = (rank > ways.shape[1]) | (term < d.count)
            least = np.where(nearly, SAME**2, 1.0 - SAME_SHARE)
            seen = self.made[term][free].mean(axis=1) if ways.shape[1] else np.ones(len(free))
            for b in np.flatnonzero((seen > least) & (rank > ways.shape[1])).tolist():
                seen[b] = min(seen[b], self._of_one_size(int(free[b]), ways))
            if np.any(seen > least) or not ways.shape[1]:
                found.add(term)
        in_each = {i: d.in_each(i) for i in self._terms if i not in found}
        smooth = {k: self._smooth(k) for every in in_each.values() for k in every}
        widest = {k for k in smooth.values() if k is not None}
        made_by_one = {k for k in widest if c.makes_any(d.block(k), self._case.plain.basis)}
        same = {i for i, every in in_each.items() if {smooth[k] for k in every} <= made_by_one}
        return found | same

    def _smooth(self, term: int) -> int | None:
        """Return the term of all polynomials of the quantity of a term, if it is one of them."""
        d = self._case.dictionary
        every: list[int] = d.of_kind("polynomial").tolist()
        if term not in every:
            return None
        same = ((i, d.term(i)) for i in reversed(every))
        of = d.term(term)
        return next(
            i for i, x in same if (x.covariate, x.component) == (of.covariate, of.component)
        )

    def _of_one_size(self, block: int, ways: Floats) -> float:
        """Share of directions (n, k) that a block makes by one size in all classes of readings."""
        case, c = self._case, self._case.candidates
        j = int(c.owner[block])
        spread = case.effects[j].spread
        if spread is None:
            return 1.0
        made = case.white(spread.functions(case.values[j][int(c.variant[block])]).T)
        basis = case.plain.basis
        own = np.linalg.qr(made - basis @ (basis.T @ made))[0]
        return float(np.mean(np.sum((ways.T @ own) ** 2, axis=1)))

    def holding_causes(self) -> set[int]:
        """Terms in all components at once that have a cause in them: they would take its place.

        A polynomial of time in X and Y is a drift of X, too, beside what else it is.
        """
        at_once = (i for i in self._terms if i >= self._case.dictionary.count)
        return {i for i in at_once if np.any(self._inside(i, SAME**2))}

    def made_of_causes(self) -> set[int]:
        """Terms that consist of causes: each makes a part of it, and together they make all.

        A first harmonic of the angle of a circle, along X, is a scale of X and a squareness.
        """
        c, found = self._case.candidates, set[int]()
        for term, ways in self.ways.items():
            inside = self._inside(term, 1.0 - SAME_SHARE)
            parts = [c.columns(int(b)) @ ways for b in np.flatnonzero(inside)]
            if (
                parts
                and np.linalg.matrix_rank(np.concatenate(parts), tol=MIN_OF_A_WAY) == ways.shape[1]
            ):
                found.add(term)
        return found

    def _inside(self, term: int, least: float) -> Flags:
        """Blocks of fewer columns with more than a share ``least`` of these in a term, (b,)."""
        c = self._case.candidates
        fewer = np.isfinite(c.penalty) & (c.rank < self.ways[term].shape[1])
        return np.asarray(fewer & (self.made[term].sum(axis=1) > least * c.rank))


def sums_of_causes(case: Case, terms: Sequence[int], best: Found) -> set[int]:
    """Terms of which causes of a set together make all, by no more than one coincidence.

    Opposite backlashes of X and Y are a second harmonic of the approach azimuth where touches go
    along the axes only: that two sizes are equal is nothing rare on one machine, that three are is.
    A cubic is no sum of causes that are each larger than it and cancel. All is decided on inner
    products.
    """
    if not (best.blocks and terms):
        return set()
    c, rows = case.candidates, [case.dictionary.block(term).T for term in terms]
    columns = np.concatenate(rows).T
    taken = case.plain.basis.T @ columns
    # The columns of causes are orthogonal to the basis: theirs are those of what it leaves, too.
    along = np.concatenate(inners([c.columns(b) for b in best.blocks], columns))
    gram, count = c.gram(best.blocks), c.rank[list(best.blocks)]
    ends = np.cumsum([len(x) for x in rows])
    found = set()
    for term, x, t, own in zip(
        terms, rows, *(np.split(a, ends[:-1], axis=1) for a in (taken, along)), strict=True
    ):
        square, ways = np.linalg.eigh(x @ x.T - t.T @ t)
        ways = ways[:, square > DEPENDENT] / np.sqrt(square[square > DEPENDENT])
        of_ways = own @ ways
        sizes = np.linalg.lstsq(gram, of_ways, rcond=c.dependent**2)[0]
        left = 1.0 - 2.0 * np.sum(of_ways * sizes, axis=0) + np.sum(sizes * (gram @ sizes), axis=0)
        # columns of a block are orthonormal, so that sizes are those of what they make
        made = np.add.reduceat(sizes**2, np.cumsum(count) - count).max(axis=1, initial=0.0)
        same = left.max(initial=0.0) < SAME_SHARE and made.max() < 1.0 + SAME_SHARE
        if same and count[made > SAME_SHARE].sum() <= ways.shape[1] + 1:
            found.add(term)
    return found
