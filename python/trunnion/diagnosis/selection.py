"""Which sets of causes explain the residuals best.

Everything here is linear algebra on arrays: residuals ``r`` of the plain model and, for every
candidate, the columns by which it would change them. What the nuisance parameters can absorb is
projected out first, so that a candidate is judged by what only it can explain.

A set of causes S with K columns, of m degrees of freedom left by the nuisance, is scored by ::

    score(S) = m ln RSS(S) + m / (m - K - 1) * sum of penalties

that is -2 ln L, profiled over the noise (which is never taken as known), with the small-sample
factor of AICc. The penalty of a cause with k columns is the quantile of chi² with k degrees of
freedom at the family-wise level divided by the number of candidates (times the number of places a
nonlinear parameter can take): a cause is worth its name if it gains what no candidate would gain
by chance.

The search is over sets, not one cause after the other: a beam keeps the best sets of each size,
then every cause of the best sets is tried against every other.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import special

from trunnion.base.units import Floats as Array
from trunnion.base.units import Integers as IntArray

Flags: TypeAlias = NDArray[np.bool_]
Piece: TypeAlias = tuple[int, Array]  # candidate, some of its variants (v, n, k)

__all__ = ["Candidates", "Found", "search", "storage"]

NONE = np.zeros(0, dtype=np.intp)

# Relative size of a squared column below which it counts as dependent on the others (0.3 % of its
# length). Exact dependencies of a perfect machine are broken in second order by the errors of the
# real one (1e-3 rad), which helps nobody: the parameter would have to be a thousand times as large.
DEPENDENT = 1e-5

# "Within 6 of the best": a likelihood ratio of exp(3) = 20.
WITHIN = 6.0

NAMING_LEVEL = 0.01
BEAM = 20
ROUNDING = 1e-10  # of the longest column: sin 180°
MAX_DOUBLES = 1 << 25  # numbers that are kept in double precision, 256 MiB
BATCH_NUMBERS = 1 << 21  # numbers that are worked on at once
SCORE_DIGITS = 6
MAX_CAUSES = 12
WIDE = 12  # columns of a block above which one matrix at a time is faster than pivot by pivot


@dataclass(frozen=True)
class Found:
    """One set of causes: score (lower is better), rest, columns, and the variant of each cause."""

    members: frozenset[int]
    score: float
    rss: float
    columns: int
    blocks: tuple[int, ...]


class Candidates:
    """Columns of all candidates, after the nuisance parameters took what they can.

    Parameters
    ----------
    variants:
        For each candidate its columns, shape (v, n, k): v = 1 for a linear candidate, else one
        entry for each value of its nonlinear parameters.
    basis:
        Orthonormal basis of what the nuisance parameters absorb, shape (n, p).
    level:
        Family-wise level at which a cause is named: shared by the candidates that can be seen.
    own_level:
        For each candidate a level of its own, or 0 for its share of ``level``.
    own_price:
        For each candidate what is added to its penalty.
    """

    def __init__(
        self,
        variants: Sequence[Array],
        basis: Array,
        level: float = NAMING_LEVEL,
        own_level: Array | None = None,
        own_price: Array | None = None,
    ) -> None:
        numbers = sum(v.size for v in variants)
        self._build(enumerate(variants), len(variants), numbers, basis)
        self._complete(basis, level, own_level, own_price)

    @classmethod
    def of_pieces(
        cls, pieces: Iterable[Piece], count: int, numbers: int, basis: Array
    ) -> "Candidates":
        """Candidates of which not all columns are there at a time.

        ``pieces``: number of a candidate and some of its variants, in order; ``count``: of the
        candidates; ``numbers``: of all pieces together.
        """
        new = object.__new__(cls)
        new._build(pieces, count, numbers, basis)
        new._complete(basis, NAMING_LEVEL, None, None)
        return new

    def _build(self, pieces: Iterable[Piece], count: int, numbers: int, basis: Array) -> None:
        """Orthonormalise the columns of each block beside the basis; drop what is dependent."""
        self.count = count
        n, p = basis.shape
        self.dof = n - p
        kind = storage(numbers)
        parts: list[Any] = []  # of single precision where there are very many numbers
        owner, rank, start = [NONE], [NONE], [NONE]
        filled = 0
        for batch in _batches(pieces):
            longest = np.sqrt(max(float(np.max(_squares(v), initial=0.0)) for _, v in batch))
            some = _orthonormal_blocks([v for _, v in batch], basis, ROUNDING * longest)
            parts.append(np.asarray(some[0], dtype=kind))
            owner += [np.full(len(v), j, dtype=np.intp) for j, v in batch]
            rank.append(some[1])
            start.append(some[2] + filled)
            filled += len(some[0])
        self._parts: tuple[Array, ...] = tuple(parts) or (np.zeros((0, n)),)
        self.owner, self.rank, self.start = map(np.concatenate, (owner, rank, start))
        self.variant = np.arange(len(self.owner)) - np.searchsorted(self.owner, self.owner)
        self._keep(self.rank > 0)

    def beside(
        self, variants: Sequence[Array], own_level: Array, own_price: Array | None = None
    ) -> "Candidates":
        """Return these candidates and further ones, numbered after them.

        ``own_level``, ``own_price``: of the further ones only.
        """
        new = object.__new__(Candidates)
        new._build(enumerate(variants), len(variants), 0, self._basis)
        new.owner = np.concatenate([self.owner, new.owner + self.count])
        new.variant = np.concatenate([self.variant, new.variant])
        new.rank = np.concatenate([self.rank, new.rank])
        new.start = np.concatenate([self.start, new.start + self.width])
        new._parts = (*self._parts, *new._parts)
        new.count += self.count
        none = np.zeros(self.count)
        price = np.zeros(len(variants)) if own_price is None else own_price
        new._complete(
            self._basis,
            self._shared_level,
            np.concatenate([none, own_level]),
            np.concatenate([none, price]),
            self.multiplicity,
        )
        return new

    def _complete(
        self,
        basis: Array,
        level: float,
        own_level: Array | None,
        own_price: Array | None,
        multiplicity: float | None = None,
    ) -> None:
        """Group the blocks and price them."""
        self._basis, self._shared_level = basis, level
        self.visible = np.unique(self.owner)
        self.invisible = np.setdiff1d(np.arange(self.count), self.visible)
        self._gram_rows: dict[int, Array] = {}
        self._group()
        own = np.zeros(self.count) if own_level is None else own_level
        shared = np.sum(own[self.visible] == 0) if multiplicity is None else multiplicity
        self.level = np.where(own > 0, own, level / max(shared, 1))
        self.multiplicity = float(shared)
        self.places = self._places()
        self.penalty = special.chdtri(self.rank, self.level[self.owner] / self.places)
        if own_price is not None:
            self.penalty = self.penalty + own_price[self.owner]

    def _keep(self, kept: Flags) -> None:
        """Drop blocks."""
        self.owner, self.variant = self.owner[kept], self.variant[kept]
        self.rank, self.start = self.rank[kept], self.start[kept]

    @property
    def width(self) -> int:
        """Count of columns."""
        return sum(len(part) for part in self._parts)

    def columns(self, block: int) -> Array:
        """Columns of a block, one a row, shape (k, n)."""
        first = int(self.start[block])
        for part in self._parts:
            if first < len(part):
                return part[first : first + int(self.rank[block])]
            first -= len(part)
        return np.zeros((0, 0))

    def gram_rows(self, block: int) -> Array:
        """Inner products of a block's columns with all columns, shape (k, M)."""
        self.prepare([block])
        return self._gram_rows[block]

    def prepare(self, blocks: Iterable[int]) -> None:
        """Calculate :meth:`gram_rows` of several blocks at once."""
        missing = [b for b in dict.fromkeys(blocks) if b not in self._gram_rows]
        if missing:
            some = [self.columns(b) for b in missing]
            rows = self.products(np.concatenate(some).T).T
            ends = np.cumsum([len(x) for x in some])
            self._gram_rows |= dict(zip(missing, np.split(rows, ends[:-1]), strict=True))

    def _group(self) -> None:
        """Find candidates whose columns span the same: one stands for all of them."""
        self.alike: dict[int, list[int]] = {}
        single = np.bincount(self.owner, minlength=self.count) == 1
        alone = self.visible[single[self.visible]]
        at = np.searchsorted(self.owner, alone)
        rank = self.rank[at]
        if len(alone):
            some = np.concatenate([self.columns(int(b)) for b in at])
            squares = np.asarray(some @ some.T, dtype=np.float64) ** 2
            first = np.concatenate([[0], np.cumsum(rank)[:-1]]).astype(np.intp)
            overlap = np.add.reduceat(np.add.reduceat(squares, first, axis=0), first, axis=1)
            same = (np.abs(overlap - rank) < DEPENDENT) & (rank == rank[:, None])
        place = {int(j): i for i, j in enumerate(alone)}
        for j in map(int, self.visible):
            home = j
            if single[j]:
                homes = (i for i in self.alike if single[i] and same[place[i], place[j]])
                home = next(homes, j)
            self.alike.setdefault(home, []).append(j)
        self.leaders = np.array(sorted(self.alike), dtype=np.intp)
        self._keep(np.isin(self.owner, self.leaders))

    def span(self, block: int) -> slice:
        """Columns of a block."""
        return slice(int(self.start[block]), int(self.start[block] + self.rank[block]))

    def _places(self) -> Array:
        """How many independent places the nonlinear parameters of each block's candidate have.

        Going through the values of a nonlinear parameter the gain rises above u about
        ``L / π · sqrt(π u / 2)`` times as often as at one place (Davies 1977, 1987), L being the
        length of the curve that the unit column draws; never more often than there are places.
        """
        out = np.ones(len(self.owner))
        for j in map(int, self.leaders):
            blocks = np.flatnonzero(self.owner == j)
            if len(blocks) < 2:
                continue
            length = 0.0
            for a, b in itertools.pairwise(map(int, blocks)):
                g = self.columns(a) @ self.columns(b).T
                overlap = np.sqrt(np.sum(g * g) / max(g.shape))
                length += float(np.arccos(min(overlap, 1.0)))
            u = special.chdtri(1, self.level[j])
            out[blocks] = min(float(len(blocks)), 1.0 + length / np.pi * np.sqrt(np.pi * u / 2))
        return out

    def products(self, r: Array) -> Array:
        """Inner products of all columns with residuals (n,) or (n, s): shape (M,) or (M, s)."""
        parts = [part @ r.astype(part.dtype, copy=False) for part in self._parts]
        return np.concatenate(parts).astype(np.float64, copy=False)

    def gains(self, r: Array) -> Array:
        """Gain in RSS of every block alone. ``r``: (n,) or (n, s); shape (b,) or (b, s)."""
        z2 = self.products(r) ** 2
        total = np.concatenate([np.zeros((1, *z2.shape[1:])), np.cumsum(z2, axis=0)])
        return np.asarray(total[self.start + self.rank] - total[self.start])

    @cached_property
    def by_rank(self) -> list[tuple[int, IntArray, IntArray]]:
        """Blocks of each rank k: (k, block numbers (b,), column numbers (b, k))."""
        out = []
        for k in np.unique(self.rank):
            blocks = np.flatnonzero(self.rank == k)
            out.append((int(k), blocks, self.start[blocks][:, None] + np.arange(k)))
        return out

    @cached_property
    def first_of_leader(self) -> IntArray:
        """Number of the first block of each leader; blocks of one candidate are neighbours."""
        return np.searchsorted(self.owner, self.leaders)


