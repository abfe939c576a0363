"""Errors of no known form that neighbouring features share: how large, and over what distance.

A machine errs otherwise than its catalogue of causes says, and it errs alike at neighbouring
places. What is left beside the causes is then no white noise, and scale, squareness or a bow are
less certain than so many independent features make them. The noise is taken as white noise beside a
Gaussian process over the places, rough or smooth: its correlation is exp(-distance / length) or
exp(-(distance / length)²), alike and independent in each coordinate (Cressie 1993, 2.3). Its share
and its length are judged by restricted likelihood (Patterson and Thompson 1971) beside all
functions of the place that causes may add, on a grid. What follows is the mean over the grid,
weighed by likelihood: what is not known of the process is in it.

A process longer than the half of the places is not seen: it is a scale, a bow, an angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import special
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis import outliers
from trunnion.diagnosis.whitening import Correlated

LEVEL = 0.02  # of the likelihood ratio test; among lengths and kinds about 1 % of white noise
MAX_PLACES = 500  # a dense matrix of places
MIN_FREE = 20  # places more than functions
SHARES = np.geomspace(0.03, 30.0, 11)  # variance of the process over that of the white noise
POWERS = (1.0, 2.0)  # of the distance
LENGTH_RATIO = 2.0
BLOCK_LENGTHS = 2.0  # of a block that is left out for cross-validation
NEIGHBOURS = 6  # the median of which foretells a place
DEPENDENT = 1e-6  # of the largest singular value of functions


@dataclass(frozen=True, eq=False)
class Process:
    """Processes that are likely, each with its weight; weights add up to 1.

    ``powers``, ``lengths``: of the distance, mm; ``white``, ``shared``: variance of white noise and
    of the process, µm².
    """

    weights: Floats
    powers: Floats
    lengths: Floats
    white: Floats
    shared: Floats

    @classmethod
    def of(cls, places: Floats, left: Floats, functions: Floats) -> Process | None:
        """Return that of residuals (n, d) at places; None: they are white.

        ``functions``: of the place, which causes and placement may add, (n, k).
        """
        some = _thinned(len(places))
        places, left, functions = places[some], left[some], functions[some]
        u, k = _basis(functions, every=True)
        n, d = left.shape
        if n - k < MIN_FREE:
            return None
        beside = u[:, k:]
        count, along = (n - k) * d, beside.T @ left
        apart = cdist(places, places)
        every = []
        for power, length in product(POWERS, _lengths(places)):
            w, v = np.linalg.eigh(beside.T @ _alike(apart, power, length) @ beside)
            size = 1.0 + SHARES * np.maximum(w, 0.0)[:, None]
            white = np.sum(np.sum((v.T @ along) ** 2, axis=1)[:, None] / size, axis=0) / count
            deviance = count * np.log(white) + d * np.sum(np.log(size), axis=0)
            same = np.ones(len(SHARES))
            every.append((deviance, power * same, length * same, white, SHARES * white))
        deviance, powers, lengths, white, shared = np.concatenate(every, axis=1)
        gain = count * np.log(np.sum(along**2) / count) - deviance
        if gain.max() < special.chdtri(1, LEVEL):
            return None
        likely = np.exp((gain - gain.max()) / 2)
        return cls(likely / likely.sum(), powers, lengths, white, shared)

    def covariance(self, places: Floats, basis: Floats) -> Floats:
        """Covariance of combinations of readings (n, d, k), orthonormal, shape (k, k), µm²."""
        n, _, k = basis.shape
        some = _thinned(n)
        apart = cdist(places[some], places[some])
        mine = basis[some] * (n / len(some))
        out = np.eye(k) * float(self.weights @ (self.white + self.shared))
        for power, length in set(zip(self.powers.tolist(), self.lengths.tolist(), strict=True)):
            here = (self.powers == power) & (self.lengths == length)
            alike = _alike(apart, power, length)
            np.fill_diagonal(alike, 0.0)  # a reading with itself: all of them, above
            size = float(self.weights[here] @ self.shared[here])
            out += size * np.einsum("idk,ij,jdl->kl", mine, alike, mine, optimize=True)
        return out

    @property
    def typical(self) -> tuple[float, float, float]:
        """Length in mm, sizes of the process and of the white noise in µm."""
        mean = (np.exp(self.weights @ np.log(x)) for x in (self.lengths, self.shared, self.white))
        length, shared, white = map(float, mean)
        return length, shared**0.5, white**0.5


def correlated(
    places: Floats,
    left: Floats,
    columns: Floats,
    variance: float,
    used: Integers,
) -> Correlated | None:
    """Noise of features at places (n, d) that leave ``left`` (n, d), used ones only (rows).

    ``columns``: of causes and placement that are functions of the place, (n d, k); ``variance``:
    of the white noise that is estimated beside them, µm².
    """
    n, d = left.shape
    process = Process.of(places[used], left[used], columns.reshape(n, -1)[used])
    if process is None:
        return None
    mine = np.zeros((n, d, columns.shape[1]))
    mine[used] = columns.reshape(n, d, -1)[used]
    u, k = _basis(mine.reshape(n * d, -1))
    basis = u[:, :k]
    covariance = process.covariance(places[used], basis.reshape(n, d, -1)[used])
    length, shared, white = process.typical
    note = (
        f"What is left of neighbouring features is alike: errors of {shared:.2g} µm rms that "
        f"no cause makes are correlated over about {length:.2g} mm, beside {white:.2g} µm of "
        "each feature. Standard errors and probabilities allow for it."
    )
    more = covariance / variance - np.eye(len(covariance))
    return Correlated(basis, more, note, np.repeat(_blocks(places, length), d))


def unlike_neighbours(places: Floats, left: Floats) -> Integers:
    """Places (m, d) where what is left (m, c) is far from the median of their neighbours'."""
    if len(places) <= MIN_FREE:
        return np.zeros(0, dtype=np.intp)
    near = np.asarray(cKDTree(places).query(places, k=NEIGHBOURS + 1)[1])[:, 1:]
    off = np.abs(left - np.median(left[near], axis=1))
    typical = np.median(off, axis=0) / 0.6745
    seen = np.flatnonzero(typical > 0)
    far = [outliers.far_out(off[:, i] / typical[i], len(off)) for i in seen]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *far]))


