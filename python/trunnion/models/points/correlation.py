"""Errors of no known form that neighbouring features share: how large, and over what distance.

A machine errs otherwise than its catalogue of causes says, and it errs alike at neighbouring
places. What is left beside the causes is then no white noise, and scale, squareness or a bow are
less certain than so many independent features make them: their noise is white noise beside a
Gaussian process over the places (:mod:`trunnion.diagnosis.neighbours`).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from trunnion.base.report import rough
from trunnion.base.statistics import NORMAL_MEDIAN
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis import outliers
from trunnion.diagnosis.neighbours import MIN_FREE, Process, orthonormal
from trunnion.diagnosis.whitening import Correlated

BLOCK_LENGTHS = 2.0  # of a block that is left out for cross-validation
NEIGHBOURS = 6  # the median of which foretells a place


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
    u, k = orthonormal(mine.reshape(n * d, -1))
    basis = u[:, :k]
    covariance = process.covariance(places[used], basis.reshape(n, d, -1)[used])
    length, shared, white = process.typical
    note = (
        f"What is left of neighbouring features is alike: errors of {rough(shared)} µm rms that "
        f"no cause makes are correlated over about {rough(length)} mm, beside {rough(white)} µm of "
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
    typical = np.median(off, axis=0) / NORMAL_MEDIAN
    seen = np.flatnonzero(typical > 0)
    far = [outliers.far_out(off[:, i] / typical[i], len(off)) for i in seen]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *far]))


def _blocks(places: Floats, length: float) -> Integers:
    """Block of each place: squares of twice the length, fewer than four nowhere."""
    extent = np.ptp(places, axis=0)
    count = np.maximum(extent // (BLOCK_LENGTHS * length), 1.0)
    count[np.argsort(extent)[-2:]] = np.maximum(count[np.argsort(extent)[-2:]], 2.0)
    share = (places - places.min(axis=0)) / np.where(extent > 0, extent, 1.0)
    cell = np.minimum(share * count, count - 1).astype(np.intp)
    return np.unique(cell, axis=0, return_inverse=True)[1].reshape(-1).astype(np.intp)