def _batches(pieces: Iterable[Piece]) -> Iterator[list[Piece]]:
    """Pieces, so many at a time as have not too many numbers together."""
    batch: list[Piece] = []
    for piece in pieces:
        batch.append(piece)
        if sum(v.size for _, v in batch) >= BATCH_NUMBERS:
            yield batch
            batch = []
    if batch:
        yield batch


def _orthonormal_blocks(
    variants: Sequence[Array], basis: Array, least: float
) -> tuple[Array, IntArray, IntArray]:
    """Orthonormalise the columns of each block beside the basis; drop what is dependent.

    Columns no longer than ``least`` count as zero. Returns the columns, one a row, shape (M, n),
    the rank of each block and where it starts.
    """
    width = np.array([v.shape[2] for v in variants for _ in v], dtype=np.intp)
    rank = np.zeros(len(width), dtype=np.intp)
    start = np.zeros(len(width), dtype=np.intp)
    out: list[Array] = []
    filled = 0
    for k in np.unique(width):
        x = np.concatenate([v.transpose(0, 2, 1) for v in variants if v.shape[2] == k])
        size = np.sqrt(np.einsum("bkn,bkn->bk", x, x))
        x /= np.where(size > least, size, np.inf)[:, :, None]
        x -= (x @ basis) @ basis.T
        x, some = _orthonormal(x)
        rank[width == k] = some
        start[width == k] = filled + np.concatenate([[0], np.cumsum(some)[:-1]])
        out.append(x[np.arange(k) < some[:, None]])
        filled += len(out[-1])
    return np.concatenate(out) if out else np.zeros((0, len(basis))), rank, start


