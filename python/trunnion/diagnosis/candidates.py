"""Columns of all candidate causes, after the nuisance parameters took what they can.

Everything here is linear algebra on arrays. Columns have unit length before the nuisance is taken
out and are orthonormal by block afterwards, a block being one candidate at one value of its
nonlinear parameters.
"""

import itertools
from bisect import bisect_right
from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import copy
from functools import cached_property, reduce
from operator import or_
from types import MappingProxyType

import numpy as np
from scipy import special

from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.columns import (
    DEPENDENT,
    ROUNDING,
    Among,
    Columns,
    Part,
    Piece,
    Shelf,
    batches,
    inner,
    neighbours,
    products,
    storage,
    unit_blocks,
)
from trunnion.diagnosis.multiplied import multiplied, squared_products

# The same where the model is known to be incomplete (3 % of its length): or its gaps decide.
DEPENDENT_INCOMPLETE = 1e-3
NAMING_LEVEL = 0.01
SMOOTH_DEGREE = 4  # up to which a cause makes all polynomials of a quantity, if it is any function
MADE = 0.9  # of the variance of each
NOT_MULTIPLIED = MappingProxyType[int, Floats]({}), 0
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

    chance: Drop of -2 ln L that each block reaches by chance at its level (b,).
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
        among: Floats | None = None,
        sought: Floats | None = None,
        stated: Mapping[int, float] = MappingProxyType({}),
        alone: Collection[int] = (),
        positive: frozenset[int] = frozenset(),
    ) -> "Candidates":
        """Candidates of which not all columns are there at a time.

        ``pieces``: number of a candidate and some of its variants, in order; ``count``: of the
        candidates; ``numbers``: of all pieces together; ``own_level``: as of the class; ``among``:
        how many candidates each shares the level with, 0 for all that have none of their own;
        ``sought``: as how many candidates each counts for itself; ``stated``:
        standard deviation of what some of them may add along their unit columns; ``alone``:
        candidates of one variant; ``positive``: those of one column that are nothing if negative.
        """
        new = object.__new__(cls)
        new.stated, new.positive = stated, positive
        new._build(pieces, count, numbers, basis, alone)
        new._complete(basis, NAMING_LEVEL, own_level, None, among=among, sought=sought)
        return new

    fitted: int  # in how many directions readings are fitted beside any candidate
    curves: dict[int, float]  # lengths of what unit columns of candidates draw, if asked for
    penalty: Floats
    chance: Floats
    inflation: Floats
    kept: Floats | float = 1.0  # of the squared columns of each block, beside a smooth process (b,)
    dependent: float = DEPENDENT
    positive: frozenset[int] = frozenset()  # candidates of one column, nothing if negative
    stated: Mapping[int, float] = MappingProxyType({})  # candidates whose size is known to be small
    apart: frozenset[int] = frozenset()  # masks of two candidates that no set has both of
    near_any: frozenset[int] = frozenset()  # candidates that make much of anything
    several: bool = False  # whether they are of several measurements
    together: bool = False  # whether one that acts makes others likelier (`.evidence`)
    _banned: frozenset[int] = frozenset()
    _inner_products: Among  # of blocks that were asked for together
    _last: tuple[Floats, Floats] | None = None  # residuals and their products
    _known: "tuple[Candidates, int] | None" = None  # what these are beside, and its count of parts
    _multiplied: tuple[Mapping[int, Floats], int] = NOT_MULTIPLIED  # gram rows of so many parts

    def _build(
        self,
        pieces: Iterable[Piece],
        count: int,
        numbers: int,
        basis: Floats,
        alone: Collection[int] = (),
    ) -> None:
        """Orthonormalise the columns of each block beside the basis; drop what is dependent."""
        self.count, self.curves = count, dict[int, float]()
        n, p = basis.shape
        self.dof = n - p
        kind = storage(numbers)
        shelf = Shelf(n)
        owner, rank, start = [NONE], [NONE], [NONE]
        for batch in batches(pieces, alone if kind is np.float32 else ()):
            filled = shelf.filled
            # Linear candidates are few, and may differ by less than single precision resolves.
            one = all(j in alone for j, _ in batch)
            some = unit_blocks([v for _, v in batch], basis, np.float64 if one else kind, shelf)
            curves = zip(batch, some[2], strict=True)
            self.curves |= {j: curve for (j, _), curve in curves if curve is not None}
            owner += [np.full(len(v), j, dtype=np.intp) for j, v in batch]
            rank.append(some[0])
            start.append(some[1] + filled)
        self._parts: tuple[Floats | Part, ...] = shelf.parts() or (np.zeros((0, n)),)
        self.owner, self.rank, self.start = map(np.concatenate, (owner, rank, start))
        self.variant = np.arange(len(self.owner)) - np.searchsorted(self.owner, self.owner)
        self._made = self.owner, self.rank, self.start  # of rank 0, too
        self._keep(self.rank > 0)

    def beside(
        self, variants: Sequence[Columns], own_level: Floats, own_price: Floats | None = None
    ) -> "Candidates":
        """Return these candidates and further ones, numbered after them.

        ``own_level``, ``own_price``: of the further ones only.
        """
        new = object.__new__(Candidates)
        new.stated, new.positive, new.apart = self.stated, self.positive, self.apart
        new.several, new.together, new.near_any = self.several, self.together, self.near_any
        new._build(enumerate(variants), len(variants), 0, self._basis)
        new.owner = np.concatenate([self.owner, new.owner + self.count])
        new.variant = np.concatenate([self.variant, new.variant])
        new.rank = np.concatenate([self.rank, new.rank])
        new.start = np.concatenate([self.start, new.start + self.width])
        new._parts = (*self._parts, *new._parts)
        new.count += self.count
        new._known = (self, len(self._parts))
        new._multiplied = self._gram_rows, len(self._parts)
        new.curves = dict(self.curves)
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
        new.dependent = self.dependent
        more = np.ones(len(new.owner) - len(self.owner))
        new.kept = np.append(self.kept * np.ones(len(self.owner)), more)
        return new

    def with_variants(
        self, further: Mapping[int, tuple[int, Columns]], without: Mapping[int, int]
    ) -> "Candidates":
        """Return these with one variant more of some that have several, none of them inflated.

        ``further``: by the candidate's number, which of its variants it is, and its columns
        (1, n, k); ``without``: a variant of some that is there no more, by its number so far.
        """
        new = copy(self)
        vars(new).pop("by_rank", None)
        as_before = ~np.isin(self._made[0], [*further])
        new._made = self._made[0][as_before], self._made[1][as_before], self._made[2][as_before]
        for j, variant in without.items():
            new._keep((new.owner != j) | (new.variant != variant))
            new.variant = new.variant - ((new.owner == j) & (new.variant > variant))
        shelf = Shelf(len(self._basis))
        for j, (variant, columns) in further.items():
            start = self.width + shelf.filled
            rank = unit_blocks([columns], self._basis, np.float64, shelf)[0][0]
            new.variant = new.variant + ((new.owner == j) & (new.variant >= variant))
            before = (new.owner < j) | ((new.owner == j) & (new.variant < variant))
            at = int(np.count_nonzero(before))
            block = {"owner": j, "variant": variant, "rank": rank, "start": start}
            for name, number in block.items():
                setattr(new, name, np.insert(getattr(new, name), at, number))
        new._keep(new.rank > 0)
        new._parts = (*self._parts, *shelf.parts())
        new._ends = list(itertools.accumulate(map(len, new._parts)))
        if self._last is not None:
            r, known = self._last
            new._last = r, np.concatenate([known, products(shelf.parts(), r)])
        number = {start: b for b, start in enumerate(new.start.tolist())}
        moved = ((number.get(int(self.start[b])), rows) for b, rows in self._gram_rows.items())
        new._multiplied = {b: rows for b, rows in moved if b is not None}, len(self._parts)
        new._gram_rows, new._inner_products = {}, Among()  # blocks have other numbers
        new.curves = {j: length for j, length in self.curves.items() if j not in further}
        new._price(None)
        new.ban(self._banned)
        return new

    def inflate(self, factor: Floats) -> None:
        """Raise the penalty of each block by a factor (b,): it gains so much more by chance."""
        self.penalty = self.penalty + (factor - self.inflation) * self.chance
        self.inflation = factor

    def ban(self, members: Iterable[int]) -> None:
        """Let no set have these candidates."""
        self._banned = self._banned | frozenset(members)
        banned = np.isin(self.owner, sorted(self._banned))
        self.penalty = np.where(banned, np.inf, self.penalty)

    def not_beside(self, mask: int) -> int:
        """Bits of the candidates that no set has that has all of ``mask``."""
        return reduce(or_, (pair & ~mask for pair in self.apart if pair & mask), 0)

    def stands_for(self, j: int) -> tuple[int, ...]:
        """Candidates of which no set has any beside this one, if each is one of one place."""
        others = tuple((pair ^ 1 << j).bit_length() - 1 for pair in self.apart if pair >> j & 1)
        found = {k for k in others if np.count_nonzero(self.owner == k) == 1}
        return tuple(sorted(found)) if len(found) == len(others) else ()

    def _complete(
        self,
        basis: Floats,
        level: float,
        own_level: Floats | None,
        own_price: Floats | None,
        multiplicity: float | None = None,
        among: Floats | None = None,
        sought: Floats | None = None,
    ) -> None:
        """Group the blocks and price them."""
        self._basis, self.fitted, self._shared_level = basis, int(basis.shape[1]), level
        self._ends = list(itertools.accumulate(map(len, self._parts)))
        self.identifiable = np.unique(self.owner)
        self.not_identifiable = np.setdiff1d(np.arange(self.count), self.identifiable)
        self._gram_rows: dict[int, Floats] = {}
        first = None if self._known is None else self._known[0]
        self._inner_products = Among() if first is None else first._inner_products.copied()
        self._group()
        own = np.zeros(self.count) if own_level is None else own_level
        shared = np.sum(own[self.identifiable] == 0) if multiplicity is None else multiplicity
        count = np.full(self.count, max(shared, 1))
        count = count if among is None else np.where(among > 0, among, count)
        count = count if sought is None else count * sought
        self.level = np.where(own > 0, own, level / count)
        self.multiplicity = float(shared)
        self._price(own_price)

    def _price(self, own_price: Floats | None) -> None:
        """Price the blocks by how many places each candidate has."""
        self.places = self._places()
        self.inflation = np.ones(len(self.owner))
        self.chance = self.penalty = self.by_chance()
        if own_price is not None:
            self.penalty = self.penalty + own_price[self.owner]

    def by_chance(self) -> Floats:
        """What each block gains by chance at the level of its candidate, at any place (b,)."""
        return np.asarray(special.chdtri(self.rank, self.level[self.owner] / self.places))

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

    def orthonormal(self, j: int, some: slice) -> tuple[Floats, slice, Integers] | None:
        """Return an array, which of its rows are columns of a candidate's variants, their ranks.

        None: they are not kept in double precision, or further places were added.
        """
        owner, rank, start = self._made
        if not len(every := np.flatnonzero(owner == j)[some]):
            return None
        blocks = every[rank[every] > 0]
        at = np.searchsorted(self._ends, start[blocks], side="right")
        found: list[tuple[Floats, slice]] = []
        for i in np.unique(at).tolist():
            part, own = self._parts[i], blocks[at == i]
            if not isinstance(part, np.ndarray) or part.dtype != np.float64:
                return None
            first = int(start[own[0]]) - self._ends[i] + len(part)
            found.append((part, slice(first, first + int(rank[own].sum()))))
        if len(found) != 1:
            array = np.concatenate([np.zeros((0, len(self._basis))), *(x[own] for x, own in found)])
            found = [(array, slice(len(array)))]
        return *found[0], rank[every]

    def makes_any(self, polynomials: Floats, basis: Floats) -> bool:
        """Whether one candidate is any smooth function of a quantity: a curve along an axis, say.

        ``polynomials``: of the quantity, white, (n, m), from degree 1, which may be a candidate of
        its own; ``basis``: orthonormal, of what is always fitted, (n, p).
        """
        some = polynomials[:, :SMOOTH_DEGREE]
        some = some - basis @ (basis.T @ some)
        squares = some.T @ some
        if len(squares) < 2:  # of a quantity of two values nothing is curved
            return False
        for k, every, _ in self.by_rank:
            blocks = every[~np.isin(self.owner[every], [*self.near_any])]
            if k < len(squares) - 1 or not len(blocks):
                continue
            # The columns of a block are orthonormal, and what they leave of the line beside them.
            own = self._along(blocks, some)
            made = own.transpose(0, 2, 1) @ own
            left = (squares - made)[:, 0]
            line = np.where(left[:, 0] > ROUNDING * squares[0, 0], left[:, 0], np.inf)
            made = np.diagonal(made, axis1=1, axis2=2) + left**2 / line[:, None]
            if np.any(np.all(made[:, 1:] > MADE * np.diag(squares)[1:], axis=1)):
                return True
        return False

    def _along(self, blocks: Integers, r: Floats) -> Floats:
        """Inner products of the columns of blocks of one rank with columns r (n, s), (b, k, s)."""
        k = int(self.rank[blocks[0]])
        parts = np.searchsorted(self._ends, self.start[blocks], side="right")
        out = np.zeros((len(blocks), k, r.shape[1]))
        for i in np.unique(parts).tolist():
            own, part = parts == i, self._parts[i]
            first = self.start[blocks[own]] - self._ends[i] + len(part)
            out[own] = products([part], r)[first[:, None] + np.arange(k)]
        return out

    def _place(self, block: int) -> tuple[Floats | Part, slice]:
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
        if not isinstance(part, np.ndarray) and part is other:
            return part.inner(some, others)
        return inner(part[some], other[others].T)

    def gram_rows(self, block: int) -> Floats:
        """Inner products of a block's columns with all columns, shape (k, M)."""
        if block not in self._gram_rows:
            self.prepare([block])
        return self._gram_rows[block]

    def prepare(self, blocks: Iterable[int]) -> None:
        """Calculate :meth:`gram_rows` of several blocks at once."""
        missing = [b for b in dict.fromkeys(blocks) if b not in self._gram_rows]
        known, further = self._multiplied
        for some, parts in (
            ([b for b in missing if b in known], self._parts[further:]),
            ([b for b in missing if b not in known], self._parts),
        ):
            places = {b: self._place(b) for b in some}
            self._gram_rows |= multiplied(parts, places, len(self._basis))
        for b in missing:
            if b in known:
                self._gram_rows[b] = np.concatenate([known[b], self._gram_rows[b]], axis=1)

    def gram(self, blocks: Sequence[int]) -> Floats:
        """Inner products of the columns of blocks with each other, (K, K)."""
        known = all(b in self._gram_rows for b in blocks)
        if not known and len(self._basis) < MANY_ROWS:
            return self._inner_products.gram(blocks, self.columns)
        self.prepare(blocks)
        every = np.concatenate([np.arange(self.width)[self.span(b)] for b in blocks])
        return np.concatenate([self._gram_rows[b][:, every] for b in blocks])

    def _group(self) -> None:
        """Find candidates whose columns span the same: one stands for all of them."""
        self.alike: dict[int, list[int]] = {}
        single = np.bincount(self.owner, minlength=self.count) == 1
        alone = self.identifiable[single[self.identifiable]]
        at = np.searchsorted(self.owner, alone)
        rank = self.rank[at]
        if len(alone):
            squares = squared_products([self._place(int(b)) for b in at], len(self._basis))
            first = np.concatenate([[0], np.cumsum(rank)[:-1]]).astype(np.intp)
            overlap = np.add.reduceat(np.add.reduceat(squares, first, axis=0), first, axis=1)
            same = (np.abs(overlap - rank) < DEPENDENT) & (rank == rank[:, None])
        place = {int(j): i for i, j in enumerate(alone)}
        for j in map(int, self.identifiable):
            home = j
            if single[j]:
                before = alone[: place[j]][same[: place[j], place[j]]].tolist()
                homes = (
                    i
                    for i in before
                    if i in self.alike
                    and not {i, j} & self.positive  # the other one may be negative
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
            if j not in self.curves:
                self.curves[j] = float(np.sum(np.arccos(np.minimum(self._overlaps(blocks), 1.0))))
            length, u = self.curves[j], special.chdtri(1, self.level[j])
            out[blocks] = min(float(len(blocks)), 1.0 + length / np.pi * np.sqrt(np.pi * u / 2))
        return out

    def _overlaps(self, blocks: Integers) -> Floats:
        """Cosine between each of some blocks and the next (b - 1,)."""
        same = np.diff(np.searchsorted(self._ends, self.start[blocks], side="right")) == 0
        same &= np.diff(self.rank[blocks]) == 0
        same &= np.diff(self.start[blocks]) == self.rank[blocks][:-1]
        found: list[Floats] = []
        for i, run in enumerate(runs := np.split(blocks, np.flatnonzero(~same) + 1)):
            if i:
                found.append(self._inner(int(runs[i - 1][-1]), int(run[0]))[None])
            part, some = self._place(int(run[0]))
            k = some.stop - some.start
            found.append(neighbours(part, slice(some.start, some.start + k * len(run)), k))
        return np.concatenate([np.sqrt((x**2).sum(axis=(1, 2)) / max(x.shape[1:])) for x in found])

    def products(self, r: Floats) -> Floats:
        """Inner products of all columns with residuals (n,) or (n, s): shape (M,) or (M, s)."""
        if self._last is not None and self._last[0] is r:
            return self._last[1]
        known = None if self._known is None else self._known[0]._last
        if self._known is not None and known is not None and known[0] is r:
            joined = np.concatenate([known[1], products(self._parts[self._known[1] :], r)])
        else:
            joined = products(self._parts, r)
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
