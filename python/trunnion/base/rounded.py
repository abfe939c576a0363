"""Machines whose readings round to those that were read.

A reading in steps says that the machine lay within half a step of it, give or take its noise. Where
errors of rounding are shared (rows of a plate that differ by less than a step round alike) a least
squares fit is off by far more than its covariance says, and machines about it round to other
readings than were read. Where they lie instead follows from the probability of each reading,

    P = Φ((u + h) / s) - Φ((u - h) / s),    u: reading less place, h: half a step, s: noise,

whose logarithm is concave in the parameters of a linear model: Newton's method finds its top. Where
the noise is small the top is a plateau with steep sides; machines are taken as normal about the
place, and as wide, as fits it best (Opper and Archambeau 2009, The variational Gaussian
approximation revisited, Neural Computation 21): the mean slope is nothing, the mean curvature their
inverse covariance. The noise, where no repeats tell it, is that of which the readings are most
probable (by Laplace's method).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog
from scipy.special import erfcx, log_ndtr

from trunnion.base.units import Floats

NOISES = (0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02)
"""Noise beside the rounding that is tried, in steps, from where the top is easily found."""
WIDER = 10.0  # times the standard errors of the fit, within which the top is sought
AVERAGED = 8  # pairs of places
OUT = 6.0  # noises beyond half a step, where nothing is read
PARTS = 1000  # of an integral
PAST = 5.0  # of ln P, below the most, from which a still smaller noise is less likely
ROUNDS = 16
FEWER = 8  # rounds, from where places of a larger noise lie
SEED = 1
MAX_STEPS = 30
MAX_HALVINGS = 20
SETTLED = 1e-6  # of ln P
NEAR = 1e-2  # of ln P, where places are not asked for
SUFFICIENT = 1e-4  # share of the rise that is promised
SAME = 1e-14  # of the largest eigenvalue of a covariance: rounding
MIN_EXPONENT = -1e-12
HAZARD = float(np.sqrt(2.0 / np.pi))
INSIDE = 0.1  # of a step over the count of readings, that machines lie inside of half a step
FAR = 0.55  # rms residual of a fit, in steps, beyond which no machine is within half a step


@dataclass(frozen=True)
class Place:
    """Where machines lie that were read so.

    Attributes
    ----------
    off:
        How much more their readings are than those of the fit, for each direction of its
        covariance, shape (n, q).
    at:
        The likeliest lengths along these, shape (q,).
    information:
        Inverse of their covariance, (q, q).
    noise:
        Standard deviation beside the rounding.
    """

    off: Floats
    at: Floats
    information: Floats
    noise: float

    def drawn(self, count: int, rng: np.random.Generator) -> Floats:
        """How readings of some such machines differ from those of the fit, shape (n, count)."""
        size, axes = np.linalg.eigh(self.information)
        own = axes / np.sqrt(size) @ rng.standard_normal((len(size), count))
        return np.asarray(self.off @ (self.at[:, None] + own))

    def some(self) -> Floats:
        """Lengths at pairs of such places, the same ones for all noises, shape (q, s)."""
        some = np.random.default_rng(SEED).standard_normal((len(self.at), AVERAGED))
        size, axes = np.linalg.eigh(self.information)
        own = axes / np.sqrt(size) @ np.concatenate([some, -some], axis=1)
        return np.asarray(self.at[:, None] + own)


def rounds_to_all(residuals: Floats, jacobian: Floats, step: Floats) -> bool:
    """Whether the readings of some machine, without any noise, round to all that were read.

    ``residuals``, ``jacobian``: of a fit, shapes (n,) and (n, p). ``step``: of each reading, above
    zero. The least that the largest residual can be is sought by linear programming. A machine just
    where readings change from one step to the next would give either, and is none of these.
    """
    off = residuals / step
    if np.sqrt(np.mean(off**2)) > FAR:
        return False
    size = np.linalg.norm(jacobian, axis=0)
    seen = size > 0
    columns = jacobian[:, seen] / size[seen] / step[:, None]
    ones, count = np.ones((len(off), 1)), columns.shape[1]
    found = linprog(
        np.append(np.zeros(count), 1.0),
        A_ub=np.block([[columns, -ones], [-columns, -ones]]),
        b_ub=np.concatenate([off, -off]),
        bounds=[(None, None)] * count + [(0, None)],
    )
    return found.fun is not None and found.fun <= 0.5 - INSIDE / len(off)


def log_probability(residuals: Floats, jacobian: Floats, step: Floats) -> float:
    """Log of the probability of what was read, at the likeliest place and noise of a machine.

    ``residuals``, ``jacobian``: of a fit, shapes (n,) and (n, p). ``step``: of each reading, above
    zero. Unlike a sum of squares it asks of each reading only whether it rounds to what was read.
    """
    left, off = _without(residuals, jacobian, step)
    at, most, every = np.zeros(off.shape[1]), -np.inf, np.ones(len(left))
    for noise in _noises(left, step, NOISES[1::2]):
        at, log, _ = _top(left, off, step / 2, noise, every, at, NEAR)
        most = max(most, log)
    return most


def gained(residuals: Floats, jacobian: Floats, more: Floats, step: Floats) -> float:
    """What ``more`` columns gain of the probability of what was read, as chi² if by chance.

    Twice ln P at the likeliest places would gain far more now and then: of a few readings near an
    edge, one column more lets all be read without noise, from hardly any place. So P is averaged
    over all places (what the normal distribution about them says, a lower bound), and the averages
    are compared as those of readings that determine places as well as readings do in the mean.
    ``more``: with those of ``jacobian``; other arguments as in :func:`log_probability`.
    """
    (few, before, noise), (many, after, _) = (
        _averaged(residuals, columns, step) for columns in (jacobian, more)
    )
    usual = _mean_curvature(noise / step) / step**2
    one, other = (float(np.linalg.slogdet(_gram(off, usual))[1]) for off in (few, many))
    return 2.0 * (after - before) + other - one


def _averaged(residuals: Floats, jacobian: Floats, step: Floats) -> tuple[Floats, float, float]:
    """Return columns, ln P over all places of the likeliest noise, and that noise."""
    left, off = _without(residuals, jacobian, step)
    noises, every, half = _noises(left, step, NOISES[1::2]), np.ones(len(left)), step / 2
    at, _, curvature = _top(left, off, half, noises[0], every, np.zeros(off.shape[1]), NEAR)
    about = WIDER**-2 * np.eye(len(at)) + _gram(off, curvature)
    place, most, likely = Place(off, at, about, noises[0]), -np.inf, 0.0
    for noise in noises:
        place = _normal(replace(place, noise=noise), left, half, every, FEWER)
        log, _, _ = _of_readings(left[:, None] - off @ place.some(), half[:, None], noise)
        mean = float(log.sum(axis=0).mean())
        mean -= float(np.linalg.slogdet(place.information)[1] - len(at)) / 2
        if mean < most - PAST:
            break
        if mean > most:
            most, likely = mean, noise
    return off, most, likely


def _mean_curvature(noise: Floats) -> Floats:
    """Fisher information of a reading on its place, the mean over all places, in 1 / step² (n,).

    The integral over all places of one reading: ∫ (dP/du)² / P du. ``noise``: in steps, (n,).
    """
    found = dict[float, float]()
    for each in np.unique(noise).tolist():
        off = np.linspace(0.0, 0.5 + OUT * each, PARTS)
        log, slope, _ = _of_readings(off, np.full(PARTS, 0.5), each)
        found[each] = 2.0 * float(np.trapezoid(np.exp(log) * slope**2, off))
    return np.array([found[each] for each in noise.tolist()])


def _gram(off: Floats, weight: Floats) -> Floats:
    """Weighted inner products of columns with each other, (q, q)."""
    return np.asarray(off.T @ (weight[:, None] * off))


def _without(residuals: Floats, jacobian: Floats, step: Floats) -> tuple[Floats, Floats]:
    """What a fit leaves, shape (n,), and its columns, each as long as a rounding error (n, p)."""
    size = np.linalg.norm(jacobian, axis=0)
    along = np.linalg.qr(jacobian[:, size > 0] / size[size > 0])[0]
    left = residuals - along @ (along.T @ residuals)
    return left, along * (float(step.max()) / np.sqrt(12))


def _noises(left: Floats, step: Floats, shares: Sequence[float]) -> list[float]:
    """Noises to try, from where the top is easily found; the scatter at most."""
    scatter, largest = float(np.sqrt(np.mean(left**2))), float(step.max())
    smaller = [share * largest for share in shares if share * largest < scatter]
    return [scatter or largest * NOISES[-1], *smaller]


def place_of(
    residuals: Floats,
    jacobian: Floats,
    covariance: Floats,
    step: Floats,
    used: Floats,
    noise: float | None,
) -> Place:
    """Find where machines lie whose readings round to those that were read.

    Parameters
    ----------
    residuals, jacobian, covariance:
        Of a fit, shapes (n,), (n, p) and (p, p).
    step:
        Of each reading, above zero, shape (n,).
    used:
        1 for readings that are used, 0 for others, shape (n,).
    noise:
        Standard deviation of a reading beside the rounding; None: as the readings say.
    """
    free = np.flatnonzero(np.diag(covariance) > 0)
    size, axes = np.linalg.eigh(covariance[np.ix_(free, free)])
    seen = size > SAME * size.max(initial=0.0)
    off = jacobian[:, free] @ (axes[:, seen] * np.sqrt(size[seen]))
    largest = float(step.max())
    tried = [share * largest for share in NOISES if noise is None or share * largest > noise]
    best = _likeliest(residuals, off, step, used, tried, noise)
    return _normal(best, residuals, step / 2, used)


def _likeliest(
    residuals: Floats,
    off: Floats,
    step: Floats,
    used: Floats,
    tried: Sequence[float],
    known: float | None,
) -> Place:
    """Likeliest place at the known noise, or at the likeliest of those that are tried.

    That is the noise of which the readings are most probable whatever the place is (Laplace's
    method). ``tried``: from where the top is easily found.
    """
    at, best, most = np.zeros(off.shape[1]), None, -np.inf
    for noise in (*tried, *([] if known is None else [known])):
        at, log, curvature = _top(residuals, off, step / 2, noise, used, at)
        information = np.eye(len(at)) + _gram(off, curvature)
        together = log - float(np.linalg.slogdet(information)[1]) / 2
        if known is not None or together > most:
            best, most = Place(off, at, information, noise), together
    assert best is not None  # some noise is tried
    return best


def _normal(
    top: Place, residuals: Floats, half: Floats, used: Floats, rounds: int = ROUNDS
) -> Place:
    """Return the normal distribution that is nearest to the places about the top."""
    off, place, ridge = top.off, top, WIDER**-2 * np.eye(len(top.at))
    for _ in range(rounds):
        off_each = residuals[:, None] - off @ place.some()
        _, slope, curvature = _of_readings(off_each, half[:, None], top.noise)
        mean = used * curvature.mean(axis=1)
        found = _gram(off, mean) + ridge
        information = (place.information + found) / 2
        rise = -(off.T @ (used * slope.mean(axis=1))) - ridge @ place.at
        at = place.at + np.linalg.solve(information, rise) / 2
        place = replace(place, at=at, information=information)
    return place


def _top(
    residuals: Floats,
    off: Floats,
    half: Floats,
    noise: float,
    used: Floats,
    at: Floats,
    settled: float = SETTLED,
) -> tuple[Floats, float, Floats]:
    """Likeliest place from a start, ln P of all readings there, and the curvature of each (n,)."""
    ridge = WIDER**-2

    def value(z: Floats) -> tuple[float, Floats, Floats]:
        log, slope, curvature = _of_readings(residuals - off @ z, half, noise)
        return float(used @ log) - ridge * float(z @ z) / 2, used * slope, used * curvature

    log, slope, curvature = value(at)
    for _ in range(MAX_STEPS):
        rise = -(off.T @ slope) - ridge * at
        step = np.linalg.solve(_gram(off, curvature) + ridge * np.eye(len(at)), rise)
        promised, share = float(rise @ step), 1.0
        if promised < settled:
            break
        for _ in range(MAX_HALVINGS):
            new = value(at + share * step)
            if new[0] >= log + SUFFICIENT * share * promised:
                break
            share /= 2
        else:
            break
        at, (log, slope, curvature) = at + share * step, new
    return at, log + ridge * float(at @ at) / 2, curvature


def _of_readings(off: Floats, half: Floats, noise: float) -> tuple[Floats, Floats, Floats]:
    """Log of P of each reading, its derivative by u, and less the second one, shapes (n,)."""
    low, high = (np.abs(off) - half) / noise, (np.abs(off) + half) / noise
    above, beyond = log_ndtr(-low), log_ndtr(-high)
    inside = -np.expm1(np.minimum(beyond - above, MIN_EXPONENT))
    # Densities over P: differences of logarithms say nothing of them far off.
    at_low = HAZARD / erfcx(low / np.sqrt(2.0)) / inside
    at_high = at_low * np.exp((low - high) * (low + high) / 2)
    slope = (at_high - at_low) / noise
    curvature = at_low * (at_low - low) + at_high * (high + at_high - 2.0 * at_low)
    return above + np.log(inside), np.sign(off) * slope, np.maximum(curvature / noise**2, 0.0)