def _orthonormal(x: Array) -> tuple[Array, IntArray]:
    """Orthonormalise blocks of rows, shape (b, k, n), largest first; the rest after the rank."""
    if x.shape[1] == 1:
        s2 = np.einsum("bkn,bkn->bk", x, x)
        seen = s2 > DEPENDENT
        x /= np.sqrt(np.where(seen, s2, 1.0))[:, :, None]
        return x, seen.sum(axis=1)
    w, u = np.linalg.eigh(x @ x.transpose(0, 2, 1))
    w, u = w[:, ::-1], u[:, :, ::-1]
    seen = w > DEPENDENT
    scale = np.where(seen, 1.0 / np.sqrt(np.where(seen, w, 1.0)), 0.0)
    return np.asarray((u * scale[:, None, :]).transpose(0, 2, 1) @ x), seen.sum(axis=1)


def _squares(v: Array) -> Array:
    """Squared length of every column of variants (v, n, k)."""
    return np.asarray(np.einsum("vnk,vnk->vk", v, v))


def storage(numbers: int) -> type[np.float32 | np.float64]:
    """Precision in which so many numbers of unit columns are kept.

    Single where there are many: its rounding, 6e-8 of a column, is far below any size that decides.
    """
    return np.float64 if numbers <= MAX_DOUBLES else np.float32


