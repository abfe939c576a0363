"""Linear least squares with one rule for what the data do not identify.

Columns are scaled to unit length, so that units do not matter. A combination of parameters is *not
identifiable* if its singular value is at most :data:`RANK_TOLERANCE` of the largest. One parameter
of it is held, its step is zero: the last one that has a fair share. The others are determined then.
The core does the work (``rust/core/src/linear.rs``); time and memory are linear in rows. Of many
rows the triangular factor, on which all is decided, comes from inner products, taken twice where
their condition is not small, and the basis from BLAS: a third of the time.

A model that is not linear in its parameters is judged at its start, where dependencies are exact:
away from it, leftovers of second order look like information. Afterwards it moves only in the
``directions`` found there. Where every combination is exact these are the parameters that are not
held. Where one is only weak, holding one parameter would put on the others what the data do show;
the directions then leave the combination alone as a whole.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

import trunnion._core as _core
from trunnion.base.rows import seen_of
from trunnion.base.threads import one_blas_thread
from trunnion.base.units import Flags, Floats

RANK_TOLERANCE = _core.RANK_TOLERANCE
"""Share of the largest singular value up to which one counts as zero."""
MANY_ROWS = 1 << 14
"""Rows from which memory counts: no array of them is made that is not needed."""
QUICK_ROWS = 1 << 10
"""Rows from which the triangular factor comes from inner products, which is quicker."""
FACTORED_ROWS = 1024  # of these at a time: they stay in the processor's cache
MAX_SQUARE = 1e6  # condition of inner products, up to which these will do
EPS = float(np.finfo(np.float64).eps)
NORMAL_MEDIAN = 0.6745  # median size of a normal variable of unit variance
WELL_CONDITIONED = 1e-3  # least singular value of unit columns whose basis is made orthogonal once


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Result of :func:`linear_fit` for n rows and p parameters.

    solution: Parameters, shape (p,); 0 for those that are held.
    cofactor: Covariance per unit of noise (variance 1), shape (p, p); 0 for those that are held.
    rank: How many parameters are determined.
    singular_values: Of the columns at unit length, those held beforehand left out; largest first.
    held: Parameters that are held, shape (p,): beforehand, or one for each combination that is not
        identifiable.
    not_identifiable: Whether each parameter takes part in a combination that is not identifiable,
        shape (p,).
    combinations: These combinations, shape (k, p), in the parameters' own units, largest component
        1: a step along one of them changes no value. Reduced: each names one held parameter and
        what it cannot be distinguished from.
    directions: In which the parameters are identifiable, shape (rank, p), own units: unit vectors
        of those that are not held, or the singular directions where a combination is weak and not
        exact.
    basis: Orthonormal basis of the columns that are not held, shape (n, rank), or (0, rank) where
        it was not asked for.
    """

    solution: Floats
    cofactor: Floats
    rank: int
    singular_values: Floats
    held: Flags
    not_identifiable: Flags
    combinations: Floats
    directions: Floats
    basis: Floats

    @property
    def std(self) -> Floats:
        """Standard errors per unit of noise, shape (p,); inf where not identifiable."""
        return np.where(self.not_identifiable, np.inf, np.sqrt(np.diag(self.cofactor)))


def linear_fit(
    columns: Floats,
    values: Floats,
    *,
    hold: Flags | None = None,
    tolerance: float = RANK_TOLERANCE,
    basis: bool = False,
) -> LinearFit:
    """Solve ``columns @ solution = values`` by least squares.

    columns: Design, shape (n, p), of one noise: divide rows by their standard deviation beforehand.
    values: Right-hand side, shape (n,).
    hold: Parameters that are held at zero beforehand, shape (p,); they count neither as
        identifiable nor as not.
    tolerance: Another share than :data:`RANK_TOLERANCE`, for a design that is exact: linear models
        have no leftovers of second order.
    basis: Whether the orthonormal basis is expected.

    Raises InputError: shapes that do not fit, or numbers that are not finite.
    """
    columns, values = np.asarray(columns, dtype=np.float64), np.asarray(values, dtype=np.float64)
    held = [] if hold is None else np.asarray(hold, dtype=bool).tolist()
    if columns.ndim != 2 or values.shape != columns.shape[:1] or len(columns) < QUICK_ROWS:
        return LinearFit(*_core.linear_fit(columns, values, held, tolerance, basis))
    with one_blas_thread():
        factor = quick_factor(columns, values)
        fit = LinearFit(*_core.linear_fit(factor[:, :-1], factor[:, -1], held, tolerance, False))
        return replace(fit, basis=basis_of(columns, fit, factor)) if basis else fit


