"""Columns of all candidate causes, after the nuisance parameters took what they can.

Everything here is linear algebra on arrays. Columns have unit length before the nuisance is taken
out and are orthonormal by block afterwards, a block being one candidate at one value of its
nonlinear parameters.
"""

import itertools
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from scipy import special

from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.combined import Combined


@dataclass(frozen=True)
class Pencil:
    """Columns ``base + at * slope`` of the variants of a candidate, of which none is made.

    base, slope: (n, k); at: (v,).
    """

    base: Floats
    slope: Floats
    at: Floats

    @property
    def size(self) -> int:
        """Count of the numbers kept."""
        return 2 * self.base.size

    def __len__(self) -> int:
        """Count of the variants."""
        return len(self.at)

    def rows(self, some: Integers | slice) -> "Pencil":
        """Return the same of some of the rows."""
        return Pencil(self.base[some], self.slope[some], self.at)


# a candidate, some of its variants (v, n, k)
Piece: TypeAlias = tuple[int, Floats | Pencil]


# Relative size of a squared column below which it counts as dependent on the others (0.3 % of its
# length). Exact dependencies of a perfect machine are broken in second order by the errors of the
# real one (1e-3 rad), which helps nobody: the parameter would have to be a thousand times as large.
DEPENDENT = 1e-5
# The same where the model is known to be incomplete (3 % of its length): or its gaps decide.
DEPENDENT_INCOMPLETE = 1e-3
NAMING_LEVEL = 0.01
ROUNDING = 1e-10  # of the longest column: sin 180°
MAX_DOUBLES = 1 << 25  # numbers that are kept in double precision, 256 MiB
BATCH_NUMBERS = 1 << 18  # numbers that are worked on at once
AT_HAND = 1 << 15  # of these, numbers of a step: what a processor's cache holds several times
MIN_ROWS = 2048  # readings of a step
AT_ONCE = 1024  # readings of columns in single precision
NONE = np.zeros(0, dtype=np.intp)


