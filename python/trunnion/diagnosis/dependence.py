"""Residuals that are no stationary noise: how dependent they are, and what follows from that.

Where a model is not complete, what it leaves depends on the motion, on time, on itself. An
autoregression would take such structure for noise with a memory and estimate from the rest. Two
things are taken instead (Newey and West 1987, with the bandwidth of Andrews 1991): the variance of
such readings is their long-run variance, which counts n dependent readings as n / `length`
independent ones; and standard errors come from the long-run covariance of the scores.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.likely_terms import terms_one_by_one
from trunnion.diagnosis.whitening import Whiteners

if TYPE_CHECKING:
    from trunnion.diagnosis.case import Case
    from trunnion.diagnosis.fit import Fit

BLOCK = 24  # readings, in which the size of innovations is taken
DISTURBED = 3  # blocks that have to be far larger than the middle one: a jump disturbs two
LARGER = 3.0  # in variance; of normal noise the third of 200 blocks is 1.8 times as large
MAX_SHARE = 0.1  # of a series, that the bandwidth is at most
MIN_LEVERAGE = 0.02  # of a window, from which on the fit follows it
WINDOW_STEPS = 8  # overlapping windows in the length of one
MAX_LEVERAGE = 0.9  # of a window: from there on it alone determines, and what it leaves is nothing


def changes(innovations: Floats) -> bool:
    """Whether the size of innovations (n,) changes with time, by far."""
    count = len(innovations) // BLOCK
    if count <= 2 * DISTURBED:
        return False
    start = np.array([b[0] for b in np.array_split(np.arange(len(innovations)), count)])
    size = np.diff(np.append(start, len(innovations)))
    squares = np.add.reduceat(innovations**2, start) / size
    ordered = np.sort(squares)
    return bool(ordered[-DISTURBED] > LARGER * np.median(ordered))


def bandwidth(series: Sequence[Floats]) -> int:
    """Bandwidth of a Bartlett kernel for these series, by an autoregression of first order."""
    n = sum(len(x) for x in series)
    top = sum(float(x[1:] @ x[:-1]) for x in series)
    rho = float(np.clip(top / max(sum(float(x @ x) for x in series), 1e-300), 0.0, 0.99))
    alpha = 4 * rho**2 / ((1 - rho) * (1 + rho)) ** 2
    return int(np.clip(1.1447 * (alpha * n) ** (1 / 3), 1, max(1, MAX_SHARE * n)))


def long_run(series: Sequence[Floats], width: int) -> Floats:
    """Long-run covariance of series of k scores, each (n, k): summed over readings, shape (k, k).

    A Bartlett kernel: mean over windows of ``width`` readings of the squares of their sums.
    """
    out = np.zeros((series[0].shape[1],) * 2)
    for x in series:
        edge = np.zeros((width, x.shape[1]))
        total = np.cumsum(np.concatenate([edge, x, edge]), axis=0)
        window = total[width:] - total[:-width]
        out += window.T @ window / width
    return out


def length(series: Sequence[Floats]) -> float:
    """Readings that count as one: long-run variance over variance, 1 at least."""
    width = bandwidth(series)
    variance = sum(float(x @ x) for x in series)
    return max(
        1.0, float(long_run([x[:, None] for x in series], width)[0, 0]) / max(variance, 1e-300)
    )


def growth(
    jacobian: Floats,
    white: Floats,
    covariance: Floats,
    variance: float,
    segments: Sequence[Integers],
) -> Floats:
    """How many times larger standard errors are than of independent readings, shape (p,).

    ``jacobian`` (n, p) and residuals ``white`` (n,), whitened; ``covariance``: of the parameters
    per unit of noise; ``variance``: of a reading; ``segments``: readings in a row.
    """
    root = _root(covariance)
    unit = jacobian @ root
    series = [white[s] for s in segments]
    scores = [unit[s] * white[s][:, None] for s in segments]
    meat = _left_out([unit[s] for s in segments], scores, bandwidth(series), variance)
    n, p = jacobian.shape
    sandwich = np.sum((root @ _root(meat)) ** 2, axis=1) * n / max(n - p, 1)
    usual = np.diag(covariance) * variance
    return np.asarray(np.sqrt(np.where(usual > 0, sandwich / np.where(usual > 0, usual, 1.0), 1.0)))


def growth_apart(case: Case, f: Fit, variance: float) -> Floats:
    """How many times larger standard errors are where one measurement has structure, (p + k,).

    Structure without a name, of several measurements: of each what is left has its own variance,
    and the noise of the others is no larger for it. ``variance``: of a white reading.
    """
    apart = case.whiten.apart if isinstance(case.whiten, Whiteners) else ()
    if not apart or variance <= 0:
        return np.ones(len(f.covariance))
    others = np.ones(len(case.model.readings), dtype=bool)
    for at in apart:
        others[at] = False
    place = np.arange(len(others))
    groups = [g for g in (*(place[at] for at in apart), place[others]) if len(g)]
    groups = [np.flatnonzero(np.isin(case.rows, g)) for g in groups]
    # structure competes with the causes only after these: what it explains is no noise of them
    d = case.dictionary.within(apart)
    _, left, basis = terms_one_by_one(d, f.white, f.basis, case.floor, len(apart))
    taken, least = np.sum(basis**2, axis=1), case.floor.variance
    share = np.array(
        [max(float(left[g] @ left[g]) / max(len(g) - taken[g].sum(), 1.0), least) for g in groups]
    )
    white = case.white_jacobian(f)
    moved = np.stack([np.sum((white[g] @ f.covariance) ** 2, axis=0) for g in groups])
    usual = np.sum(moved, axis=0)
    own = (share / variance) @ moved
    return np.asarray(np.sqrt(np.where(usual > 0, own / np.where(usual > 0, usual, 1.0), 1.0)))


def _root(covariance: Floats) -> Floats:
    """Symmetric square root."""
    w, u = np.linalg.eigh(covariance)
    return np.asarray((u * np.sqrt(np.maximum(w, 0.0))) @ u.T)


def _left_out(
    jacobian: Sequence[Floats], scores: Sequence[Floats], width: int, variance: float
) -> Floats:
    """As `long_run` of the scores, of fits that leave out a window that they follow.

    A fit follows the readings of a window that determines a good part of a parameter; what it
    leaves there is too small (CR3 of Bell and McCaffrey 2002, a jackknife over windows). It leaves
    nothing of what one window alone determines, such as the state at the start of a log: that has
    the ``variance`` of the readings. ``jacobian``: with columns of which the inner products are 1,
    (n, k) of each series.
    """
    step = max(1, width // WINDOW_STEPS)
    k = scores[0].shape[1]
    out = np.zeros((k, k))
    for x, own in zip(scores, jacobian, strict=True):
        start = np.arange(step - width, len(x), step)
        edges = np.clip([start, start + width], 0, len(x))
        first, last = np.cumsum(np.pad(x, ((1, 0), (0, 0))), axis=0)[edges]
        sums = last - first
        before, after = np.cumsum(np.pad(np.sum(own**2, axis=1), (1, 0)))[edges]
        for i in np.flatnonzero(after - before > MIN_LEVERAGE):
            some = own[edges[0, i] : edges[1, i]]
            w, u = np.linalg.eigh(some.T @ some)
            alone = w > MAX_LEVERAGE
            sums[i] = (u / np.where(alone, np.inf, 1.0 - w)) @ (u.T @ sums[i])
            out += (u[:, alone] * w[alone]) @ u[:, alone].T * variance * step / width
        out += sums.T @ sums * step / width
    return out
