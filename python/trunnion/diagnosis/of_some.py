"""Columns that are zero but for some readings: causes of one of several measurements.

What is always fitted may be shared by all readings, and is taken out of a column there, too. That
is a combination of few columns for all causes: it is kept as such, and never made.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trunnion.base.rows import product_of_seen
from trunnion.base.units import Floats, Integers

ROUNDING = 1e-6  # of a count of directions, from squares of many numbers


@dataclass(frozen=True, eq=False)
class OfSome:
    """Columns of variants that are zero in all readings but those ``at``, theirs: (v, m, k)."""

    own: Floats
    at: slice

    @classmethod
    def of(cls, made: "Floats | OfSome | Orthonormal") -> "OfSome":
        """Return columns as such: those of all readings are of all."""
        if isinstance(made, np.ndarray):
            return cls(made, slice(0, made.shape[1]))
        return made.whole() if isinstance(made, Orthonormal) else made

    def __len__(self) -> int:
        """Count of the variants."""
        return len(self.own)

    def made(self, variant: int, n: int) -> Floats:
        """Columns of a variant in all n readings, (n, k)."""
        out = np.zeros((n, self.own.shape[2]))
        out[self.at] = self.own[variant]
        return out

    def rows(self, some: Integers | slice) -> "OfSome":
        """Return the same of some of the rows, in order, or of all."""
        if isinstance(some, slice):
            return self
        first, last = np.searchsorted(some, [self.at.start, self.at.stop]).tolist()
        return OfSome(self.own[:, some[first:last] - self.at.start], slice(first, last))


@dataclass(frozen=True, eq=False)
class Orthonormal:
    """Columns of some readings that are orthonormal by block, beside all that is fitted there.

    Nothing of that is fitted in other readings, too: beside what is fitted in all they stay so.

    array, some: Holds them, one a row (M, m); which of its rows they are. rank: How many are of
    each variant (v,). at: The readings. fitted: In how many directions these are fitted. whole:
    Makes the columns of the variants as they were. curve: Length of what the unit columns of all
    variants draw; None: these are not all, or it is not known.
    """

    array: Floats
    some: slice
    rank: Integers
    at: slice
    fitted: int
    whole: Callable[[], OfSome]
    curve: float | None = None

    def __len__(self) -> int:
        """Count of the variants."""
        return len(self.rank)

    @property
    def own(self) -> Floats:
        """The columns, (M, m)."""
        return self.array[self.some]

    def rows(self, some: Integers | slice) -> "Orthonormal | OfSome":
        """Return columns of some of the rows, in order: those of all are orthonormal."""
        return self if isinstance(some, slice) else self.whole().rows(some)

    def holds(self, basis: Floats) -> bool:
        """Whether a basis of what is fitted in all readings (n, p) has just the directions here."""
        return abs(float(np.sum(basis[self.at] ** 2)) - self.fitted) < ROUNDING

    @staticmethod
    def joined(made: "list[Orthonormal]", basis: Floats) -> "list[Beside]":
        """Return the columns of several, of the same readings: no copies.

        Those that follow each other in an array are one.
        """
        runs: list[tuple[Floats, slice]] = []
        for m in made:
            last = runs[-1] if runs else None
            if last is not None and last[0] is m.array and last[1].stop == m.some.start:
                runs[-1] = m.array, slice(last[1].start, m.some.stop)
            else:
                runs.append((m.array, m.some))
        return [Beside(array[some], made[0].at, basis) for array, some in runs]


@dataclass(frozen=True, eq=False)
class Beside:
    """Columns of some readings, ``own`` (M, m), less their share ``of_basis`` (M, p) in a basis.

    The basis is of all readings, (n, p), and so is what is left; None: they have no share in it.
    """

    own: Floats
    at: slice
    basis: Floats
    of_basis: Floats | None = None

    def __len__(self) -> int:
        return len(self.own)

    def __getitem__(self, some: slice) -> Floats:
        """Columns themselves, (k, n)."""
        own = self.own[some]
        if self.of_basis is None:
            out = np.zeros((len(own), len(self.basis)))
            out[:, self.at] = own
            return out
        out = -(self.of_basis[some] @ self.basis.T)
        out[:, self.at] += own
        return np.asarray(out)

    def times(self, r: Floats) -> Floats:
        """Inner products of the columns with residuals (n,) or (n, s)."""
        return self.along(r, None if self.of_basis is None else self.basis.T @ r)

    def along(self, r: Floats, basis: Floats | None) -> Floats:
        """Return the same; ``basis``: inner products of the basis with them, if it is needed."""
        own = product_of_seen(self.own, r[self.at])
        return own if self.of_basis is None or basis is None else own - self.of_basis @ basis

    def with_some(self, r: Floats, at: slice) -> Floats:
        """Inner products with columns r (m, s) that are zero in all readings but those ``at``."""
        first, last = max(self.at.start, at.start), min(self.at.stop, at.stop)
        own = np.zeros((len(self.own), r.shape[1]))
        if first < last:
            mine = self.own[:, first - self.at.start : last - self.at.start]
            own = np.asarray(mine @ r[first - at.start : last - at.start])
        if self.of_basis is None:
            return own
        return np.asarray(own - self.of_basis @ (self.basis[at].T @ r))

    def inner(self, some: slice, others: slice) -> Floats:
        """Inner products of some columns with others, (k, l)."""
        own = np.asarray(self.own[some] @ self.own[others].T)
        if self.of_basis is None:
            return own
        return np.asarray(own - self.of_basis[some] @ self.of_basis[others].T)

    def neighbours(self, some: slice, k: int) -> Floats:
        """Inner products of each k of some columns with the next k, (b - 1, k, k)."""
        own = _of_next(self.own[some], k)
        return own if self.of_basis is None else own - _of_next(self.of_basis[some], k)


def _of_next(rows: Floats, k: int) -> Floats:
    """Inner products of each k of some rows with the next k, (b - 1, k, k)."""
    own = rows.reshape(-1, k, rows.shape[1])
    return np.asarray(own[:-1] @ own[1:].transpose(0, 2, 1))
