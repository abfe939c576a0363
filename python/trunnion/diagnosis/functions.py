"""Functions of one covariate, kept for all terms of structure without a name that they make.

A function is kept once for each value of its quantity where values come again and again: products
with it are those with the sums over the readings of each value. Terms whose functions enter the
readings by the same components are a part. Their columns, each function times each component, are
never formed. Of many readings neither are jumps: their inner products are sums over the readings
behind each.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import accumulate, pairwise, starmap
from typing import NamedTuple, Self

import numpy as np

from trunnion._core import gains_of_blocks, sums_by_value
from trunnion.base.rows import seen_of
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.columns import AT_HAND, AT_ONCE, BATCH_NUMBERS, MIN_ROWS
from trunnion.diagnosis.whitening import Whiten, identity, sizes_of

DEPENDENT = 1e-4  # of a squared unit column, what the fit and the term's other columns leave
SPANNED = 1e-9  # of the length of a column, that is left of it: it is made of others
ALL = slice(None)
MAX_DIRECTIONS = 128  # with which products are kept, of many readings


@dataclass(frozen=True)
class Jumps:
    """Functions that are 0 for the readings before one and 1 from it on, of which none is made.

    ``first``: that reading of each, ascending from above 0 (m,); ``count``: of all readings.
    """

    first: Integers
    count: int

    def __len__(self) -> int:
        return len(self.first)

    @classmethod
    def at(cls, values: Floats, places: Floats) -> "Jumps | None":
        """Return those at some values of a quantity; None: of few readings, or not in its order."""
        if len(values) < MANY_ROWS or np.any(np.diff(values) < 0):
            return None
        return cls(np.searchsorted(values, places), len(values))

    def made(self, some: Integers | slice = ALL) -> Floats:
        """Return some of these functions, (m, n)."""
        return (np.arange(self.count) >= self.first[some, None]).astype(float)

    def add(self, values: Floats, begun: int, between: Floats) -> None:
        """Add values of readings from one on, (r, s), to the sums between jumps, (m + 1, s)."""
        ended = begun + len(values)
        number = int(np.searchsorted(self.first, begun, side="right"))
        ends = self.first[number : np.searchsorted(self.first, ended)] - begun
        for sums, own in zip(between[number:], np.split(values, ends), strict=False):
            sums += own.sum(axis=0)

    @staticmethod
    def behind(between: Floats) -> Floats:
        """Return the sums behind each jump, (m, s), from those between them."""
        return np.asarray(np.cumsum(between[:0:-1], axis=0)[::-1])


@dataclass(frozen=True, eq=False)
class Places:
    """Which of its ``count`` values a quantity has at each reading, (n,); -1: none."""

    at: Integers
    count: int

    def sums(self, columns: Floats) -> Floats:
        """Sums of columns (n, s) over the readings of each value, (count, s)."""
        return sums_by_value(self.at[None], self.count, np.ones((1, len(columns))), columns)


@dataclass(frozen=True, eq=False)
class Functions:
    """Functions (r, d) at the values of a quantity; without ``places`` at each reading, (r, n)."""

    values: Floats
    places: Places | None = None

    def __len__(self) -> int:
        return len(self.values)

    def made(self, some: Integers | slice = ALL) -> Floats:
        """Return some of these functions at each reading, (r, n)."""
        values = self.values[some]
        if self.places is None:
            return values
        beside = np.zeros((len(values), 1))  # of readings without a value
        return np.concatenate([values, beside], axis=1)[:, self.places.at]


class Made(NamedTuple):
    """Functions, and m terms of them of each of some widths k, by their first number.

    Term i is of functions i, m + i, 2 m + i, ... k of them. ``some``: the readings that the
    functions and the ``ways`` they enter by, c of (n,), are of.
    """

    functions: Functions | Jumps
    first: Mapping[int, int]
    ways: tuple[Floats, ...]
    some: slice


@dataclass(frozen=True, eq=False)
class Wide:
    """Terms of one width of a part: each function, (m, k) rows of it, times each component.

    numbers: Of the terms, by function, then component, (m c,).
    scale: What makes each column of unit length, (m, c, k).
    gram: Inner products of the columns of a term, of unit length, (m c k, k).
    """

    rows: Integers
    numbers: Integers
    scale: Floats
    gram: Floats

    @classmethod
    def of(cls, rows: Integers, numbers: Integers, inner: Floats, least: float) -> "Wide":
        """Return terms by their inner products, (k (k + 1) / 2, m, c).

        Columns that are no longer than ``least`` are zeros.
        """
        k = rows.shape[1]
        low, high, own = _pairs(k)
        size = np.sqrt(inner[own].transpose(1, 2, 0))
        scale = 1.0 / np.where(size > least, size, np.inf)
        gram = np.ones((*size.shape, k))
        for i, (a, b) in enumerate(zip(low, high, strict=True)):
            if a != b:
                unit = inner[i] * scale[:, :, a] * scale[:, :, b]
                gram[:, :, a, b] = gram[:, :, b, a] = unit
        return cls(rows, numbers, scale, gram.reshape(-1, k))

    def products(self, sums: Floats) -> Floats:
        """Inner products of unit columns (m c k, s), from those of functions (r, c, s)."""
        own = sums[self.rows].transpose(0, 2, 1, 3) * self.scale[..., None]
        return np.asarray(own.reshape(-1, sums.shape[2]))

    def gains(self, basis: Floats, residuals: Floats) -> tuple[Floats, Integers]:
        """Gains (m c, s) and ranks (m c,), by inner products with a basis and residuals."""
        return gains_of_blocks(self.gram, basis, residuals, DEPENDENT)


@cache
def _pairs(k: int) -> tuple[list[int], list[int], list[int]]:
    """First and second of all pairs of so many functions, and which pairs are of one.

    Those of fewer functions come first.
    """
    high, low = np.tril_indices(k)
    return low.tolist(), high.tolist(), np.flatnonzero(low == high).tolist()


class Part:
    """Terms of functions that enter the same readings by the same components.

    components: White, (c, n). some: The readings that these are of; in others all is 0.
    by_reading: Whether the whitener divides each reading by its own noise. Where it does more, it
    is applied to the columns, and these are the functions.
    """

    def __init__(
        self, ways: Sequence[Floats], some: slice, every: Integers, n: int, whiten: Whiten
    ) -> None:
        """Have no terms yet; ``every``: the readings, of n, that the dictionary is of."""
        components, rows, sizes = np.stack(ways), every[some], sizes_of(whiten, n)
        self.some = some
        self.by_reading = sizes is not None and not np.any(np.isnan(sizes[rows]))
        self._white = partial(_white, ways=components, rows=rows, n=n, whiten=whiten)
        if sizes is None or not self.by_reading:
            components = np.ones((1, len(rows)))
        elif whiten is not identity:
            components = components / sizes[rows]
        self.components, self._squares = components, components**2
        self._kept: list[Functions | Jumps] = []
        self._first = [0]  # function of each, and the count of all
        self._found: dict[int, list[tuple[Integers, Integers, Floats]]] = {}
        self._by_value: dict[Places, Floats] = {}
        self._directions = np.zeros((len(rows), 0))  # orthonormal, products with which are known

    wide: Sequence[Wide] = ()  # all terms, once they are complete
    _along: Sequence[Floats] = ()  # the products with these directions of the terms of each width

    def add(self, made: Made, kind: type[np.float32 | np.float64]) -> int:
        """Add terms, functions kept in this precision; how many numbers more these are."""
        own = made.functions if self.by_reading else self._white(made.functions)
        most, begun = max(made.first), self._first[-1]
        inner = self._inner(own, most)
        m, each = inner.shape[1], len(self.components)
        for k, first in made.first.items():
            rows = np.arange(begun, begun + k * m).reshape(k, m).T
            numbers = np.arange(first, first + m * each)
            self._found.setdefault(k, []).append((rows, numbers, inner[: k * (k + 1) // 2]))
        self._kept.append(own)
        self._first.append(begun + len(own))
        self.store(kind)
        return own.values.size if isinstance(own, Functions) else 0

    def _inner(self, functions: Functions | Jumps, k: int) -> Floats:
        """Inner products of the columns of each term, by :func:`_pairs`, (k (k + 1) / 2, m, c)."""
        weights = self._squares.T
        if isinstance(functions, Jumps):
            between = np.zeros((len(functions) + 1, weights.shape[1]))
            functions.add(weights, 0, between)
            return Jumps.behind(between)[None]
        if (places := functions.places) is not None:
            if places not in self._by_value:
                self._by_value[places] = places.sums(weights)
            weights = self._by_value[places]
        low, high, _ = _pairs(k)
        values = functions.values.reshape(k, -1, len(weights))
        out = np.zeros((len(low), values.shape[1], weights.shape[1]))
        most = max(MIN_ROWS, AT_HAND // (len(low) * values.shape[1]))
        for begun in range(0, len(weights), most):
            own = values[:, :, begun : begun + most]
            out += (own[low] * own[high]) @ weights[begun : begun + most]
        return out

    @property
    def longest(self) -> float:
        """Length of the longest column."""
        own = (x[_pairs(k)[2]] for k, found in self._found.items() for _, _, x in found)
        return float(np.sqrt(max((x.max(initial=0.0) for x in own), default=0.0)))

    def complete(self, least: float) -> None:
        """Have all terms, with columns of unit length; zeros where no longer than ``least``."""
        for found in self._found.values():
            rows, numbers, inner = zip(*found, strict=True)
            joined = np.concatenate(rows), np.concatenate(numbers), np.concatenate(inner, axis=1)
            self.wide = [*self.wide, Wide.of(*joined, least)]
        self._along = [np.zeros((len(x.gram), 0)) for x in self.wide]

    def store(self, kind: type[np.float32 | np.float64]) -> None:
        """Keep the functions in this precision."""
        for i, own in enumerate(self._kept):
            if isinstance(own, Functions) and own.values.dtype != kind:
                self._kept[i] = replace(own, values=own.values.astype(kind))

    def among(self, terms: int, readings: int) -> Self:
        """Return the same terms behind so many others, in readings behind so many others."""
        new = copy(self)
        new.wide = [replace(x, numbers=x.numbers + terms) for x in self.wide]
        new.some = slice(self.some.start + readings, self.some.stop + readings)
        return new

    @cached_property
    def _values(self) -> tuple[Integers, dict[Places, slice]]:
        """Values of all quantities whose functions are kept by value, numbered together.

        That of each reading (v, n), and which are of each quantity.
        """
        places = (x.places for x in self._kept if isinstance(x, Functions))
        some = list(dict.fromkeys(x for x in places if x is not None))
        ends = pairwise(accumulate((x.count for x in some), initial=0))
        own = dict(zip(some, starmap(slice, ends), strict=True))
        return np.array([np.where(x.at < 0, -1, x.at + of.start) for x, of in own.items()]), own

    def products(self, columns: Floats) -> list[Floats]:
        """Inner products of the columns of the terms of each width with columns (n, s), (m c k, s).

        Columns are made of much the same each time: only what is new of them is multiplied. What is
        another measurement's own is zero here, and costs nothing.
        """
        own = columns[self.some]
        seen = seen_of(own)
        found = [np.zeros((len(x.gram), own.shape[1])) for x in self.wide]
        if seen.any():
            share = self._share(own[:, seen])
            for out, of_directions in zip(found, self._along, strict=True):
                out[:, seen] = of_directions @ share
        return found

    def _share(self, own: Floats) -> Floats:
        """Inner products of the directions with columns of these readings (n, s), (d, s).

        The directions are those that are known, and what is new of these columns.
        """
        share = self._directions.T @ own
        new = _new(own, own - self._directions @ share, self._directions)
        if not new.shape[1]:
            return share
        if len(share) and len(share) + new.shape[1] > MAX_DIRECTIONS:
            self._directions = self._directions[:, :0]
            self._along = [x[:, :0] for x in self._along]
            return self._share(own)
        both = zip(self._along, self._products(new), strict=True)
        self._along = [np.concatenate(x, axis=1) for x in both]
        self._directions = np.concatenate([self._directions, new], axis=1)
        return np.concatenate([share, new.T @ own])

    def _products(self, own: Floats) -> list[Floats]:
        """Return the same of columns of these readings, (n, s), one function after the other."""
        c, s = len(self.components), own.shape[1]
        sums = np.zeros((self._first[-1], c * s))
        kept = [(x, sums[a:b]) for x, (a, b) in zip(self._kept, pairwise(self._first), strict=True)]
        at, values = self._values
        if values:
            count = max(of.stop for of in values.values())
            by_value = sums_by_value(at, count, self.components, own)
            for x, out in kept:
                if isinstance(x, Functions) and x.places is not None:
                    np.matmul(x.values, by_value[values[x.places]], out=out)
        self._add_readings(own, [(x, out) for x, out in kept if getattr(x, "places", None) is None])
        return [x.products(sums.reshape(len(sums), c, s)) for x in self.wide]

    def _add_readings(self, r: Floats, kept: Sequence[tuple[Functions | Jumps, Floats]]) -> None:
        """Add products with functions of each reading, and with jumps, to the sums of each.

        Some readings at a time, so that functions are made double once for all components.
        """
        width = len(self.components) * r.shape[1]
        jumps = [(x, out, np.zeros((len(x) + 1, width))) for x, out in kept if isinstance(x, Jumps)]
        of_each = [(x.values, out) for x, out in kept if isinstance(x, Functions)]
        for first in range(0, len(r) if kept else 0, AT_ONCE):
            some = slice(first, first + AT_ONCE)
            # each column in a row of memory: short rows cost more to go through than to multiply
            each = self.components[:, None, some] * r[some].T
            weighted = each.reshape(width, each.shape[2]).T
            for values, out in of_each:
                out += values[:, some].astype(np.float64, copy=False) @ weighted
            for own, _, between in jumps:
                own.add(weighted, first, between)
        for own, out, between in jumps:
            out[:] = own.behind(between)

    def block(self, term: int) -> Floats | None:
        """Columns of one term, shape (n, k); None: it is not here."""
        for x in self.wide:
            for number in np.flatnonzero(x.numbers == term).tolist():
                f, c = divmod(number, len(self.components))
                every = int(np.searchsorted(self._first, x.rows[f, 0], side="right")) - 1
                own = self._kept[every].made(x.rows[f] - self._first[every])
                columns = own.astype(np.float64, copy=False) * self.components[c]
                return np.asarray((columns * x.scale[f, c][:, None]).T)
        return None


def _white(
    functions: Functions | Jumps, ways: Floats, rows: Integers, n: int, whiten: Whiten
) -> Functions:
    """Columns of functions, each times each way (c, n), white: functions of each reading."""
    f = functions.made()
    white = np.empty((len(f) * len(ways), len(rows)))
    most = max(1, BATCH_NUMBERS // (len(ways) * n))
    for first in range(0, len(f), most):
        columns = (f[first : first + most, None] * ways).reshape(-1, len(rows)).T
        full = np.zeros((n, columns.shape[1]))
        full[rows] = columns
        begin = first * len(ways)
        white[begin : begin + columns.shape[1]] = np.asarray(whiten(full))[rows].T
    return Functions(white)


def _new(columns: Floats, left: Floats, directions: Floats) -> Floats:
    """Directions of what orthonormal ones leave of columns: to rounding, twice is enough.

    left: What they leave of them, (n, s), once.
    """
    size = np.linalg.norm(columns, axis=0)
    new = np.linalg.norm(left, axis=0) > SPANNED * size
    left = left[:, new] / size[new]
    left = left - directions @ (directions.T @ left)
    ways, size, _ = np.linalg.svd(left, full_matrices=False)
    return np.asarray(ways[:, size > SPANNED])
