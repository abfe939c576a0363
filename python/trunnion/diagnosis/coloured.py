"""Candidates where the noise has a smooth process: from their inner products, not from readings.

A process of covariance ``more`` in orthonormal columns B makes the noise white by W, and
``W' W = 1 - B D B'`` with ``D = 1 - 1 / (1 + more)``. So the inner products of white columns are
those before, less what both have in common with B. Blocks are made orthonormal again by their
triangular factors.
"""

from collections.abc import Iterable, Sequence
from copy import copy
from typing import TypeAlias

import numpy as np

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.whitening import Coloured

Turns: TypeAlias = list[tuple[Integers, Floats]]
"""Of the blocks of each rank k: numbers of their columns (b, k), what these are turned by."""


class InProcess(Candidates):
    """Candidates in noise that is to be whitened so beside the basis.

    None of their columns is made: a search asks for inner products only.
    """

    def __init__(self, c: Candidates, whiten: Coloured) -> None:
        self.__dict__.update(vars(copy(c)))
        self._before, self._whiten = c, whiten
        self._shared = c.products(whiten.basis)  # (M, k)
        one = np.eye(len(whiten.more))
        self._share = one - np.linalg.inv(one + whiten.more)
        self._turns: dict[int, Floats] = {}  # of the blocks of each rank, in order
        left = np.ones(len(self.owner))  # of the length of a column, mean of a block
        self.kept = np.ones(len(self.owner))
        for k, blocks, at in c.by_rank:
            own = self._shared[at]
            gram = np.eye(k) - own @ self._share @ own.transpose(0, 2, 1)
            # A column keeps its direction: a negative size may say nothing.
            lower = np.linalg.cholesky(gram)
            left[blocks] = np.diagonal(lower, axis1=1, axis2=2).mean(axis=1)
            self.kept[blocks] = np.diagonal(gram, axis1=1, axis2=2).mean(axis=1)
            self._turns[k] = np.linalg.inv(lower).transpose(0, 2, 1)
        self.kept = self.kept * c.kept
        self.stated = {
            j: std * float(left[self.owner == j].mean())
            for j, std in c.stated.items()
            if j in self.owner
        }
        self._gram_rows, self._last, self._known = {}, None, None

    def products(self, r: Floats) -> Floats:
        """Inner products of all columns with white residuals (n,), shape (M,)."""
        before = self._before.products(np.asarray(self._whiten(r)))
        return np.asarray(_turned(before[None], self._every)[0])

    def prepare(self, blocks: Iterable[int]) -> None:
        """Calculate :meth:`gram_rows` of several blocks at once."""
        missing = [b for b in dict.fromkeys(blocks) if b not in self._gram_rows]
        if not missing:
            return
        self._before.prepare(missing)
        rows = np.concatenate([self._before.gram_rows(b) for b in missing])
        at, own = self._among(missing)
        rows = rows - (self._shared[at] @ self._share) @ self._shared.T
        rows = np.ascontiguousarray(_turned(_turned(rows, self._every).T, own).T)
        ends = np.cumsum(self.rank[missing])[:-1]
        self._gram_rows |= dict(zip(missing, np.split(rows, ends), strict=True))

    def gram(self, blocks: Sequence[int]) -> Floats:
        """Inner products of the columns of blocks with each other, (K, K)."""
        at, own = self._among(blocks)
        shared = self._shared[at]
        gram = self._before.gram(blocks) - shared @ self._share @ shared.T
        return _turned(_turned(gram, own).T, own)

    @property
    def _every(self) -> Turns:
        return [(at, self._turns[k]) for k, _, at in self.by_rank]

    def _among(self, blocks: Sequence[int]) -> tuple[Integers, Turns]:
        """Columns of some blocks, and what these are turned by, by their numbers among these."""
        some = np.asarray(blocks, dtype=np.intp)
        rank = self.rank[some]
        first = np.cumsum(rank) - rank
        within = np.arange(int(rank.sum())) - np.repeat(first, rank)
        turns = []
        for k, those, _ in self.by_rank:
            mine = rank == k
            place = np.searchsorted(those, some[mine])
            turns.append((first[mine][:, None] + np.arange(k), self._turns[k][place]))
        return np.repeat(self.start[some], rank) + within, turns


def _turned(x: Floats, turns: Turns) -> Floats:
    """Columns of products (q, M), those of each block turned."""
    out = np.array(x)
    for at, turn in turns:
        if turn.shape[1] == 1:
            out[:, at[:, 0]] *= turn[:, 0, 0]
        else:
            out[:, at] = (x[:, at].transpose(1, 0, 2) @ turn).transpose(1, 0, 2)
    return out
