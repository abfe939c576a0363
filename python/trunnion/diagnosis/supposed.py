"""What may act beside an effect and is no candidate, in the weights of the sets that hold it.

The modes of a smooth shape of a surface have no straight part, a shape has one
(`.model.Model.supposed`). It is supposed to be normal, of 1 sigma as the model says, and sets that
hold the effect are weighed by their likelihood mean over it: a bow that such a part may be is
less certain, and one that it may hide is not excluded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trunnion._core import sizes_of_sets
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.reach import AtVariants
from trunnion.diagnosis.selection import Search

DEPENDENT = 1e-9  # of the Gram matrix: what is supposed may be large and much like a cause


@dataclass(frozen=True, eq=False)
class Supposed:
    """Columns (n, k) that are supposed beside a candidate, with sizes of 1 sigma.

    Attributes
    ----------
    search:
        Of the sets.
    beside:
        Number of the candidate.
    fitted:
        Mask of the candidates that are fitted: sets are weighed without some of them, too.
    columns:
        White, beside what is always fitted.
    white:
        Residuals, (n,).
    variance:
        Of a white reading.
    """

    search: Search
    beside: int
    fitted: int
    columns: Floats
    white: Floats
    variance: float

    def within(self, mask: int) -> bool:
        """Whether it may act in a set."""
        return bool(mask >> self.beside & 1)

    def fewer(self, mask: int, blocks: Sequence[int]) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Masks and blocks of a set and of those without some of its causes that are fitted."""
        owner, bits = self.search.owner, self.search.bits
        some = [b for b in blocks if self.fitted & bits[b] and owner[b] != self.beside]
        for left_out in range(1 << len(some)):
            gone = {b for i, b in enumerate(some) if left_out >> i & 1}
            kept = tuple(b for b in blocks if b not in gone)
            yield mask & ~sum(bits[b] for b in gone), kept

    @cached_property
    def cost(self) -> float:
        """What it adds to -2 ln of the likelihood of each set."""
        gram = self.columns.T @ self.columns / self.variance
        return float(np.linalg.slogdet(gram + np.eye(len(gram)))[1])

    def sizes(
        self, sets: Sequence[Sequence[int]], counted: Flags
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """As `Search.sizes`, of sets with what is supposed."""
        c = self.search.c
        used = sorted({b for one in sets for b in one})
        own = np.concatenate([np.arange(c.width)[c.span(b)] for b in used])
        place, last = {b: i for i, b in enumerate(used)}, len(used)
        gain, together, each, length = sizes_of_sets(
            [[*(place[b] for b in one), last] for one in sets],
            rank=[*c.rank[used].tolist(), self.columns.shape[1]],
            counted=[*counted[used].tolist(), False],
            gram=self._gram(used, own),
            residual=np.concatenate([self.search.residual[own], self._residual]),
            dependent=DEPENDENT,
        )
        ends = np.cumsum([len(one) + 1 for one in sets]) - 1
        return gain, together, np.delete(each, ends), np.delete(length, ends)

    def gain(self, blocks: Sequence[int]) -> float:
        """By how much a set with what is supposed lessens the sum of squares."""
        return float(self.sizes([blocks], np.zeros(len(self.search.owner), dtype=bool))[0][0])

    def at_variants(self, blocks: Sequence[int]) -> Iterator[AtVariants]:
        """As `Reach.at_variants`, of a set with what is supposed."""
        owner = self.search.c.owner
        for b in blocks:
            first, end = np.searchsorted(owner, [owner[b], owner[b] + 1]).tolist()
            if end - first > 1:
                rest = [other for other in blocks if other != b]
                rss, gains = self.gains_beside(rest, range(first, end))
                yield AtVariants.of([(b - first, rss - gains)])

    def gains_beside(self, blocks: Sequence[int], further: range) -> tuple[float, Floats]:
        """As `Reach.gains_beside`, of blocks with what is supposed."""
        c, s = self.search.c, self.search
        tried = np.concatenate([np.arange(c.width)[c.span(b)] for b in further])
        taken, along = self._taken(blocks, tried)
        left = s.residual[tried] - taken.T @ along
        rank, gain = c.rank[further.start : further.stop], np.zeros(len(further))
        first = np.cumsum(rank) - rank
        for k in np.unique(rank).tolist():
            at = first[rank == k][:, None] + np.arange(k)
            made = taken.T[at]  # (b, k, what is taken)
            values, own_ways = np.linalg.eigh(np.eye(k) - made @ made.transpose(0, 2, 1))
            squares = np.einsum("bji,bj->bi", own_ways, left[at]) ** 2
            free = values > c.dependent
            gain[rank == k] = np.sum(np.where(free, squares, 0) / np.where(free, values, 1), axis=1)
        return s.empty.core.rss - float(along @ along), gain

    def left_by(self, blocks: Sequence[int]) -> tuple[Floats, Floats, float, int]:
        """As `Search.beside`, with what is supposed; the sum of squares, count of columns."""
        c, s = self.search.c, self.search
        taken, along = self._taken(blocks, np.arange(c.width))
        free = 1.0 - np.sum(taken**2, axis=0)
        seen = (s.residual - taken.T @ along) ** 2
        seen = np.where(free > c.dependent, seen / np.maximum(free, c.dependent), 0.0)
        total = np.cumsum(np.stack([np.maximum(free, 0.0), seen]), axis=1)
        total = np.concatenate([np.zeros((2, 1)), total], axis=1)
        left, seen = (total[:, c.start + c.rank] - total[:, c.start]) / c.rank
        rss = s.empty.core.rss - float(along @ along)
        return left, seen, rss, int(c.rank[list(blocks)].sum())

    def _taken(self, blocks: Sequence[int], tried: Integers) -> tuple[Floats, Floats]:
        """Inner products of a basis of blocks and what is supposed with columns (K, m), residuals.

        ``tried``: numbers of the columns.
        """
        c = self.search.c
        own = np.concatenate([np.arange(c.width)[c.span(b)] for b in blocks])
        c.prepare(blocks)
        rows = [c.gram_rows(b)[:, tried] for b in blocks]
        size, ways = np.linalg.eigh(self._gram(blocks, own))
        seen = size > DEPENDENT
        basis = (ways[:, seen] / np.sqrt(size[seen])).T
        taken = basis @ np.concatenate([*rows, self._along[tried].T])
        return taken, basis @ np.concatenate([self.search.residual[own], self._residual])

    def _gram(self, blocks: Sequence[int], own: Integers) -> Floats:
        """Gram matrix of blocks with columns ``own``, and of what is supposed."""
        k, many = len(own), self.columns.shape[1]
        out = np.zeros((k + many, k + many))
        if k:
            out[:k, :k] = self.search.c.gram(blocks)
        out[k:, :k] = self._along[own].T
        out[:k, k:] = out[k:, :k].T
        out[k:, k:] = self._inner
        return out

    @cached_property
    def _length(self) -> Floats:
        """Of the columns with their sizes of 1 sigma, in units of the noise, (k,)."""
        return np.asarray(np.sqrt(np.sum(self.columns**2, axis=0) + self.variance))

    @cached_property
    def _inner(self) -> Floats:
        """Inner products of unit columns; more on the diagonal is what keeps sizes to 1 sigma."""
        gram = self.columns.T @ self.columns + self.variance * np.eye(self.columns.shape[1])
        return np.asarray(gram / np.outer(self._length, self._length))

    @cached_property
    def _along(self) -> Floats:
        """Inner products with the columns of all candidates, (M, k)."""
        return np.asarray(self.search.c.products(self.columns / self._length))

    @cached_property
    def _residual(self) -> Floats:
        return np.asarray((self.columns / self._length).T @ self.white)