def basis_of_all(columns: Floats) -> Floats:
    """Orthonormal basis of columns (n, p), which may be none: (n, rank)."""
    if not columns.shape[1]:
        return columns
    return linear_fit(columns, np.zeros(len(columns)), basis=True).basis


@dataclass(frozen=True, eq=False)
class Spanned:
    """Orthonormal basis of columns, (n, p) times weights (p, rank), that is not made.

    Rows (k, n) times it are what they have of the basis, (k, rank).
    """

    columns: Floats
    weights: Floats
    __array_ufunc__ = None  # products with arrays are made here

    def __rmatmul__(self, rows: Floats) -> Floats:
        return np.asarray((rows @ self.columns) @ self.weights)

    def __getitem__(self, some: slice) -> "Spanned":
        """Rows of it."""
        return Spanned(self.columns[some], self.weights)

    def left(self, values: Floats) -> Floats:
        """Return what the basis leaves of values (n,)."""
        return np.asarray(values - self.columns @ (self.weights @ (values @ self)))


def spanned(columns: Floats, values: Floats, hold: Flags) -> Spanned:
    """Orthonormal basis of many columns but those held, made only where they are nearly dependent.

    columns, values, hold: As of :func:`linear_fit`.
    """
    with one_blas_thread():
        factor = quick_factor(columns, values)
        square, right = factor[:, :-1], factor[:, -1]
        fit = LinearFit(*_core.linear_fit(square, right, hold.tolist(), RANK_TOLERANCE, False))
        if fit.singular_values[: fit.rank].min(initial=np.inf) < WELL_CONDITIONED:
            return Spanned(basis_of(columns, fit, factor), np.eye(fit.rank))
        weights = np.zeros((len(hold), fit.rank))
        weights[~fit.held] = _whitening(square[:, ~fit.held])
        return Spanned(columns, weights)


def factor_of(covariance: Floats) -> Floats:
    """Columns at right angles of which a covariance is the product with their transpose, (q, q)."""
    size, axes = np.linalg.eigh(covariance)
    return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)))


def in_columns(columns: Floats) -> Floats:
    """Return columns, (n, k), of many rows one after the other in memory: no sum strides."""
    return np.asfortranarray(columns) if len(columns) >= MANY_ROWS else columns


def triangular_factor(columns: Floats, values: Floats) -> Floats:
    """Triangular factor of columns with values as a last column, (p + 1, p + 1).

    Least squares of its rows have the solution of all rows.
    """
    factor: Floats = np.zeros((0, columns.shape[1] + 1))
    for some in _some_rows(len(columns), factor.shape[1]):
        stacked = np.concatenate([factor, np.column_stack([columns[some], values[some]])])
        factor = np.asarray(np.linalg.qr(stacked, mode="r"))
    return factor


def quick_factor(columns: Floats, values: Floats, mixed: Floats | None = None) -> Floats:
    """Triangular factor as of :func:`triangular_factor`, from inner products.

    They have the square of the condition: where that is at most `MAX_SQUARE`, what rounding makes
    of a solution is 1e-10 of it; elsewhere they serve to make columns whose condition is small, of
    which they are taken again. ``mixed``: combinations (p, r) of the columns, which stand for them.
    """
    products = np.empty((columns.shape[1] + 1,) * 2)
    products[:-1, :-1] = _products(columns)
    products[-1, :-1] = products[:-1, -1] = values @ columns
    products[-1, -1] = values @ values
    if not np.all(np.isfinite(products)):
        return triangular_factor(columns if mixed is None else columns @ mixed, values)
    joined = np.eye(len(products)) if mixed is None else _with_one(mixed)
    gram = joined.T @ products @ joined
    # What is left where columns cancel has the rounding of what they were.
    whole = (np.abs(joined).T @ np.sqrt(np.diag(products))) ** 2
    size = np.sqrt(np.maximum(np.diag(gram), EPS * whole))
    # Columns of zeros are so in the factor, too: their length is multiplied in again.
    scale = np.where(size > 0, size, 1.0)
    unit = gram / np.outer(scale, scale)
    least = len(unit) / MAX_SQUARE
    if np.all(size**2 >= least * whole):
        full = unit + np.diag(size == 0)
        if np.linalg.eigvalsh(full)[0] > least:
            return np.asarray(np.linalg.cholesky(full).T * size)
    return np.asarray(_factor_again(columns, values, joined / scale, unit) * size)