class _State:
    """A set in the beam: basis of its columns in the candidates' coordinates, and what is left."""

    __slots__ = ("blocks", "mask", "penalty", "rest", "rss", "taken")

    def __init__(
        self,
        mask: int,
        blocks: tuple[int, ...],
        taken: Array,
        rest: Array,
        rss: float,
        penalty: float,
    ) -> None:
        self.mask = mask
        self.blocks = blocks
        self.taken = taken  # (K, M): inner products of the set's orthonormal basis with all columns
        self.rest = rest  # (M,): inner products of all columns with what the set leaves of r
        self.rss = rss
        self.penalty = penalty


def _extend(c: Candidates, s: _State, block: int, bit: int) -> _State:
    """Add a block to a set."""
    span = c.span(block)
    g = c.gram_rows(block) - s.taken[:, span].T @ s.taken
    own = g[:, span]
    if len(own) == 1:
        back = np.full((int(own[0, 0] > DEPENDENT), 1), max(own[0, 0], DEPENDENT) ** -0.5)
    else:
        w, u = np.linalg.eigh(own)
        seen = w > DEPENDENT
        back = (u[:, seen] / np.sqrt(w[seen])).T
    new = back @ g
    a = back @ s.rest[span]
    return _State(
        s.mask | bit,
        (*s.blocks, block),
        np.concatenate([s.taken, new]),
        s.rest - a @ new,
        s.rss - float(a @ a),
        s.penalty + float(c.penalty[block]),
    )


