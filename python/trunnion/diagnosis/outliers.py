"""Readings that belong to no model: a chip under the probe, a false trigger.

Heavy tails are no outliers. A reading is one only if it is too far out for the tail that the other
readings show: their noise is taken as Student's t, its degrees of freedom weighed by the
likelihood of the other readings, and the count of readings that far out is compared with what
such noise gives.
"""

import numpy as np
from scipy import special

from trunnion.base.rows import at_hand
from trunnion.base.units import Floats, Integers

OUTLIER_LEVEL = 0.01
GAP_LEVEL = 0.02
ALONE = 0.1  # readings as far out as this one that the others' noise may make, of all n
FAR = 4.0  # times the noise that the others show
CHECKED = 1e-6  # share of a reading that the others can check
MAX_SHARE = 0.2  # more than a fifth of the readings are no outliers
MAX_ASIDE = 200  # readings that are set aside one by one: each is a pass through all

# Degrees of freedom of the noise, evenly spread in 1/ν from normal to tails as heavy as ν = 2.5.
_NU = 1.0 / np.linspace(1e-3, 0.4, 12)
_MAD = special.stdtrit(_NU, 0.75)  # median absolute deviation of each, per unit scale
_NORM = special.gammaln((_NU + 1) / 2) - special.gammaln(_NU / 2) - 0.5 * np.log(_NU * np.pi)


def robust_residuals(basis: Floats, values: Floats, floor: float = 0.0) -> Floats:
    """Residuals, per leverage, of a fit that a few readings cannot bend, shape (n,).

    Least absolute deviations by reweighting, then Tukey's bisquare (c = 4.685) from there with the
    scale held at the median absolute deviation. ``basis``: orthonormal; ``floor``: least scale.
    """
    n, p = basis.shape

    def fit(weights: Floats) -> Floats:
        gram, right = np.zeros((p, p)), np.zeros(p)
        for some in at_hand(n):
            heavy = (basis[some] * weights[some, None]).T
            gram += heavy @ basis[some]
            right += heavy @ values[some]
        solution = np.linalg.lstsq(gram, right, rcond=None)[0]
        return np.asarray(values - basis @ solution)

    r = fit(np.ones(n))
    for _ in range(25):
        scale = max(np.median(np.abs(r)) / 0.6745, floor)
        if scale <= 0:
            break
        r_new = fit(1.0 / np.maximum(np.abs(r), 0.05 * scale))
        done = np.max(np.abs(r_new - r)) < 0.02 * scale
        r = r_new
        if done:
            break
    # p of the n absolute residuals vanish in this fit
    scale = max(np.median(np.sort(np.abs(r))[p:]) / 0.6745, floor)
    for _ in range(10):
        if scale <= 0:
            return r
        u = r / (4.685 * scale)
        r_new = fit(np.where(np.abs(u) < 1, (1 - u * u) ** 2, 1e-9))
        done = np.max(np.abs(r_new - r)) < 0.02 * scale
        r = r_new
        if done:
            break
    return r


def far_out(
    r: Floats, leverage: Floats, floor: float = 0.0, level: float = OUTLIER_LEVEL
) -> Integers:
    """Find readings that are too far out for the noise of the others (indices).

    ``r``: residuals of a robust fit, shape (n,); ``leverage``: diagonal of the hat matrix of the
    fit, by which residuals of ordinary readings are shrunk; ``floor``: least noise of a reading.
    """
    n = len(r)
    dof = n - float(leverage.sum())
    size = np.abs(r) / np.sqrt(np.maximum(1.0 - leverage, 0.05))
    order = np.argsort(-size)
    ordered = size[order]
    most = min(int(MAX_SHARE * n), n - 5)
    tried = max(most, 1)
    for k in range(most, 0, -1):
        x = ordered[k - 1]
        # The tail itself leaves gaps: those of a tail of index 3 are exponential on a log scale
        # (Rényi), and readings of one kind end without one.
        if x <= 0 or (ordered[k] / x) ** (3.0 * k) > GAP_LEVEL:
            continue
        others = ordered[k:]
        mad = 0.5 * (others[(len(others) - 1) // 2] + others[len(others) // 2])  # they are in order
        mad = max(mad, 0.6745 * floor)
        if mad <= 0 or x < 3.5 * mad / 0.6745:
            continue
        scale = mad / _MAD
        t = others[:, None] / scale
        bulk = (
            len(others) * (_NORM - np.log(scale))
            - ((_NU + 1) / 2 * np.log1p(t * t / _NU)).sum(axis=0)
        ) * (dof / n)
        # For the group: without outliers k readings of the same noise lie beyond the others, which
        # speaks for heavy tails. For each alone: the noise that the others show.
        beyond = (
            k * np.log(np.maximum(2 * special.stdtr(_NU, -others[0] / scale), 1e-300)) * (dof / n)
        )
        tail = 2 * special.stdtr(_NU, -x / scale)
        chance = _weights(bulk + beyond) @ special.bdtrc(k - 1, n, tail)
        if chance < level / tried:
            alone = 2 * special.stdtr(_NU, -ordered[:k, None] / scale) @ _weights(bulk)
            return np.sort(order[:k][n * alone < ALONE])
    return np.zeros(0, dtype=np.intp)


def one_by_one(design: Floats, values: Floats, floor: float = 0.0) -> Integers:
    """Set aside, each time, the reading that the others miss most (indices, MAX_ASIDE at most).

    Baarda's data snooping, then back: a reading stays aside only if those set aside with it do not
    make it ordinary. Residuals are taken per leverage, so that a reading which the fit follows is
    found before those that it bends; a robust fit may take it for a good one. ``design`` is
    orthonormal, shape (n, p), and ``values`` orthogonal to it; ``floor``: least noise of a reading.
    """
    n = len(values)
    shifts = np.zeros((n, 0))  # orthonormal, what the readings set aside may change
    r = values
    free = 1.0 - np.einsum("ij,ij->i", design, design)
    left = np.ones(n, dtype=bool)
    aside: list[int] = []
    for _ in range(min(int(MAX_SHARE * n), n - design.shape[1] - 5, MAX_ASIDE)):
        size = np.abs(r) / np.sqrt(np.maximum(free, CHECKED))
        size[free < CHECKED] = 0.0
        i = int(np.argmax(size))
        if size[i] < FAR * max(np.median(size[left]) / 0.6745, floor):
            break
        aside.append(i)
        left[i] = False
        column = -design @ design[i] - shifts @ shifts[i]
        column[i] += 1.0
        unit = column / np.sqrt(column[i])
        shifts = np.column_stack([shifts, unit])
        r = r - unit * (unit @ r)
        free = free - unit * unit
    sigma = max(np.sqrt(r @ r / max(n - design.shape[1] - len(aside), 1)), floor)
    while aside:
        bent = -design @ design[aside].T
        bent[aside, np.arange(len(aside))] += 1.0
        shifts, moments = np.linalg.qr(bent)
        inverse = np.linalg.inv(moments)
        found = np.abs(inverse @ (shifts.T @ values)) / np.linalg.norm(inverse, axis=1)
        least = int(np.argmin(found))
        if found[least] > FAR * sigma:
            break
        del aside[least]
    return np.sort(np.asarray(aside, dtype=np.intp))


def _weights(log_likelihood: Floats) -> Floats:
    w = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(w / w.sum())


def outlier_penalty(n: int, level: float = OUTLIER_LEVEL) -> float:
    """Penalty of taking one of n readings out, on the scale of the penalties of causes."""
    return float(special.chdtri(1, level / n))