class Candidates:
    """Columns of all candidates, after the nuisance parameters took what they can.

    variants: For each candidate its columns, shape (v, n, k): v = 1 for a linear candidate, else
        one entry for each value of its nonlinear parameters.
    basis: Orthonormal basis of what the nuisance parameters absorb, shape (n, p).
    level: Family-wise level at which a cause is named: shared by the candidates that are
        identifiable.
    own_level: For each candidate a level of its own, or 0 for its share of ``level``.
    own_price: For each candidate what is added to its penalty.
    """

    def __init__(
        self,
        variants: Sequence[Floats],
        basis: Floats,
        level: float = NAMING_LEVEL,
        own_level: Floats | None = None,
        own_price: Floats | None = None,
    ) -> None:
        numbers = sum(v.size for v in variants)
        self._build(enumerate(variants), len(variants), numbers, basis)
        self._complete(basis, level, own_level, own_price)

    @classmethod
    def of_pieces(
        cls,
        pieces: Iterable[Piece],
        count: int,
        numbers: int,
        basis: Floats,
        own_level: Floats | None = None,
        stated: Mapping[int, float] = MappingProxyType({}),
    ) -> "Candidates":
        """Candidates of which not all columns are there at a time.

        ``pieces``: number of a candidate and some of its variants, in order; ``count``: of the
        candidates; ``numbers``: of all pieces together; ``own_level``: as of the class; ``stated``:
        standard deviation of what some of them may add along their unit columns.
        """
        new = object.__new__(cls)
        new.stated = stated
        new._build(pieces, count, numbers, basis)
        new._complete(basis, NAMING_LEVEL, own_level, None)
        return new

    penalty: Floats
    inflation: Floats
    dependent: float = DEPENDENT
    positive: frozenset[int] = frozenset()  # candidates of one column, nothing if negative
    stated: Mapping[int, float] = MappingProxyType({})  # candidates whose size is known to be small
    _banned: frozenset[int] = frozenset()
    _last: tuple[Floats, Floats] | None = None  # residuals and their products

    def _build(self, pieces: Iterable[Piece], count: int, numbers: int, basis: Floats) -> None:
        """Orthonormalise the columns of each block beside the basis; drop what is dependent."""
        self.count = count
        n, p = basis.shape
        self.dof = n - p
        kind = storage(numbers)
        parts: list[Floats | Combined] = []
        owner, rank, start = [NONE], [NONE], [NONE]
        filled = 0
        for batch in _batches(pieces):
            some = _unit_blocks([v for _, v in batch], basis, kind)
            parts.append(some[0])
            owner += [np.full(len(v), j, dtype=np.intp) for j, v in batch]
            rank.append(some[1])
            start.append(some[2] + filled)
            filled += len(some[0])
        self._parts: tuple[Floats | Combined, ...] = tuple(parts) or (np.zeros((0, n)),)
        self.owner, self.rank, self.start = map(np.concatenate, (owner, rank, start))
        self.variant = np.arange(len(self.owner)) - np.searchsorted(self.owner, self.owner)
        self._keep(self.rank > 0)

    def beside(
        self, variants: Sequence[Floats], own_level: Floats, own_price: Floats | None = None
    ) -> "Candidates":
        """Return these candidates and further ones, numbered after them.

        ``own_level``, ``own_price``: of the further ones only.
        """
        new = object.__new__(Candidates)
        new.stated = self.stated
        new._build(enumerate(variants), len(variants), 0, self._basis)
        new.owner = np.concatenate([self.owner, new.owner + self.count])
        new.variant = np.concatenate([self.variant, new.variant])
        new.rank = np.concatenate([self.rank, new.rank])
        new.start = np.concatenate([self.start, new.start + self.width])
        new._parts = (*self._parts, *new._parts)
        new.count += self.count
        none = np.zeros(self.count)
        own = self.level * (self.level != self._shared_level / max(self.multiplicity, 1))
        price = np.zeros(len(variants)) if own_price is None else own_price
        new._complete(
            self._basis,
            self._shared_level,
            np.concatenate([own, own_level]),
            np.concatenate([none, price]),
            self.multiplicity,
        )
        new.inflate(np.append(self.inflation, np.ones(len(new.owner) - len(self.owner))))
        new.ban(self._banned)
        new.dependent, new.positive = self.dependent, self.positive
        return new

    def inflate(self, factor: Floats) -> None:
        """Raise the penalty of each block by a factor (b,): it gains so much more by chance."""
        self.penalty = self.penalty + (factor - self.inflation) * self.chance()
        self.inflation = factor

    def ban(self, members: Iterable[int]) -> None:
        """Let no set have these candidates."""
        self._banned = self._banned | frozenset(members)
        banned = np.isin(self.owner, sorted(self._banned))
        self.penalty = np.where(banned, np.inf, self.penalty)

    def chance(self) -> Floats:
        """Drop of -2 ln L that each block reaches by chance at its level (b,)."""
        return np.asarray(special.chdtri(self.rank, self.level[self.owner] / self.places))

    def _complete(
        self,
        basis: Floats,
        level: float,
        own_level: Floats | None,
        own_price: Floats | None,
        multiplicity: float | None = None,
    ) -> None:
        """Group the blocks and price them."""
        self._basis, self._shared_level = basis, level
        self._ends = list(itertools.accumulate(map(len, self._parts)))
        self.identifiable = np.unique(self.owner)
        self.not_identifiable = np.setdiff1d(np.arange(self.count), self.identifiable)
        self._gram_rows: dict[int, Floats] = {}
        self._group()
        own = np.zeros(self.count) if own_level is None else own_level
        shared = np.sum(own[self.identifiable] == 0) if multiplicity is None else multiplicity
        self.level = np.where(own > 0, own, level / max(shared, 1))
        self.multiplicity = float(shared)
        self.places = self._places()
        self.inflation = np.ones(len(self.owner))
        self.penalty = self.chance()
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

    def columns(self, block: int) -> Floats:
        """Columns of a block, one a row, shape (k, n)."""
        part, some = self._place(block)
        return part[some]

    def _place(self, block: int) -> tuple[Floats | Combined, slice]:
        """Part that holds the columns of a block, and which of it they are."""
        start = int(self.start[block])
        i = bisect_right(self._ends, start)
        part = self._parts[i]
        first = start - self._ends[i] + len(part)
        return part, slice(first, first + int(self.rank[block]))

    def _inner(self, a: int, b: int) -> Floats:
        """Inner products of the columns of two blocks, shape (k, l)."""
        part, some = self._place(a)
        other, others = self._place(b)
        if isinstance(part, Combined) and part is other:
            return np.asarray(part.weights[some] @ part.products @ part.weights[others].T)
        return inner(part[some], other[others].T)

    def gram_rows(self, block: int) -> Floats:
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
        alone = self.identifiable[single[self.identifiable]]
        at = np.searchsorted(self.owner, alone)
        rank = self.rank[at]
        if len(alone):
            some = np.concatenate([self.columns(int(b)) for b in at])
            squares = inner(some, some.T) ** 2
            first = np.concatenate([[0], np.cumsum(rank)[:-1]]).astype(np.intp)
            overlap = np.add.reduceat(np.add.reduceat(squares, first, axis=0), first, axis=1)
            same = (np.abs(overlap - rank) < DEPENDENT) & (rank == rank[:, None])
        place = {int(j): i for i, j in enumerate(alone)}
        for j in map(int, self.identifiable):
            home = j
            if single[j]:
                homes = (
                    i
                    for i in self.alike
                    if single[i]
                    and same[place[i], place[j]]
                    and self.stated.get(i) == self.stated.get(j)
                )
                home = next(homes, j)
            self.alike.setdefault(home, []).append(j)
        self.leaders = np.array(sorted(self.alike), dtype=np.intp)
        self._keep(np.isin(self.owner, self.leaders))

    def span(self, block: int) -> slice:
        """Columns of a block."""
        return slice(int(self.start[block]), int(self.start[block] + self.rank[block]))

    def _places(self) -> Floats:
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
            length = float(np.sum(np.arccos(np.minimum(self._overlaps(blocks), 1.0))))
            u = special.chdtri(1, self.level[j])
            out[blocks] = min(float(len(blocks)), 1.0 + length / np.pi * np.sqrt(np.pi * u / 2))
        return out

    def _overlaps(self, blocks: Integers) -> Floats:
        """Cosine between each of some blocks and the next (b - 1,)."""
        k, (part, some) = int(self.rank[blocks[0]]), self._place(int(blocks[0]))
        end = some.start + k * len(blocks)
        even = np.all(self.rank[blocks] == k) and np.all(np.diff(self.start[blocks]) == k)
        if even and end <= len(part) and (isinstance(part, Combined) or part.dtype == np.float64):
            own = part.weights if isinstance(part, Combined) else part
            own = own[some.start : end].reshape(len(blocks), k, -1)
            before = own[:-1] @ part.products if isinstance(part, Combined) else own[:-1]
            squares = (before @ own[1:].transpose(0, 2, 1)) ** 2
            return np.asarray(np.sqrt(squares.sum(axis=(1, 2)) / k))
        pairs = (self._inner(a, b) for a, b in itertools.pairwise(map(int, blocks)))
        return np.array([np.sqrt(np.sum(g * g) / max(g.shape)) for g in pairs])

    def products(self, r: Floats) -> Floats:
        """Inner products of all columns with residuals (n,) or (n, s): shape (M,) or (M, s)."""
        if self._last is not None and self._last[0] is r:
            return self._last[1]
        held = [x.shared if isinstance(x, Combined) else x for x in self._parts]
        pairs = zip(self._parts, inners(held, r), strict=True)
        whole = [part.weights @ x if isinstance(part, Combined) else x for part, x in pairs]
        joined = np.concatenate(whole)
        if r.ndim == 1:
            self._last = r, joined
        return joined

    def gains(self, r: Floats) -> Floats:
        """Gain in RSS of every block alone. ``r``: (n,) or (n, s); shape (b,) or (b, s)."""
        z2 = self.products(r) ** 2
        total = np.concatenate([np.zeros((1, *z2.shape[1:])), np.cumsum(z2, axis=0)])
        return np.asarray(total[self.start + self.rank] - total[self.start])

    @cached_property
    def by_rank(self) -> list[tuple[int, Integers, Integers]]:
        """Blocks of each rank k: (k, block numbers (b,), column numbers (b, k))."""
        out = []
        for k in np.unique(self.rank):
            blocks = np.flatnonzero(self.rank == k)
            out.append((int(k), blocks, self.start[blocks][:, None] + np.arange(k)))
        return out

    @cached_property
    def first_of_leader(self) -> Integers:
        """Number of the first block of each leader; blocks of one candidate are neighbours."""
        return np.searchsorted(self.owner, self.leaders)


