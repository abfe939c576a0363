"""Readings that wander: white noise beside a smooth process of no known form.

A slow error that no function of a recorded quantity makes (a drift to and fro, of its own in each
run) is no noise with a short memory: an autoregression of a few readings leaves the slow part of
it, and causes that are slow (a cyclic error of a long pitch, an offset) would be named for it. So
the noise of such readings is white noise and a smooth Gaussian process beside it, of the squared
exponential covariance (Rasmussen and Williams 2006, 4.2). Its share and its length are those of the
largest restricted likelihood; generalised least squares with this noise judge every cause by what
no such wander makes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.autoregression import Autoregression, of_covariances
from trunnion.diagnosis.scan import UNNAMED_TERM_PENALTY

ORDER = 64  # readings from which the next one is predicted
PARAMETERS = 2  # share and length
SHARES = (1.0, 30.0)  # variance of the wander over that of the white noise, to start from
MAX_LOG = 30.0  # of share and length
STEPS = 30
TINY = 1e-300


@dataclass(frozen=True)
class Kernel:
    """Form of the covariance of a process, exp(-(distance / length)^power / power).

    lengths: In readings, to start from. least: Shortest one.
    """

    power: float
    lengths: tuple[float, ...]
    least: float


#: An autoregression of as many readings says what is shorter.
SMOOTH = Kernel(2.0, (8.0, 30.0, 100.0, 300.0), 6.0)
#: A walk that goes back to its middle: an autoregression of first order.
WALK = Kernel(1.0, (3.0, 10.0, 30.0), 0.3)


@dataclass(frozen=True)
class Wander:
    """A fitted wander: its noise, and the logarithms of share and length."""

    noise: Autoregression
    place: tuple[float, float]


def fit_wander(
    y: Floats,
    q: Floats,
    segments: Sequence[Integers],
    start: tuple[float, float] | None = None,
    kernel: Kernel = SMOOTH,
) -> Wander:
    """Noise of readings y (n,) that wander, of which columns q (n, k) may be no noise.

    ``segments``: row numbers of consecutive readings; they wander independently of each other.
    ``start``: logarithms of share and length; None: the best of a grid.
    """
    both = np.concatenate([q, y[:, None]], axis=1)
    count = max(len(y) - q.shape[1], 1)

    def cost(z: Floats | tuple[float, float]) -> float:
        noise = _wandering(kernel, *z)
        d = _triangle(noise, both, segments)
        size = sum(noise.log_size(len(s)) for s in segments)
        return 2.0 * float(count * np.log(d[-1]) + np.sum(np.log(d[:-1])) + size)

    first = start or min(product(np.log(SHARES), np.log(kernel.lengths)), key=cost)
    simplex = first + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.5]])
    options: Any = {"maxfev": STEPS, "xatol": 0.1, "fatol": 0.1, "initial_simplex": simplex}
    from scipy.optimize import minimize  # takes 0.1 s to load

    share, length = minimize(cost, first, method="Nelder-Mead", options=options).x
    noise = _wandering(kernel, share, length)
    size = float(_triangle(noise, both, segments)[-1]) / count**0.5
    scaled = Autoregression(noise.predictors, tuple(size * s for s in noise.sizes))
    return Wander(scaled, (float(share), float(length)))


def deviance(noise: Autoregression, y: Floats, q: Floats, segments: Sequence[Integers]) -> float:
    """-2 ln L of readings y, beside columns q, of a noise of any size."""
    both = np.concatenate([q, y[:, None]], axis=1)
    left = float(_triangle(noise, both, segments)[-1])
    size = sum(noise.log_size(len(s)) for s in segments)
    return len(y) * float(np.log(max(left**2, TINY) / len(y))) + 2.0 * size


def penalised(noise: Autoregression, y: Floats, q: Floats, segments: Sequence[Integers]) -> float:
    """`deviance`, with what the memory of an autoregression costs (Schwarz 1978)."""
    return deviance(noise, y, q, segments) + noise.order * float(np.log(len(y)))


def innovations_beside(
    noise: Autoregression, y: Floats, q: Floats, segments: Sequence[Integers]
) -> Floats:
    """Return what a noise leaves white of readings y beside columns q, (n,) by segment."""
    both = np.concatenate([q, y[:, None]], axis=1)
    white = np.concatenate([noise.whiten(both[s]) for s in segments])
    basis = np.linalg.qr(white[:, :-1])[0]
    return np.asarray(white[:, -1] - basis @ (basis.T @ white[:, -1]))


def price_of_wander(readings: int) -> float:
    """What a wander has to gain on other noise, of -2 ln L: its parameters, and no name."""
    return PARAMETERS * float(np.log(readings)) + UNNAMED_TERM_PENALTY


def _wandering(kernel: Kernel, log_share: float, log_length: float) -> Autoregression:
    """Noise of size 1 with a wander."""
    share = np.exp(np.clip(log_share, -MAX_LOG, MAX_LOG))
    length = np.exp(np.clip(log_length, np.log(kernel.least), MAX_LOG))
    distance = np.arange(ORDER + 1) / length
    covariances = share * np.exp(-(distance**kernel.power) / kernel.power)
    covariances[0] += 1.0
    return of_covariances(covariances)


def _triangle(noise: Autoregression, both: Floats, segments: Sequence[Integers]) -> Floats:
    """Diagonal of the triangle of whitened columns: what each is beside those before it."""
    white = np.concatenate([noise.whiten(both[s]) for s in segments])
    corner = np.asarray(np.linalg.qr(white, mode="r"), dtype=np.float64)
    return np.maximum(np.abs(np.diag(corner)), TINY)
