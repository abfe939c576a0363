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

from collections.abc import Iterator
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

    def beside(self, fitted: Floats) -> Process:
        """Return the likeliest process beside orthonormal columns (n, q) that are fitted, too."""
        own, y = self._own[0], self.residuals
        dof = len(y) - self.basis.shape[1]
        taken, along = fitted.T @ own, fitted.T @ y
        turn, back = _orthonormal(np.eye(own.shape[1]) - taken.T @ taken)
        seen = turn.T @ (own.T @ y - taken.T @ along)
        rest = float(y @ y - along @ along - seen @ seen)
        variance, axes = np.linalg.eigh(back @ self._shapes @ back.T)
        variance = 1.0 + np.maximum(variance, 0.0)[:, None] * SIZES[:, None] ** 2
        squares = np.einsum("lij,i->lj", axes, seen)[:, None] ** 2
        rss = np.maximum(rest, TINY) + np.sum(squares / variance, axis=2)
        log_det = np.sum(np.log(variance), axis=2)
        deviance = np.asarray(self.floor.deviance(rss, dof)) + log_det
        length, size = np.unravel_index(int(np.argmin(deviance)), deviance.shape)
        least = float(deviance[length, size])
        of_all = -2.0 * float(np.log(np.mean(np.exp((least - deviance) / 2))))
        more = self._shapes[length] * SIZES[size] ** 2
        whole = np.linalg.slogdet(np.eye(len(more)) + more)[1]
        return Process(Coloured(own, more), float(whole) + of_all, least + of_all)


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
def covariances(count: int) -> Floats:
    """Covariances of processes of size 1, of each length, on so many polynomials from degree 1."""
    x, weight = np.polynomial.legendre.leggauss(NODES)
    p = np.polynomial.legendre.legvander(x, count)[:, 1:]
    project = (p * weight[:, None] * (np.arange(1, count + 1) + 0.5)).T
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
