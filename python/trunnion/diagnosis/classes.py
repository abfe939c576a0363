"""Columns of candidates that have a size of their own in each class of readings.

A wave whose size is another in each pass has as many columns as passes, each zero in all others.
Kept are the functions alone, of which a class takes its readings: of twenty passes a twentieth.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from trunnion.base.rotation import cosine_sine
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.columns import ROUNDING, inner, orthonormal_weights

TOGETHER = 32  # variants whose functions are in one array


@dataclass(frozen=True, eq=False)
class Spread:
    """How the linear parameters of an effect are functions times classes of readings.

    Attributes
    ----------
    label:
        Class of each reading, 0, 1, ..., shape (n,).
    functions:
        Derivatives by the parameters of a class as if all readings were of it, shape (own, n).
        Linear parameters go by class, then by function.
    """

    label: Integers
    functions: Callable[[Mapping[str, float]], Floats]


def waves_in_classes(place: Floats, blocks: Sequence[slice | Integers], period: str) -> Spread:
    """Waves of places, with a period by name of its parameter; blocks: rows of each class."""
    label = np.zeros(len(place), dtype=np.intp)
    for number, rows in enumerate(blocks):
        label[rows] = number
    return Spread(label, partial(_waves, place, period))


def _waves(place: Floats, period: str, values: Mapping[str, float]) -> Floats:
    return cosine_sine(2 * np.pi * place / values[period])


@dataclass(frozen=True, eq=False)
class InClasses:
    """Columns of the variants of a candidate, of which none is made.

    ``function``: functions of a variant by its number, all readings; ``label``: of the readings
    that are used, ``used``: which these are.
    """

    function: Callable[[int], Floats]
    variants: int
    label: Integers
    used: Integers | slice

    def __len__(self) -> int:
        """Count of the variants."""
        return self.variants

    def rows(self, some: Integers | slice) -> "InClasses":
        """Return the same of some of the rows."""
        return replace(self, label=self.label[some], used=some)

    def orthonormal(
        self, basis: Floats, kind: type[np.float32 | np.float64]
    ) -> tuple["ClassColumns", Integers, Integers]:
        """Orthonormal columns of each variant beside a basis, their rank, and where they start."""
        order = np.argsort(self.label, kind="stable")
        ends = np.searchsorted(self.label[order], np.arange(self.label.max() + 2))
        classes = [slice(a, b) for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]
        in_order = bool(np.all(np.diff(order) == 1))
        beside = basis if in_order else basis[order]
        functions: list[Floats] = []
        grams, taken = [], []
        room: Floats = np.empty((0, 0, len(order)))
        for first in range(0, self.variants, TOGETHER):
            for i in range(first, min(first + TOGETHER, self.variants)):
                one = self.function(i)[:, self.used]
                if i == 0:
                    room = np.empty((min(TOGETHER, self.variants), *one.shape))
                room[i - first] = one if in_order else one[:, order]
            own = room[: min(TOGETHER, self.variants - first)]
            b, k, n = own.shape
            gram = np.zeros((b, len(classes), k, len(classes), k))
            for c, some in enumerate(classes):
                gram[:, c, :, c] = own[:, :, some] @ own[:, :, some].transpose(0, 2, 1)
            grams.append(gram.reshape(b, k * len(classes), -1))
            flat = own.reshape(-1, n)
            each = [(flat[:, some] @ beside[some]).reshape(b, k, -1) for some in classes]
            taken.append(np.concatenate(each, axis=1))
            functions.append(flat.astype(kind))
        gram = np.concatenate(grams)
        least = ROUNDING**2 * float(gram.max(initial=0.0))
        weights, of_basis, seen = orthonormal_weights(gram, np.concatenate(taken), least)
        rank = seen.sum(axis=1)
        start = np.concatenate([[0], np.cumsum(rank)[:-1]]).astype(np.intp)
        variant = np.repeat(np.arange(self.variants), rank)
        part = ClassColumns(functions, classes, order, basis, variant, weights[seen], of_basis)
        return part, rank, start


@dataclass(frozen=True, eq=False)
class ClassColumns:
    """Combinations of functions in classes, less their share in a basis.

    ``functions``: of `TOGETHER` variants each, one after the other, class by class; ``variant``: of
    each column, (m,); ``weights``: of its functions in each class, (m, classes * own);
    ``of_basis``: (m, p).
    """

    functions: list[Floats]
    classes: list[slice]
    order: Integers
    basis: Floats
    variant: Integers
    weights: Floats
    of_basis: Floats

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, some: slice) -> Floats:
        """Columns themselves, (k, n)."""
        out = np.empty((len(self.weights[some]), len(self.order)))
        for own, variant, weights in zip(out, self.variant[some], self.weights[some], strict=True):
            by_class = weights.reshape(len(self.classes), -1)
            functions = self._functions(variant)
            for rows, of_class in zip(self.classes, by_class, strict=True):
                own[self.order[rows]] = of_class @ functions[:, rows]
        out -= self.of_basis[some] @ self.basis.T
        return out

    def _functions(self, variant: int) -> Floats:
        """Functions of a variant, (own, n)."""
        k = self.weights.shape[1] // len(self.classes)
        at = variant % TOGETHER * k
        return self.functions[variant // TOGETHER][at : at + k]

    @cached_property
    def _sorted(self) -> bool:
        return bool(np.all(np.diff(self.order) == 1))

    def times(self, r: Floats) -> Floats:
        """Inner products of the columns with residuals (n,) or (n, s)."""
        several = r.reshape(len(r), -1)
        mine = several if self._sorted else several[self.order]
        s, count = several.shape[1], len(self.classes)
        k = self.weights.shape[1] // count
        found = [
            np.stack([inner(f[:, rows], mine[rows]).reshape(-1, k, s) for rows in self.classes], 1)
            for f in self.functions
        ]
        each = np.concatenate(found).reshape(-1, count * k, s)[self.variant]
        out = (self.weights[:, None] @ each)[:, 0]
        out -= self.of_basis @ (self.basis.T @ several)
        return out.reshape(-1, *r.shape[1:])

    def inner(self, some: slice, others: slice) -> Floats:
        """Inner products of columns of one variant with those of another, (k, l)."""
        a, b = (self._functions(int(self.variant[one.start])) for one in (some, others))
        parts = [
            inner(a[:, rows].astype(np.float64), b[:, rows].T.astype(np.float64))
            for rows in self.classes
        ]
        k = len(a)
        mine, theirs = (
            self.weights[one].reshape(-1, len(self.classes), k) for one in (some, others)
        )
        whole = sum(mine[:, c] @ products @ theirs[:, c].T for c, products in enumerate(parts))
        return np.asarray(whole - self.of_basis[some] @ self.of_basis[others].T)

    def neighbours(self, some: slice, k: int) -> Floats:
        """Inner products of each k of some columns with the next k, (b - 1, k, k)."""
        blocks = [slice(at, at + k) for at in range(some.start, some.stop, k)]
        found = [self.inner(a, b) for a, b in itertools.pairwise(blocks)]
        return np.array(found).reshape(len(blocks) - 1, k, k)