def _products(columns: Floats) -> Floats:
    """Inner products of columns (n, p), (p, p): what is zero in some rows costs nothing there.

    As those of one of several measurements below each other are in the rows of all others.
    """
    if len(columns) >= MANY_ROWS:
        return np.asarray(columns.T @ columns)
    out = np.zeros((columns.shape[1],) * 2)
    for first in range(0, len(columns), QUICK_ROWS):
        own = columns[first : first + QUICK_ROWS]
        seen = seen_of(own)
        if seen.all():
            out += own.T @ own
        else:
            own = own[:, seen]
            out[np.ix_(seen, seen)] += own.T @ own
    return out


def _with_one(mixed: Floats) -> Floats:
    """Combinations of columns, and what stands beside them as it is, (p + 1, r + 1)."""
    joined = np.zeros((mixed.shape[0] + 1, mixed.shape[1] + 1))
    joined[:-1, :-1], joined[-1, -1] = mixed, 1.0
    return joined


def _factor_again(columns: Floats, values: Floats, joined: Floats, unit: Floats) -> Floats:
    """Triangular factor of columns of unit length that depend on each other, nearly or exactly.

    ``joined``: their combinations of the columns and values, (p + 1, k); ``unit``: their inner
    products (k, k) with the rounding of these. Singular values are as exact as of LAPACK's factor:
    combinations that make the columns orthonormal as far as rounding allows leave less than its
    root to be found again.
    """
    share, ways = np.linalg.eigh(unit)
    root = np.sqrt(np.maximum(share, EPS * share[-1]))
    weights = joined @ (ways / root)
    again = np.zeros_like(unit)
    for some in _some_rows(len(columns), len(weights)):
        made = weights[:-1].T @ columns.T[:, some]
        made += np.multiply.outer(weights[-1], values[some])
        again += made @ made.T
    share, own = np.linalg.eigh(again)
    half = np.sqrt(np.maximum(share, 0.0))[:, None] * own.T
    return np.asarray(np.linalg.qr(half @ (root[:, None] * ways.T), mode="r"))


def _some_rows(count: int, width: int) -> Iterator[slice]:
    """Slices of rows of so many columns that stay in a processor's cache."""
    rows = max(FACTORED_ROWS, 4 * width)
    return (slice(first, first + rows) for first in range(0, count, rows))


def basis_of(
    columns: Floats, fit: LinearFit, factor: Floats, mixed: Floats | None = None
) -> Floats:
    """Orthonormal basis of the columns that a fit does not hold, (n, rank).

    ``factor``: triangular factor of all columns with the values; ``mixed``: as of
    :func:`quick_factor`.
    """
    free = ~fit.held
    some = slice(None) if free.all() or mixed is not None else free
    weights = _whitening(factor[:, :-1][:, free])
    weights = weights if mixed is None else mixed[:, free] @ weights
    basis = np.empty((len(columns), weights.shape[1]))
    for rows in _some_rows(*columns.shape):
        np.matmul(columns[rows, some], weights, out=basis[rows])
    weakest = fit.singular_values[: fit.rank].min(initial=np.inf)
    if weakest < WELL_CONDITIONED:
        turn = _whitening(quick_factor(basis, np.zeros(len(basis)))[:, :-1])
        for rows in _some_rows(*basis.shape):
            basis[rows] = basis[rows] @ turn
    return basis


def _whitening(factor: Floats) -> Floats:
    """Return the matrix that makes columns with this factor orthonormal, (rank, rank)."""
    size = np.linalg.norm(factor, axis=0)
    triangle = np.linalg.qr(factor / size, mode="r")
    return np.asarray(solve_triangular(triangle, np.eye(len(size))) / size[:, None])