def _batches(pieces: Iterable[Piece]) -> Iterator[list[Piece]]:
    """Pieces, so many at a time as have not too many numbers together; a pencil by itself."""
    batch: list[Piece] = []
    for piece in pieces:
        if isinstance(piece[1], Pencil):
            if batch:
                yield batch
            yield [piece]
            batch = []
            continue
        batch.append(piece)
        if sum(v.size for _, v in batch) >= BATCH_NUMBERS:
            yield batch
            batch = []
    if batch:
        yield batch


def _unit_blocks(
    variants: Sequence[Floats | Pencil], basis: Floats, kind: type[np.float32 | np.float64]
) -> tuple[Floats | Combined, Integers, Integers]:
    """Orthonormal columns of each block beside the basis, their rank, and where they start."""
    if isinstance(variants[0], Pencil):
        return _orthonormal_pencil(variants[0], basis)
    arrays = [v.transpose(0, 2, 1) for v in variants if not isinstance(v, Pencil)]
    return _orthonormal_blocks(arrays, basis, kind)


def _orthonormal_pencil(pencil: Pencil, basis: Floats) -> tuple[Combined, Integers, Integers]:
    """The same of the variants of a pencil: all of it in inner products of its 2 k columns."""
    shared = np.concatenate([pencil.base, pencil.slope], axis=1).T
    k = len(shared) // 2
    one = np.eye(k)
    weights = np.stack([np.concatenate([one, at * one], axis=1) for at in pencil.at])
    before = shared @ shared.T
    size = np.sqrt(np.maximum(np.einsum("vki,ij,vkj->vk", weights, before, weights), 0.0))
    least = ROUNDING * float(size.max(initial=0.0))
    weights /= np.where(size > least, size, np.inf)[:, :, None]
    shared -= (shared @ basis) @ basis.T
    w, u = np.linalg.eigh(weights @ (shared @ shared.T) @ weights.transpose(0, 2, 1))
    w, u = w[:, ::-1], u[:, :, ::-1]
    seen = w > DEPENDENT
    scale = np.where(seen, 1.0 / np.sqrt(np.where(seen, w, 1.0)), 0.0)
    rows = (u * scale[:, None, :]).transpose(0, 2, 1) @ weights
    rank = seen.sum(axis=1)
    start = np.concatenate([[0], np.cumsum(rank)[:-1]]).astype(np.intp)
    return Combined(rows[seen], shared), rank, start