def _gains(c: Candidates, states: Sequence[_State]) -> tuple[Array, IntArray]:
    """Drop of RSS and count of new columns for every state and every block, shape (s, b)."""
    k_max = max(s.taken.shape[0] for s in states)
    taken = np.zeros((len(states), k_max, c.width))
    for i, s in enumerate(states):
        taken[i, : s.taken.shape[0]] = s.taken
    rest = np.stack([s.rest for s in states])
    gain = np.zeros((len(states), len(c.owner)))
    rank = np.zeros((len(states), len(c.owner)), dtype=np.intp)
    for k, blocks, index in c.by_rank:
        z = [rest[:, index[:, i]] for i in range(k)]
        if k > WIDE:
            for b in blocks:
                gain[:, b], rank[:, b] = _wide_gain(taken, rest, c.span(int(b)))
            continue
        t = [taken[:, :, index[:, i]] for i in range(k)]
        # Cholesky of every block's k x k Gram matrix at once, dependent pivots left out
        a = [
            [float(i == j) - np.einsum("skb,skb->sb", t[i], t[j]) for j in range(i + 1)]
            for i in range(k)
        ]
        total = np.zeros((len(states), len(blocks)))
        count = np.zeros((len(states), len(blocks)), dtype=np.intp)
        for i in range(k):
            pivot = a[i][i]
            seen = pivot > DEPENDENT
            inverse = np.where(seen, 1.0 / np.where(seen, pivot, 1.0), 0.0)
            total += z[i] * z[i] * inverse
            count += seen
            for row in range(i + 1, k):
                factor = a[row][i] * inverse
                z[row] = z[row] - factor * z[i]
                for col in range(i + 1, row + 1):
                    a[row][col] = a[row][col] - factor * a[col][i]
        gain[:, blocks] = total
        rank[:, blocks] = count
    return gain, rank


def _wide_gain(taken: Array, rest: Array, span: slice) -> tuple[Array, IntArray]:
    """Drop of RSS and count of new columns of one block of many columns, for every state (s,)."""
    t = taken[:, :, span]
    w, u = np.linalg.eigh(np.eye(t.shape[2]) - t.transpose(0, 2, 1) @ t)
    seen = w > DEPENDENT
    z = np.einsum("sji,sj->si", u, rest[:, span])
    gain = np.sum(np.where(seen, z * z / np.where(seen, w, 1.0), 0.0), axis=1)
    return gain, seen.sum(axis=1).astype(np.intp)


class _Scorer:
    """-2 ln L of a set, penalised for its size."""

    def __init__(self, dof: int, floor: float) -> None:
        self.dof = dof
        self.floor = floor

    def __call__(
        self, rss: Array | float, columns: IntArray | int, penalty: Array | float
    ) -> Array:
        room = self.dof - columns - 1.0
        with np.errstate(divide="ignore"):
            score = self.dof * np.log(np.maximum(rss, self.floor))
        score = score + penalty * self.dof / np.maximum(room, 1.0)
        # Sets that explain the same are ordered by the catalogue, not by rounding.
        return np.where(room < 1.0, np.inf, np.round(score, SCORE_DIGITS))


