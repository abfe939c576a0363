"""Unit columns of many candidates: made orthogonal, kept and multiplied.

Columns are rows of arrays here. Of many readings those of candidates with a grid are kept in single
precision, and the sums in double.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeAlias

import numpy as np

from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.of_some import Beside, OfSome, Orthonormal

# Relative size of a squared column below which it counts as dependent on the others (0.3 % of its
# length). Exact dependencies of a perfect machine are broken in second order by the errors of the
# real one (1e-3 rad), which helps nobody: the parameter would have to be a thousand times as large.
DEPENDENT = 1e-5
ROUNDING = 1e-10  # of the longest column: sin 180°
APART = 1e-10  # cosine of columns that have nothing in common, but for rounding
MAX_DOUBLES = 1 << 25  # numbers that are kept in double precision, 256 MiB
BATCH_NUMBERS = 1 << 18  # numbers that are worked on at once
BATCH_COLUMNS = 16  # of many readings: what they are beside is read once for these
AT_HAND = 1 << 15  # of these, numbers of a step: what a processor's cache holds several times
MIN_ROWS = 2048  # readings of a step
AT_ONCE = 1024  # readings of columns in single precision
PART_COLUMNS = 128  # in one array, of many rows


@dataclass(frozen=True)
class Pencil:
    """Columns ``base + at * slope`` of the variants of a candidate, of which none is made.

    base, slope: (n, k); at: (v,).
    """

    base: Floats
    slope: Floats
    at: Floats

    def __len__(self) -> int:
        """Count of the variants."""
        return len(self.at)

    def rows(self, some: Integers | slice) -> "Pencil":
        """Return the same of some of the rows."""
        return Pencil(self.base[some], self.slope[some], self.at)

    def orthonormal(
        self,
        basis: Floats,
        kind: type[np.float32 | np.float64],  # noqa: ARG002
    ) -> tuple["Combined", Integers, Integers]:
        """Orthonormal columns of each variant: all of it in inner products of the 2 k columns."""
        shared = np.concatenate([self.base, self.slope], axis=1).T
        k = len(shared) // 2
        one = np.eye(k)
        weights = np.stack([np.concatenate([one, at * one], axis=1) for at in self.at])
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


class Part(Protocol):
    """Columns of candidates, one a row, of which not all are made."""

    def __len__(self) -> int: ...
    def __getitem__(self, some: slice) -> Floats: ...
    def times(self, r: Floats) -> Floats:
        """Inner products of the columns with residuals (n,) or (n, s)."""

    def inner(self, some: slice, others: slice) -> Floats:
        """Inner products of columns of one block with those of another, (k, l)."""

    def neighbours(self, some: slice, k: int) -> Floats:
        """Inner products of each k of some columns with the next k, (b - 1, k, k)."""


class Family(Protocol):
    """All variants of a candidate, of which none is made."""

    def __len__(self) -> int: ...
    def rows(self, some: Integers | slice) -> "Family":
        """Return the same of some of the rows."""

    def orthonormal(
        self, basis: Floats, kind: type[np.float32 | np.float64]
    ) -> tuple[Part, Integers, Integers]:
        """Orthonormal columns of each variant beside a basis, their rank, and where they start."""


Columns: TypeAlias = Floats | OfSome | Orthonormal | Family
# a candidate, all of its variants or some (v, n, k)
Piece: TypeAlias = tuple[int, Columns]


@dataclass(frozen=True)
class Combined:
    """Columns that are combinations ``weights`` (m, q) of a few ``shared`` ones (q, n)."""

    weights: Floats
    shared: Floats

    @cached_property
    def products(self) -> Floats:
        """Inner products of the shared columns (q, q)."""
        return np.asarray(self.shared @ self.shared.T)

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, some: slice) -> Floats:
        return np.asarray(self.weights[some] @ self.shared)

    def times(self, r: Floats) -> Floats:
        """Inner products of the columns with residuals (n,) or (n, s)."""
        return np.asarray(self.weights @ inner(self.shared, r))

    def inner(self, some: slice, others: slice) -> Floats:
        """Inner products of some columns with others, (k, l)."""
        return np.asarray(self.weights[some] @ self.products @ self.weights[others].T)

    def neighbours(self, some: slice, k: int) -> Floats:
        """Inner products of each k of some columns with the next k, (b - 1, k, k)."""
        own = self.weights[some].reshape(-1, k, self.weights.shape[1])
        return np.asarray((own[:-1] @ self.products) @ own[1:].transpose(0, 2, 1))


def products(parts: Sequence[Floats | Part], r: Floats) -> Floats:
    """Inner products of the columns of parts with residuals (n,) or (n, s): (M,) or (M, s).

    Parts beside a basis are beside the same one.
    """
    arrays = iter(inners([x for x in parts if isinstance(x, np.ndarray)], r))
    beside = (x for x in parts if isinstance(x, Beside) and x.of_basis is not None)
    basis = next((x.basis.T @ r for x in beside), None)
    found = []
    for x in parts:
        if isinstance(x, np.ndarray):
            found.append(next(arrays))
        else:
            found.append(x.along(r, basis) if isinstance(x, Beside) else x.times(r))
    return np.concatenate(found)


class Among:
    """Inner products of blocks of columns that were asked for together, each worked out once."""

    def __init__(self) -> None:
        self._columns: list[Floats] = []
        self._place: dict[int, Integers] = {}
        self._gram = np.zeros((0, 0))

    def copied(self) -> "Among":
        """Return one that knows the same."""
        new = copy(self)
        new._columns, new._place = list(self._columns), dict(self._place)
        return new

    def gram(self, blocks: Sequence[int], columns: Callable[[int], Floats]) -> Floats:
        """Inner products of all columns of some blocks, (K, K); ``columns``: of a block."""
        if missing := [b for b in dict.fromkeys(blocks) if b not in self._place]:
            self._add({b: columns(b).astype(np.float64, copy=False) for b in missing})
        at = np.concatenate([self._place[b] for b in blocks])
        return np.asarray(self._gram[at[:, None], at])

    def _add(self, blocks: Mapping[int, Floats]) -> None:
        """Add blocks of columns."""
        first = len(self._gram)
        for b, x in blocks.items():
            self._place[b] = np.arange(first, first := first + len(x))
        own = np.concatenate(list(blocks.values()))
        self._columns.append(own)
        known, self._gram = self._gram, np.zeros((first, first))
        self._gram[: len(known), : len(known)] = known
        row = 0
        for x in self._columns:
            products = x @ own.T
            some, row = slice(row, row + len(x)), row + len(x)
            self._gram[some, len(known) :] = products
            self._gram[len(known) :, some] = products.T


def neighbours(part: Floats | Part, some: slice, k: int) -> Floats:
    """Inner products of each k of some columns with the next k, (b - 1, k, k)."""
    if not isinstance(part, np.ndarray):
        return part.neighbours(some, k)
    own = part[some].reshape(-1, k, part.shape[1])
    if part.dtype == np.float64:
        return np.asarray(own[:-1] @ own[1:].transpose(0, 2, 1))
    out = np.zeros((len(own) - 1, k, k))
    for first in range(0, own.shape[2], AT_ONCE):
        double = own[:, :, first : first + AT_ONCE].astype(np.float64)
        out += double[:-1] @ double[1:].transpose(0, 2, 1)
    return out


class Shelf:
    """Arrays that hold the columns of candidates one after the other; of many rows, few of them."""

    def __init__(self, n: int) -> None:
        self.n, self.filled = n, 0
        self._parts: list[Floats | Part] = []
        self._open = False  # whether the last part has room left
        self._used = 0  # of it

    def room(self, count: int, kind: type[np.float32 | np.float64]) -> Floats:
        """Return room for some columns, (count, n)."""
        last = self._parts[-1] if self._open else None
        if not isinstance(last, np.ndarray) or last.dtype != kind or self._left(last) < count:
            self.close()
            width = max(count, PART_COLUMNS) if self.n >= MANY_ROWS else count
            last = np.empty((width, self.n), dtype=kind)
            self._parts.append(last)
            self._open = self.n >= MANY_ROWS
        first = self._used
        self._used = first + count if self._open else 0
        self.filled += count
        return last[first : first + count]

    def _left(self, last: Floats) -> int:
        return len(last) - self._used

    def add(self, part: Part) -> None:
        """Add a part that is complete."""
        self.close()
        self.filled += len(part)
        self._parts.append(part)

    def close(self) -> None:
        """Give back the room that is left."""
        if self._open:
            last = self._parts[-1]
            self._parts[-1] = last[: self._used]
        self._open, self._used = False, 0

    def parts(self) -> tuple[Floats | Part, ...]:
        """Return all of them."""
        self.close()
        return tuple(self._parts)


def lengths(columns: Floats) -> Floats:
    """Length of each column, infinite for columns of rounding noise (sin 180°) beside the others.

    Dividing by it leaves unit columns, and zeros where there was nothing.
    """
    size: Floats = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    return np.where(size > ROUNDING * np.max(size, initial=0.0), size, np.inf)


def batches(pieces: Iterable[Piece], apart: Collection[int] = ()) -> Iterator[list[Piece]]:
    """Pieces, so many at a time as have not too many numbers together; a family by itself.

    Columns of the same readings go together. ``apart``: candidates that go apart from the others.
    """
    batch: list[Piece] = []
    numbers, kind = 0, None
    for piece in pieces:
        some = piece[1] if isinstance(piece[1], OfSome | Orthonormal) else None
        columns = piece[1] if some is None else some.own
        if not isinstance(columns, np.ndarray):
            if batch:
                yield batch
            yield [piece]
            batch, numbers = [], 0
            continue
        own = piece[0] in apart, some and (type(some), some.at.start)
        if batch and own != kind:
            yield batch
            batch, numbers = [], 0
        batch.append(piece)
        kind = own
        numbers += 0 if isinstance(some, Orthonormal) else columns.size  # which is there already
        if numbers >= batch_numbers(columns.shape[1]):
            yield batch
            batch, numbers = [], 0
    if batch:
        yield batch


def batch_numbers(n: int) -> int:
    """How many numbers of n readings are worked on at once: of many readings, some columns."""
    return max(BATCH_NUMBERS, BATCH_COLUMNS * n)


def unit_blocks(
    variants: Sequence[Columns],
    basis: Floats,
    kind: type[np.float32 | np.float64],
    shelf: Shelf,
) -> tuple[Integers, Integers, list[float | None]]:
    """Put orthonormal columns of each block beside the basis on a shelf; their rank and start.

    Last, of each of the ``variants`` the length of the curve that they draw, where it is known.
    """
    first, unknown = variants[0], list[float | None]([None] * len(variants))
    if isinstance(first, Orthonormal):
        made = [v for v in variants if isinstance(v, Orthonormal)]
        if not first.holds(basis):
            return unit_blocks([v.whole() for v in made], basis, kind, shelf)
        for run in Orthonormal.joined(made, basis):
            shelf.add(run)
        rank = np.concatenate([v.rank for v in made])
        start = np.concatenate([[0], np.cumsum(rank)[:-1]]).astype(np.intp)
        return rank, start, [v.curve for v in made]
    if isinstance(first, OfSome):
        own = [v.own.transpose(0, 2, 1) for v in variants if isinstance(v, OfSome)]
        return *_orthonormal_blocks(own, basis, kind, shelf, first.at), unknown
    if not isinstance(first, np.ndarray):
        part, rank, start = first.orthonormal(basis, kind)
        shelf.add(part)
        return rank, start, unknown
    arrays = [v.transpose(0, 2, 1) for v in variants if isinstance(v, np.ndarray)]
    return *_orthonormal_blocks(arrays, basis, kind, shelf), unknown


def _orthonormal_blocks(
    variants: Sequence[Floats],
    basis: Floats,
    kind: type[np.float32 | np.float64],
    shelf: Shelf,
    at: slice | None = None,
) -> tuple[Integers, Integers]:
    """Orthonormalise the columns of each block beside the basis; drop what is dependent.

    ``variants``: columns one a row, (v, k, n), of the few readings ``at`` only, if given. Puts the
    columns, one a row, in precision ``kind`` on the shelf. Returns the rank of each block and where
    it starts.
    """
    width = np.repeat([v.shape[1] for v in variants], [len(v) for v in variants])
    rank = np.zeros(len(width), dtype=np.intp)
    start = np.zeros(len(width), dtype=np.intp)
    before = shelf.filled
    few = len(basis) < MANY_ROWS
    same: dict[int, list[Floats]] = {}
    for v in variants:
        same.setdefault(v.shape[1], []).append(v)
    if few:
        same = {k: [_joined(x)] for k, x in same.items()}
    grams = {k: _joined([v @ v.transpose(0, 2, 1) for v in x]) for k, x in same.items()}
    least = ROUNDING**2 * max(float(g.max(initial=0.0)) for g in grams.values())
    for k in sorted(same):
        filled = shelf.filled - before
        if at is not None:
            some = _orthonormal_of_some(same[k][0], grams[k], least, basis, at, shelf)
        elif few:
            some = _orthonormal(same[k][0], grams[k], least, basis, kind, shelf)
        else:
            some = _orthonormal_of_many(same[k], grams[k], least, basis, kind, shelf)
        rank[width == k] = some
        start[width == k] = filled + np.concatenate([[0], np.cumsum(some)[:-1]])
    return rank, start


def _joined(parts: list[Floats]) -> Floats:
    """Concatenate; one part as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _at_hand(width: int, rows: int) -> list[slice]:
    """Some readings of so many columns at a time."""
    most = max(MIN_ROWS, AT_HAND // max(width, 1))
    return [slice(first, first + most) for first in range(0, rows, most)]


def _orthonormal(
    x: Floats,
    gram: Floats,
    least: float,
    basis: Floats,
    kind: type[np.float32 | np.float64],
    shelf: Shelf,
) -> Integers:
    """Orthonormalise blocks of rows beside a basis; what is dependent is left out.

    ``x``: (b, k, n); ``gram``: their inner products (b, k, k); ``least``: squared length of a row
    that counts as zero. Puts the rows of all blocks (M, n), of each block largest first, on the
    shelf. Returns the rank of each. Some readings are worked on at a time, which processors keep at
    hand.
    """
    b, k, n = x.shape
    taken = (x.reshape(-1, n) @ basis).reshape(b, k, -1)
    weights, of_basis, seen = orthonormal_weights(gram, taken, least)
    out = shelf.room(len(of_basis), kind)
    for some in _at_hand(b * k, n):
        of_x = _combined(weights, x[:, :, some], seen)
        np.subtract(of_x, of_basis @ basis[some].T, out=out[:, some])
    return np.asarray(seen.sum(axis=1))


def _orthonormal_of_some(
    x: Floats, gram: Floats, least: float, basis: Floats, at: slice, shelf: Shelf
) -> Integers:
    """Return the same of rows that are of some readings: the basis is not taken out of the others.

    They stay as they are, and their share in the basis beside them.
    """
    b, k, n = x.shape
    taken = (x.reshape(-1, n) @ basis[at]).reshape(b, k, -1)
    weights, of_basis, seen = orthonormal_weights(gram, taken, least)
    shelf.add(Beside(_combined(weights, x, seen), at, basis, of_basis))
    return np.asarray(seen.sum(axis=1))


def _orthonormal_of_many(
    parts: list[Floats],
    gram: Floats,
    least: float,
    basis: Floats,
    kind: type[np.float32 | np.float64],
    shelf: Shelf,
) -> Integers:
    """Return the same of many rows: some of all parts together at a time, and never all."""
    b, k, n = len(gram), gram.shape[1], len(basis)
    steps = _at_hand(b * k, n)
    taken = np.zeros((b * k, basis.shape[1]))
    for some in steps:
        taken += _joined([x[:, :, some] for x in parts]).reshape(b * k, -1) @ basis[some]
    weights, of_basis, seen = orthonormal_weights(gram, taken.reshape(b, k, -1), least)
    out = shelf.room(len(of_basis), kind)
    for some in steps:
        of_x = (weights @ _joined([x[:, :, some] for x in parts]))[seen]
        np.subtract(of_x, of_basis @ basis[some].T, out=out[:, some])
    return np.asarray(seen.sum(axis=1))


def orthonormal_weights(gram: Floats, taken: Floats, least: float) -> tuple[Floats, Floats, Flags]:
    """Combinations of the rows of blocks that are orthonormal beside a basis.

    ``gram``: inner products of the rows (b, k, k); ``taken``: with the basis (b, k, p); ``least``:
    squared length of a row that counts as zero. Returns the weights (b, k, k) of each combination,
    largest first, what to subtract of the basis (M, p), and which combinations are independent.
    """
    square = np.diagonal(gram, axis1=1, axis2=2)
    unit = 1.0 / np.sqrt(np.where(square > least, square, np.inf))
    taken = taken * unit[:, :, None]
    left = gram * unit[:, :, None] * unit[:, None] - taken @ taken.transpose(0, 2, 1)
    w, u = (left[:, :, 0], np.ones_like(left)) if left.shape[1] == 1 else np.linalg.eigh(left)
    w, u = w[:, ::-1], u[:, :, ::-1]
    seen = w > DEPENDENT
    weights = (u / np.sqrt(np.where(seen, w, 1.0))[:, None, :]).transpose(0, 2, 1)
    return weights * unit[:, None], (weights @ taken)[seen], seen


def _combined(weights: Floats, x: Floats, seen: Flags) -> Floats:
    """Combinations of the rows of blocks (b, k, n) that are independent, (M, n)."""
    made = weights * x if x.shape[1] == 1 else weights @ x
    return made.reshape(-1, x.shape[2]) if seen.all() else made[seen]


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