def _orthonormal_blocks(
    variants: Sequence[Floats], basis: Floats, kind: type[np.float32 | np.float64]
) -> tuple[Floats, Integers, Integers]:
    """Orthonormalise the columns of each block beside the basis; drop what is dependent.

    ``variants``: columns one a row, (v, k, n). Returns the columns, one a row, shape (M, n), in
    precision ``kind``, the rank of each block and where it starts.
    """
    grams = [v @ v.transpose(0, 2, 1) for v in variants]
    least = ROUNDING**2 * max(float(g.max(initial=0.0)) for g in grams)
    width = np.array([v.shape[1] for v in variants for _ in v], dtype=np.intp)
    rank = np.zeros(len(width), dtype=np.intp)
    start = np.zeros(len(width), dtype=np.intp)
    out: list[Floats] = []
    filled = 0
    for k in np.unique(width):
        same = [i for i, v in enumerate(variants) if v.shape[1] == k]
        x, gram = (_joined([of[i] for i in same]) for of in (variants, grams))
        columns, some = _orthonormal(x, gram, least, basis, kind)
        rank[width == k] = some
        start[width == k] = filled + np.concatenate([[0], np.cumsum(some)[:-1]])
        out.append(columns)
        filled += len(columns)
    return _joined(out) if out else np.zeros((0, len(basis)), dtype=kind), rank, start