def search(
    c: Candidates,
    r: Array,
    *,
    within: float = WITHIN,
    beam: int = BEAM,
    most: int = MAX_CAUSES,
) -> list[Found]:
    """Find the sets of causes whose score lies within ``within`` of the best, best first.

    The empty set is always the last entry, whatever its score. ``r``: residuals with the nuisance
    projected out, shape (n,).
    """
    rss0 = float(r @ r)
    score = _Scorer(c.dof, 1e-14 * rss0)
    empty = _State(0, (), np.zeros((0, c.width)), c.products(r), rss0, 0.0)
    nothing = Found(frozenset(), float(score(rss0, 0, 0.0)), rss0, 0, ())
    if len(c.leaders) == 0:
        return [nothing]
    bits = [1 << int(j) for j in range(c.count)]
    known: dict[int, Found] = {0: nothing}
    best = nothing.score

    def grow(states: list[_State], keep: int) -> list[_State]:
        """Try every candidate on every state; remember all sets near the best, keep some."""
        nonlocal best
        gain, rank = _gains(c, states)
        size = np.array([s.taken.shape[0] for s in states])
        rss = np.array([s.rss for s in states])[:, None] - gain
        penalty: Array = np.array([s.penalty for s in states])[:, None] + c.penalty
        total = score(rss, size[:, None] + rank, penalty)
        total = np.where(rank > 0, total, np.inf)
        # the best variant of each candidate
        low = np.minimum.reduceat(total, c.first_of_leader, axis=1)
        for i, s in enumerate(states):  # once in a set is enough
            low[i, [bool(s.mask >> int(j) & 1) for j in c.leaders]] = np.inf
        order = np.argsort(low, axis=None, kind="stable")
        chosen: list[tuple[_State, int, int]] = []
        seen: set[int] = set()
        best = min(best, float(low.flat[order[0]]))
        for flat in order:
            i, q = divmod(int(flat), len(c.leaders))
            value = float(low[i, q])
            if not np.isfinite(value) or (len(chosen) >= keep and value > best + within):
                break
            bit = bits[int(c.leaders[q])]
            mask = states[i].mask | bit
            if mask in seen:
                continue
            seen.add(mask)
            first = int(c.first_of_leader[q])
            last = int(c.first_of_leader[q + 1]) if q + 1 < len(c.leaders) else len(c.owner)
            block = first + int(np.argmin(total[i, first:last]))
            old = known.get(mask)
            if old is None or value < old.score - 1e-9:
                blocks = (*states[i].blocks, block)
                known[mask] = Found(
                    frozenset(int(c.owner[b]) for b in blocks),
                    value,
                    float(rss[i, block]),
                    int(size[i] + rank[i, block]),
                    blocks,
                )
            if len(chosen) < keep:
                chosen.append((states[i], block, bit))
        c.prepare(block for _, block, _ in chosen)
        return [_extend(c, *one) for one in chosen]

    def build(blocks: Sequence[int]) -> _State:
        state = empty
        for b in blocks:
            state = _extend(c, state, b, bits[int(c.owner[b])])
        return state

    states = [empty]
    for _ in range(min(most, len(c.leaders), c.dof - 2)):
        before = best
        states = grow(states, beam)
        if not states:
            break
        level_best = min(known[s.mask].score for s in states)
        if level_best > before + within:
            break
    # Exchange: each cause of the best sets against every other candidate.
    tried: set[int] = set()
    for _ in range(4):
        near = [f for f in known.values() if f.score <= best + within]
        near.sort(key=lambda f: f.score)
        fresh = []
        for f in near[:4]:
            for leave in range(len(f.blocks)):
                blocks = f.blocks[:leave] + f.blocks[leave + 1 :]
                mask = sum(bits[int(c.owner[b])] for b in blocks)
                if mask not in tried:
                    tried.add(mask)
                    fresh.append(build(blocks))
        if not fresh:
            break
        grow(fresh, 0)
    out = sorted(
        (f for f in known.values() if f.score <= best + within and f.members),
        key=lambda f: f.score,
    )
    return [*out, nothing]
