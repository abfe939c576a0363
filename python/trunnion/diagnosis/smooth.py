"""A smooth error of no known form along a recorded quantity, which competes with causes.

What no cause makes may be any smooth function of time or place: a thermal error, a worn guideway.
A sum of causes comes near to many such functions, and fits them to the noise. So a Gaussian process
along each quantity competes with the causes (squared exponential covariance, Rasmussen and Williams
2006, 4.2). It stands in the noise, alone or beside causes: those are judged by what it does not
make, and it is judged by what they leave. Its length and size are not known; its likelihood is that
of what the nuisance parameters leave (Patterson and Thompson 1971), mean over a grid of both.

The covariance is kept on Legendre polynomials of the quantity, so that time and memory are linear
in readings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from trunnion.base.resolution import Floor
from trunnion.base.units import Floats
from trunnion.diagnosis.whitening import Coloured

LENGTHS = (0.15, 0.25, 0.4, 0.7, 1.2, 2.0, 3.5)  # of a process, in halves of the range
SIZES = 2.0 ** np.arange(-2, 11)  # of a process, in noises of a reading
DEGREE = 24  # of polynomials: of the shortest process they leave a few per cent
NODES = 64  # of the quadrature
ROUNDING = 1e-14  # of a sum of squares
SEEN = 1e-9  # of the longest combination of polynomials, what is more than rounding
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Process:
    """The likeliest process along a quantity, beside some columns.

    Attributes
    ----------
    whiten:
        What makes its noise white.
    cost:
        By how much -2 ln L is more than that of what is left when whitened: the mean over all
        lengths and sizes, not of the likeliest alone.
    deviance:
        -2 ln L, with this cost.
    """

    whiten: Coloured
    cost: float
    deviance: float


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of squares that columns leave in noises; of fewer columns without another look at rows.

    Attributes
    ----------
    table:
        Inverse of the inner products of the columns, bordered by their sizes and the negative sum
        of squares that is left, of each noise and last of white noise, (..., m + 1, q + 1, q + 1).
    of_noise:
        Logarithm of the determinants of the noises and of those inner products, (..., m + 1).
    """

    table: Floats
    of_noise: Floats

    @classmethod
    def of(cls, products: Floats, log_det: Floats) -> Sums:
        """Of the inner products of columns and, last, residuals in each noise, and white noise."""
        inner, along = products[..., :-1, :-1], products[..., :-1, -1:]
        inverse = np.linalg.inv(inner)
        sizes = inverse @ along
        rows, column = along.swapaxes(-1, -2), sizes.swapaxes(-1, -2)
        left = rows @ sizes - products[..., -1:, -1:]
        table = np.block([[inverse, sizes], [column, left]])
        return cls(table, log_det + np.linalg.slogdet(inner)[1])

    @classmethod
    def together(cls, several: Sequence[Sums]) -> Sums:
        """Those of several kinds of noise, beside the same columns."""
        return cls(np.stack([x.table for x in several]), np.stack([x.of_noise for x in several]))

    def without(self, columns: Sequence[int] = ()) -> tuple[Floats, Floats]:
        """Sums of squares (..., m) beside all columns but some, and logarithms of determinants.

        Of each noise; what is kept of the table is what these columns and the residuals need.
        """
        gone, last = np.asarray(columns, dtype=np.intp), self.table.shape[-1] - 1
        left, of_noise = -self.table[..., last, last], self.of_noise
        if len(gone):  # all at once: a smooth shape has a hundred columns
            pivot, row = self.table[..., gone[:, None], gone], self.table[..., gone, last]
            taken = np.linalg.solve(pivot, row[..., None])[..., 0]
            left = left + np.einsum("...i,...i->...", row, taken)
            of_noise = of_noise + np.linalg.slogdet(pivot)[1]
        return left[..., :-1], of_noise[..., :-1] - of_noise[..., -1:]