def _joined(parts: list[Floats]) -> Floats:
    """Concatenate; one part as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _orthonormal(
    x: Floats, gram: Floats, least: float, basis: Floats, kind: type[np.float32 | np.float64]
) -> tuple[Floats, Integers]:
    """Orthonormalise blocks of rows beside a basis; what is dependent is left out.

    ``x``: (b, k, n); ``gram``: their inner products (b, k, k); ``least``: squared length of a row
    that counts as zero. Returns the rows of all blocks (M, n), of each block largest first, and its
    rank. Some readings are worked on at a time, which processors keep at hand.
    """
    b, k, n = x.shape
    square = np.diagonal(gram, axis1=1, axis2=2)
    unit = 1.0 / np.sqrt(np.where(square > least, square, np.inf))
    taken = (x.reshape(-1, n) @ basis).reshape(b, k, -1) * unit[:, :, None]
    left = gram * unit[:, :, None] * unit[:, None] - taken @ taken.transpose(0, 2, 1)
    w, u = (left[:, :, 0], np.ones_like(left)) if k == 1 else np.linalg.eigh(left)
    w, u = w[:, ::-1], u[:, :, ::-1]
    seen = w > DEPENDENT
    weights = (u / np.sqrt(np.where(seen, w, 1.0))[:, None, :]).transpose(0, 2, 1)
    of_basis, weights = (weights @ taken)[seen], weights * unit[:, None]
    out: Floats = np.empty((len(of_basis), n), dtype=kind)
    most = max(MIN_ROWS, AT_HAND // max(b * k, 1))
    for first in range(0, n, most):
        some = slice(first, first + most)
        of_x = (weights @ x[:, :, some])[seen]
        np.subtract(of_x, of_basis @ basis[some].T, out=out[:, some])
    return out, seen.sum(axis=1)


def inner(columns: Floats, r: Floats) -> Floats:
    """Inner products of columns, one a row (m, n), with r (n,) or (n, s), in double precision."""
    return inners([columns], r)[0]


def inners(parts: Sequence[Floats], r: Floats) -> list[Floats]:
    """Return the same of several arrays of columns; r is read once for all in single precision.

    Sums are in double precision, whatever columns are kept in: those of single precision would make
    columns look independent that are not, and their errors would depend on the machine.
    """
    out = [x @ r if x.dtype == np.float64 else np.zeros((len(x), *r.shape[1:])) for x in parts]
    single = [(x, sums) for x, sums in zip(parts, out, strict=True) if x.dtype == np.float32]
    for first in range(0, len(r) if single else 0, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        own = r[some].astype(np.float64, copy=False)
        for x, sums in single:
            sums += x[:, some].astype(np.float64) @ own
    return out


def storage(numbers: int) -> type[np.float32 | np.float64]:
    """Precision in which so many numbers of unit columns are kept.

    Single where there are many: its rounding, 6e-8 of a column, is far below any size that decides,
    as long as sums are in double precision (:func:`inner`).
    """
    return np.float64 if numbers <= MAX_DOUBLES else np.float32