def _alike(apart: Floats, power: float, length: float) -> Floats:
    """Correlation over distances."""
    return np.asarray(np.exp(-((apart / length) ** power)))


def _basis(columns: Floats, *, every: bool = False) -> tuple[Floats, int]:
    """Orthonormal columns of which the first span these; how many do. ``every``: of the space."""
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=every)
    return u, int(np.sum(s > DEPENDENT * s[0]))


def _thinned(n: int) -> Integers:
    """Rows that stand for n rows, evenly spaced in their order."""
    return np.unique(np.linspace(0, n - 1, min(n, MAX_PLACES)).astype(np.intp))


def _blocks(places: Floats, length: float) -> Integers:
    """Block of each place: squares of twice the length, fewer than four nowhere."""
    extent = np.ptp(places, axis=0)
    count = np.maximum(extent // (BLOCK_LENGTHS * length), 1.0)
    count[np.argsort(extent)[-2:]] = np.maximum(count[np.argsort(extent)[-2:]], 2.0)
    share = (places - places.min(axis=0)) / np.where(extent > 0, extent, 1.0)
    cell = np.minimum(share * count, count - 1).astype(np.intp)
    return np.unique(cell, axis=0, return_inverse=True)[1].reshape(-1).astype(np.intp)


def _lengths(places: Floats) -> Floats:
    """Lengths to try, mm: from the distance of neighbours to the extent of all."""
    near = np.asarray(cKDTree(places).query(places, k=2)[0])[:, 1]
    shortest = float(np.median(near[near > 0])) if np.any(near > 0) else 1.0
    longest = float(np.linalg.norm(np.ptp(places, axis=0)))
    count = int(np.log(max(longest / shortest, 1.0)) / np.log(LENGTH_RATIO)) + 1
    return np.asarray(shortest * LENGTH_RATIO ** np.arange(count), dtype=np.float64)
