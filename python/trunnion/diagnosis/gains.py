"""What columns explain of a residual beside an orthonormal basis, and where they explain most."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trunnion.base.statistics import RANK_TOLERANCE, Spanned, linear_fit
from trunnion.base.units import Floats as Array
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.of_some import OfSome

DEPENDENT = 1e-9  # of the largest singular value of columns of unit length
GONE = 1e-12  # of a squared column, what rounding leaves of it
TRIALS_AT_ONCE = 16
GRID_ZOOMS = 2
ZOOM_POINTS = 9


def gains_at(
    columns: Callable[[Array], OfSome], trials: Array, basis: Array | Spanned, residual: Array
) -> Array:
    """Return :func:`gains_beside` of columns at several values, shape (v,), some at once.

    ``columns``: those at some of the values, of the readings that they change.
    """
    out = np.zeros(len(trials))
    for first in range(0, len(trials), TRIALS_AT_ONCE):
        some = slice(first, first + TRIALS_AT_ONCE)
        x = columns(trials[some])
        out[some] = gains_beside(x.own, basis[x.at], residual[x.at])
    return out


def gains_beside(variants: Array, basis: Array | Spanned, residual: Array) -> Array:
    """Drop of the RSS of a residual by columns (v, n, k), beside an orthonormal basis (n, q).

    Each set of columns by itself, shape (v,). ``residual``: what the basis leaves, (n,).
    """
    return Variants.of(variants.transpose(0, 2, 1)).gains(basis, residual)


@dataclass(frozen=True, eq=False)
class Variants:
    """Sets of columns, one column a row (v, k, n), and their inner products (v, k, k).

    ``left``: the same beside what is common to all that they are asked for.
    """

    rows: Array
    products: Array
    left: Array

    @classmethod
    def of(cls, rows: Array, common: Array | None = None) -> Variants:
        """Those of columns (v, k, n); ``common``: orthonormal directions (n, c) beside all."""
        products = rows @ rows.transpose(0, 2, 1)
        return cls(rows, products, products if common is None else _less(products, rows, common))

    def gains(self, basis: Array | Spanned, residual: Array) -> Array:
        """Drop of the RSS of a residual by each set beside an orthonormal basis, (v,).

        ``basis``: without what is common to all, which the residual has nothing of.
        """
        v, k, n = self.rows.shape
        left = _less(self.left, self.rows, basis)
        own, before = (np.diagonal(x, axis1=1, axis2=2) for x in (left, self.products))
        size = np.sqrt(np.where(own > GONE * before, own, np.inf))
        along = self.rows.reshape(-1, n) @ residual
        if k == 1:
            return np.asarray((along / size[:, 0]) ** 2)
        share, ways = np.linalg.eigh(left / (size[:, :, None] * size[:, None]))
        seen = share > RANK_TOLERANCE**2 * share.max(axis=1, initial=GONE, keepdims=True)
        along = (along.reshape(v, 1, k) / size[:, None] @ ways)[:, 0]
        return np.asarray(
            np.sum(np.where(seen, along**2 / np.where(seen, share, 1.0), 0.0), axis=1)
        )


def _less(products: Array, rows: Array, basis: Array | Spanned) -> Array:
    """Inner products (v, k, k) of rows (v, k, n) less those of what an orthonormal basis has."""
    v, k, n = rows.shape
    taken = (rows.reshape(-1, n) @ basis).reshape(v, k, -1)
    return np.asarray(products - taken @ taken.transpose(0, 2, 1))


def zoom_one(name: str, grid: Array, values: Values, gains_of: Callable[[Array], Array]) -> None:
    """Refine one nonlinear parameter for the largest gain, in place."""
    at = int(np.argmin(np.abs(grid - values[name])))
    low = float(grid[max(at - 1, 0)])
    high = float(grid[min(at + 1, len(grid) - 1)])
    for _ in range(GRID_ZOOMS):
        trials = np.linspace(low, high, ZOOM_POINTS)
        gains = gains_of(trials)
        # the middle of equally good values: between two touches a slip's time is free
        good = gains >= gains.max() * (1 - 1e-12)
        top = np.flatnonzero(good)
        first = last = int(top[len(top) // 2])
        while first > 0 and good[first - 1]:
            first -= 1
        while last < ZOOM_POINTS - 1 and good[last + 1]:
            last += 1
        values[name] = float(trials[first] + trials[last]) / 2
        low = float(trials[max(first - 1, 0)])
        high = float(trials[min(last + 1, ZOOM_POINTS - 1)])


def left_by(columns: Array, r: Array) -> float:
    """Sum of squares that columns (n, k), of whatever sizes, leave of readings (n,)."""
    left = r - columns @ linear_fit(columns, r, tolerance=DEPENDENT).solution
    return float(left @ left)