@dataclass(frozen=True, eq=False)
class Along:
    """A quantity along which there may be a process, beside the nuisance parameters.

    columns: Polynomials of it times a component, white, (n, m).
    basis: Orthonormal, of what the nuisance parameters absorb, (n, p).
    residuals: White, orthogonal to the basis, (n,).
    floor: Of the variance of a reading.
    """

    columns: Floats
    basis: Floats
    residuals: Floats
    floor: Floor

    @cached_property
    def _own(self) -> tuple[Floats, Floats]:
        """Orthonormal columns (n, k) beside the basis, and the polynomials in these (k, m)."""
        left = self.columns - self.basis @ (self.basis.T @ self.columns)
        turn, back = _orthonormal(left.T @ left)
        return left @ turn, back

    @cached_property
    def _shapes(self) -> Floats:
        """Covariance of processes of size 1 in the own columns, of each length, (l, k, k)."""
        back = self._own[1]
        return np.asarray(back @ covariances(self.columns.shape[1]) @ back.T)

    @cached_property
    def _axes(self) -> tuple[Floats, Floats]:
        """Variances of each process along its axes (l s, k), and these (l, k, k)."""
        variance, axes = np.linalg.eigh(self._shapes)
        each = np.maximum(variance, 0.0)[:, None] * SIZES[:, None] ** 2
        return np.concatenate(each), axes

    def sums(self, fitted: Floats) -> Sums:
        """Return the sums of squares beside columns (n, q), in the noise with each process."""
        every = np.column_stack([fitted, self.residuals])
        variance, axes = self._axes
        seen = axes.transpose(0, 2, 1) @ (self._own[0].T @ every)
        seen = np.repeat(seen, len(SIZES), axis=0)
        taken = seen.transpose(0, 2, 1) @ (seen * (variance / (1.0 + variance))[:, :, None])
        products = every.T @ every - np.concatenate([taken, np.zeros((1, *taken.shape[1:]))])
        return Sums.of(products, np.append(np.log1p(variance).sum(axis=1), 0.0))

    def deviances(self, left: Floats, log_det: Floats) -> Floats:
        """-2 ln L of the sums of squares that are left in noises of such determinants."""
        dof = len(self.residuals) - self.basis.shape[1]
        least = ROUNDING * float(self.residuals @ self.residuals)
        return np.asarray(self.floor.deviance(np.maximum(left, least), dof) + log_det)

    def process(self, deviances: Floats) -> Process:
        """Return the likeliest process, of the deviances of all (l s,)."""
        at, mean = int(np.argmin(deviances)), float(mean_deviance(deviances))
        length, size = divmod(at, len(SIZES))
        covariance = self._shapes[length] * SIZES[size] ** 2
        whole = float(np.log1p(self._axes[0][at]).sum())
        cost = whole + mean - float(deviances[at])
        return Process(Coloured(self._own[0], covariance), cost, mean)

    def beside(self, fitted: Floats) -> Process:
        """Return the likeliest process beside columns (n, q) that are fitted, too."""
        return self.process(self.deviances(*self.sums(fitted).without()))


def mean_deviance(deviances: Floats) -> Floats:
    """-2 ln of the mean likelihood of all processes, (..., l s)."""
    least = deviances.min(axis=-1)
    return np.asarray(least - 2.0 * np.log(np.mean(np.exp((least[..., None] - deviances) / 2), -1)))


def polynomials(values: Floats, distinct: Floats, most: int = DEGREE) -> Floats:
    """Legendre polynomials of a quantity over its range, (n, m), from degree 1 to ``most``.

    ``distinct``: its values, sorted; of few the degree is lower.
    """
    x = over_range(values, distinct[0], distinct[-1])
    degree = min(most, len(distinct) - 1)
    made = np.polynomial.legendre.legvander(x, degree)[:, 1:]
    return np.asarray(made, dtype=np.float64)


def over_range(values: Floats, low: float, high: float) -> Floats:
    """Values of a range as places from -1 to 1."""
    return np.asarray(2 * (values - low) / (high - low) - 1, dtype=np.float64)


@cache
def covariances(count: int, first: int = 1) -> Floats:
    """Covariances of processes of size 1, of each length, on polynomials of degree first to count.

    Those of degree 0 are the mean of a process.
    """
    x, weight = np.polynomial.legendre.leggauss(NODES)
    p = np.polynomial.legendre.legvander(x, count)[:, first:]
    project = (p * weight[:, None] * (np.arange(first, count + 1) + 0.5)).T
    return np.stack([project @ c @ project.T for c in _alike(x)])


def _alike(x: Floats) -> Iterator[Floats]:
    """Correlation of a process at places x with itself, of each length."""
    for length in LENGTHS:
        yield np.exp(-0.5 * ((x[:, None] - x) / length) ** 2)


def _orthonormal(gram: Floats) -> tuple[Floats, Floats]:
    """What makes columns of inner products (m, m) orthonormal (m, k), and them of these (k, m)."""
    w, v = np.linalg.eigh(gram)
    kept = w > SEEN * w.max(initial=TINY)
    size = np.sqrt(w[kept])
    return v[:, kept] / size, size[:, None] * v[:, kept].T
