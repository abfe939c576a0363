"""Functions of one covariate, kept for all terms of structure without a name that they make.

Functions of one width (a cosine and a sine; a line and a parabola) that enter the readings by the
same components are a part. Its columns, each function times each component, are never formed. Of
many readings neither are jumps: their inner products are sums over the readings behind each.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import Self, TypeAlias

import numpy as np

from trunnion._core import gains_of_blocks
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.columns import AT_HAND, AT_ONCE, BATCH_NUMBERS, MIN_ROWS
from trunnion.diagnosis.whitening import Whiten, identity, sizes_of

DEPENDENT = 1e-4  # of a squared unit column, what the fit and the term's other columns leave


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

    def made(self) -> Floats:
        """Return these functions, (m, 1, n)."""
        return (np.arange(self.count) >= self.first[:, None]).astype(float)[:, None]

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


class Waiting:
    """Functions of one width that enter by the same components, until there are many.

    Few functions at a time cost more to call for than to calculate with.
    """

    def __init__(self, components: Sequence[Floats], some: slice) -> None:
        self._components, self._some = components, some
        self._first: list[Integers] = []
        self._functions: list[Floats] = []
        self._size = 0

    def add(self, first: Integers, functions: Floats) -> bool:
        """Add functions (m, k, n), their first terms (m,); whether these are enough for a part."""
        self._first.append(first)
        self._functions.append(functions)
        self._size += functions.size
        return self._size >= BATCH_NUMBERS

    def made(self) -> "Made":
        """Return these functions together."""
        some = self._functions
        functions = some[0] if len(some) == 1 else np.concatenate(some)
        return made_of(np.concatenate(self._first), functions, self._components, self._some)


Made: TypeAlias = tuple[Integers, Floats | Jumps, Floats, slice]
"""Numbers of the terms, functions and components of a part, and the readings of all these."""


def made_of(
    first: Integers, functions: Floats | Jumps, components: Sequence[Floats], some: slice
) -> Made:
    """Return functions that enter by components; ``first``: the first term of each, (m,)."""
    numbers = first[:, None] + np.arange(len(components))
    return numbers.reshape(-1), functions, np.stack(components), some


def part_of(made: Made, every: Integers, n: int, whiten: Whiten) -> "Part":
    """Return the part of functions, given for some of n readings, whitened."""
    numbers, functions, components, some = made
    rows = every[some]
    sizes = sizes_of(whiten, n)
    if sizes is not None and not np.any(np.isnan(sizes[rows])):
        own = components if whiten is identity else components / sizes[rows]
        if isinstance(functions, Jumps):
            return JumpPart(numbers, functions, own, some)
        return FunctionPart(numbers, functions, own, some)
    f = functions.made() if isinstance(functions, Jumps) else functions
    k, each = f.shape[1], len(components)
    white = np.empty((len(numbers), k, len(rows)))
    most = max(1, BATCH_NUMBERS // (each * k * n))
    for first in range(0, len(f), most):
        products = f[first : first + most, None] * components[None, :, None]
        columns = products.reshape(-1, len(rows)).T
        full = np.zeros((n, columns.shape[1]))
        full[rows] = columns
        done = np.asarray(whiten(full))[rows].T
        white[each * first : each * (first + most)] = done.reshape(-1, k, len(rows))
    return FunctionPart(numbers, white, np.ones((1, len(rows))), some)


class Part(ABC):
    """Terms of functions of one width: each function times each component.

    The products are never formed: inner products with them are those of the functions with what the
    components leave of the other side.

    numbers: Of the terms, by function, then component, (m c,).
    components: (c, n).
    some: The readings that these are of; in others all is 0.
    size, scale: Length of each column, and what makes it 1, (m, c, k).
    gram: Inner products of the columns of a term, (m c, k, k), of unit length in the end.
    """

    gram: Floats

    def __init__(self, numbers: Integers, components: Floats, size: Floats, some: slice) -> None:
        self.numbers, self.components, self.some = numbers, components, some
        self.size = self.scale = size

    def __len__(self) -> int:
        return len(self.numbers)

    def among(self, terms: int, readings: int) -> Self:
        """Return the same terms behind so many others, in readings behind so many others."""
        new = copy(self)
        new.numbers = self.numbers + terms
        new.some = slice(self.some.start + readings, self.some.stop + readings)
        return new

    @property
    def width(self) -> int:
        """Functions of a term."""
        return int(self.size.shape[2])

    @property
    @abstractmethod
    def kept(self) -> int:
        """Count of the numbers that are kept."""

    @abstractmethod
    def serves(self, made: Made) -> bool:
        """Whether the functions are these very ones."""

    @abstractmethod
    def store(self, kind: type[np.float32 | np.float64]) -> None:
        """Keep the functions in this precision, once their products with each other are known."""

    @abstractmethod
    def block(self, number: int) -> Floats:
        """Columns of one term, shape (n, k)."""

    def normalise(self, least: float) -> None:
        """Give the columns unit length, and zeros to those that are no longer than ``least``."""
        k = self.width
        self.scale = 1.0 / np.where(self.size > least, self.size, np.inf)
        for i in range(k):
            for j in range(i):
                g = self.gram[:, :, i, j] * self.scale[:, :, i] * self.scale[:, :, j]
                self.gram[:, :, i, j] = self.gram[:, :, j, i] = g
        self.gram = self.gram.reshape(-1, k, k)

    def products(self, sums: Floats) -> Floats:
        """Inner products of unit columns (m c k, s), from those of functions with c s columns."""
        m, each, k = self.size.shape
        own = sums.reshape(m, k, each, -1).transpose(0, 2, 1, 3)
        return np.asarray((own * self.scale[..., None]).reshape(m * each * k, -1))


class FunctionPart(Part):
    """Terms of functions that are kept, (m, k, n)."""

    def __init__(
        self, numbers: Integers, functions: Floats, components: Floats, some: slice
    ) -> None:
        self.functions = functions
        size = np.sqrt(self._weighted(functions, functions, components**2))
        super().__init__(numbers, components, size, some)

    @property
    def kept(self) -> int:
        """Count of the numbers that are kept."""
        return int(self.functions.size)

    def serves(self, made: Made) -> bool:
        """Whether the functions are these very ones."""
        return self.functions is made[1]

    def store(self, kind: type[np.float32 | np.float64]) -> None:
        """Keep the functions in this precision, once their products with each other are known."""
        if not hasattr(self, "gram"):
            k, squares = self.width, self.components**2
            self.gram = np.ones((*self.size.shape, k))
            for i in range(k):
                for j in range(i):
                    g = self._weighted(self.functions[:, i], self.functions[:, j], squares)
                    self.gram[:, :, i, j] = g
        self.functions = self.functions.astype(kind, copy=False)

    @staticmethod
    def _weighted(x: Floats, y: Floats, weights: Floats) -> Floats:
        """Sum over readings of x y (m, ..., n both) times each weight (c, n): (m, c, ...)."""
        n, count = x.shape[-1], x.size // x.shape[-1]
        out = np.zeros((count, len(weights)))
        most = max(MIN_ROWS, AT_HAND // count)
        for first in range(0, n, most):
            some = slice(first, first + most)
            product = np.multiply(x[..., some], y[..., some], order="C")  # reshaped without a copy
            out += product.reshape(count, -1) @ weights[:, some].T
        return np.asarray(np.moveaxis(out.reshape(*x.shape[:-1], len(weights)), -1, 1))

    def rows(self, some: slice) -> Floats:
        """Functions at some of their readings, one a row, (m k, r)."""
        own = self.functions[:, :, some]
        return own.reshape(-1, own.shape[2])

    def block(self, number: int) -> Floats:
        """Columns of one term, shape (n, k)."""
        f, c = divmod(number, len(self.components))
        columns = self.functions[f].astype(np.float64) * self.components[c]
        return np.asarray((columns * self.scale[f, c][:, None]).T)


class JumpPart(Part):
    """Terms of jumps, of which none is made."""

    kept = 0

    def __init__(self, numbers: Integers, jumps: Jumps, components: Floats, some: slice) -> None:
        self.jumps = jumps
        between = np.zeros((len(jumps) + 1, len(components)))
        jumps.add((components**2).T, 0, between)
        super().__init__(numbers, components, np.sqrt(jumps.behind(between))[:, :, None], some)
        self.gram = np.ones((*self.size.shape, 1))

    def serves(self, made: Made) -> bool:
        """Whether the functions are these very ones."""
        return self.jumps is made[1]

    def store(self, kind: type[np.float32 | np.float64]) -> None:
        """Nothing is kept."""

    def products(self, sums: Floats) -> Floats:
        """Inner products of unit columns (m c, s), from sums between jumps of c s columns."""
        return super().products(self.jumps.behind(sums))

    def block(self, number: int) -> Floats:
        """Columns of one term, shape (n, 1)."""
        f, c = divmod(number, len(self.components))
        column = self.components[c] * self.scale[f, c]
        column[: self.jumps.first[f]] = 0.0
        return np.asarray(column[:, None])


class Together:
    """Parts whose functions enter by the same components, and are of the same readings.

    One product for all: its right side is packed anew for each, however few functions it has.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        self._components, self._some = parts[0].components, parts[0].some
        self._kept = [part for part in parts if isinstance(part, FunctionPart)]
        self._jumps = [part for part in parts if isinstance(part, JumpPart)]
        few = self._kept and self._components.shape[1] <= AT_ONCE
        self._every = self._functions(slice(None)) if few else None  # once for all products

    def _functions(self, some: slice) -> Floats:
        """Functions of all parts at some of their readings, one a row, in double precision."""
        return np.concatenate([x.rows(some) for x in self._kept], dtype=np.float64)

    def products(self, r: Floats) -> dict[int, Floats]:
        """Inner products of all columns with r (n, s), (columns, s) of each part by its id.

        Some readings at a time, so that functions are made double once for all components.
        """
        own, width = r[self._some], len(self._components) * r.shape[1]
        ends = np.cumsum([0, *(part.size.shape[0] * part.width for part in self._kept)])
        sums = np.zeros((ends[-1], width))
        between = [np.zeros((len(part.jumps) + 1, width)) for part in self._jumps]
        for first in range(0, len(own), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            # each column in a row of memory: short rows cost more to go through than to multiply
            each = self._components[:, None, some] * own[some].T
            weighted = each.reshape(width, each.shape[2]).T
            if self._kept:
                functions = self._functions(some) if self._every is None else self._every
                sums += functions @ weighted
            for part, total in zip(self._jumps, between, strict=True):
                part.jumps.add(weighted, first, total)
        parts: list[Part] = [*self._kept, *self._jumps]
        totals = [*(sums[a:b] for a, b in pairwise(ends)), *between]
        return {id(x): x.products(total) for x, total in zip(parts, totals, strict=True)}


@dataclass(frozen=True)
class Alike:
    """Parts of terms of k columns: numbers of the terms (t,), their inner products (t k, k)."""

    parts: Sequence[Part]
    numbers: Integers
    gram: Floats

    @classmethod
    def of_each_width(cls, parts: Sequence[Part]) -> "list[Alike]":
        """Put parts of the same width together."""
        by_width: dict[int, list[Part]] = {}
        for part in parts:
            by_width.setdefault(part.width, []).append(part)
        found = []
        for k, some in by_width.items():
            gram = np.concatenate([part.gram for part in some]).reshape(-1, k)
            found.append(cls(some, np.concatenate([part.numbers for part in some]), gram))
        return found

    def gains(self, basis: Floats, residuals: Floats) -> tuple[Floats, Integers]:
        """Gains (t, s) and ranks (t,), by inner products with a basis (t k, q) and residuals."""
        return gains_of_blocks(self.gram, basis, residuals, DEPENDENT)
