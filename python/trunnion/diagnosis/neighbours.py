"""Errors of no known form that are alike where readings are near each other: how large, how far.

The noise is taken as white noise beside a Gaussian process over the places, or over the time, rough
or smooth: its correlation is exp(-distance / length) or exp(-(distance / length)²), alike and
independent in each coordinate (Cressie 1993, 2.3). Its share and its length are judged by
restricted likelihood (Patterson and Thompson 1971) beside all functions of the place that causes
may add, on a grid. What follows is the mean over the grid, weighed by likelihood: what is not known
of the process is in it.

A process longer than the half of the places is not seen: it is a scale, a bow, an angle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import special

from trunnion.base.units import Floats, Integers

LEVEL = 0.02  # of the likelihood ratio test; among lengths and kinds about 1 % of white noise
MAX_PLACES = 500  # a dense matrix of places
MIN_FREE = 20  # places more than functions
SHARES = np.geomspace(0.03, 30.0, 11)  # variance of the process over that of the white noise
POWERS = (1.0, 2.0)  # of the distance
LENGTH_RATIO = 2.0
WALK_LENGTHS = 4.0  # of neighbours apart, up to which shares are those of any process
OCTAVES_OF_WALKS = 2  # of lengths beyond the extent
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
    def of(
        cls, places: Floats, left: Floats, functions: Floats, *, walks: bool = False
    ) -> Process | None:
        """Return that of residuals (n, d) at places; None: they are white.

        ``functions``: of the place, which causes and placement may add, (n, k). ``walks``: whether
        a rough process may be far longer than the extent of the places: a random walk.
        """
        some = _thinned(len(places))
        places, left, functions = places[some], left[some], functions[some]
        u, k = orthonormal(functions, every=True)
        n, d = left.shape
        if n - k < MIN_FREE:
            return None
        beside = u[:, k:]
        count, along = (n - k) * d, beside.T @ left
        apart = _apart(places)
        every = []
        for power, length, shares in _kinds(places, walks=walks):
            w, v = np.linalg.eigh(beside.T @ _alike(apart, power, length) @ beside)
            size = 1.0 + shares * np.maximum(w, 0.0)[:, None]
            white = np.sum(np.sum((v.T @ along) ** 2, axis=1)[:, None] / size, axis=0) / count
            deviance = count * np.log(white) + d * np.sum(np.log(size), axis=0)
            same = np.ones(len(shares))
            every.append((deviance, power * same, length * same, white, shares * white))
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
        apart = _apart(places[some])
        mine = basis[some] * (n / len(some))
        out = np.eye(k) * float(self.weights @ (self.white + self.shared))
        for power, length in set(zip(self.powers.tolist(), self.lengths.tolist(), strict=True)):
            here = (self.powers == power) & (self.lengths == length)
            alike = _alike(apart, power, length)
            np.fill_diagonal(alike, 0.0)  # a reading with itself: all of them, above
            size = float(self.weights[here] @ self.shared[here])
            out += size * np.einsum("idk,ij,jdl->kl", mine, alike, mine, optimize=True)
        return out

    def whole(self, places: Floats) -> Floats:
        """Covariance of readings at places (n, d) with each other, (n, n), µm²."""
        apart = _apart(places)
        out = np.eye(len(places)) * float(self.weights @ self.white)
        for power, length in set(zip(self.powers.tolist(), self.lengths.tolist(), strict=True)):
            here = (self.powers == power) & (self.lengths == length)
            out += float(self.weights[here] @ self.shared[here]) * _alike(apart, power, length)
        return out

    @property
    def typical(self) -> tuple[float, float, float]:
        """Length in mm, sizes of the process and of the white noise in µm."""
        mean = (np.exp(self.weights @ np.log(x)) for x in (self.lengths, self.shared, self.white))
        length, shared, white = map(float, mean)
        return length, shared**0.5, white**0.5


def _apart(places: Floats) -> Floats:
    """Distances of places (n, d) from each other, (n, n)."""
    from scipy.spatial.distance import cdist  # takes 0.1 s to load

    return np.asarray(cdist(places, places))


def _alike(apart: Floats, power: float, length: float) -> Floats:
    """Correlation over distances."""
    return np.asarray(np.exp(-((apart / length) ** power)))


def _kinds(places: Floats, *, walks: bool) -> Iterator[tuple[float, float, Floats]]:
    """Powers and lengths to try, with the shares of each.

    A random walk has steps of one size: the longer the process, the larger.
    """
    lengths = _lengths(places)
    more = lengths[-1] * LENGTH_RATIO ** np.arange(1.0, OCTAVES_OF_WALKS + 1.0)
    rough = np.append(lengths, more) if walks else lengths
    for length in rough.tolist():
        longer = length / (WALK_LENGTHS * lengths[0]) if walks else 1.0
        yield POWERS[0], length, SHARES * max(longer, 1.0)
    for length in lengths.tolist():
        yield POWERS[1], length, SHARES


def orthonormal(columns: Floats, *, every: bool = False) -> tuple[Floats, int]:
    """Orthonormal columns of which the first span these; how many do. ``every``: of the space."""
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=every)
    return u, int(np.sum(s > DEPENDENT * s[0]))


def _thinned(n: int) -> Integers:
    """Rows that stand for n rows, evenly spaced in their order."""
    return np.unique(np.linspace(0, n - 1, min(n, MAX_PLACES)).astype(np.intp))


def _lengths(places: Floats) -> Floats:
    """Lengths to try, mm: from the distance of neighbours to the extent of all."""
    from scipy.spatial import cKDTree

    near = np.asarray(cKDTree(places).query(places, k=2)[0])[:, 1]
    shortest = float(np.median(near[near > 0])) if np.any(near > 0) else 1.0
    longest = float(np.linalg.norm(np.ptp(places, axis=0)))
    count = int(np.log(max(longest / shortest, 1.0)) / np.log(LENGTH_RATIO)) + 1
    return np.asarray(shortest * LENGTH_RATIO ** np.arange(count), dtype=np.float64)
