"""Machines whose readings round to those that were read.

A reading in steps says that the machine lay within half a step of it, give or take its noise. Where
errors of rounding are shared (rows of a plate that differ by less than a step round alike) a least
squares fit is off by far more than its covariance says, and machines about it round to other
readings than were read. Where they lie instead follows from the probability of each reading,

    P = Φ((u + h) / s) - Φ((u - h) / s),    u: reading less place, h: half a step, s: noise,

whose logarithm is concave in the parameters of a linear model: Newton's method finds its top. Mean
and covariance of all places, and the probability of the readings over all of them, are found by
expectation propagation (Minka 2001): a normal distribution takes the place of each P, so that with
those of all others it has the mean and the variance that P has. P of a normal distribution of
places is one of a larger noise, so all of it is in closed form. Readings that repeat each other say
no more than one does where there is no noise; P of several is then one with a nearer edge. Every
noise counts by how probable it makes the readings, and before them each as Jeffreys says: evenly in
√s. A reading tells of ln s only where the machine is near an edge, so that its information is 2.2 s
per step (its root within 4 % up to half a step). Where the machine is to be found as well, n
readings tell less of a noise below 10/n steps: a quarter of that at 3/n, hardly anything at 1/n
(532 touches, 14 parameters). Counted by that, such noises would count less still, and intervals of
readings without noise, which hold more than 95 % as it is, would be 5 % wider. Standard errors,
which expectation propagation gets wrong by up to a tenth, are those of machines that are drawn
(:mod:`.read_alike`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import erfcx, log_ndtr

from trunnion.base.read_alike import drawn_covariance
from trunnion.base.rows import equal_rows
from trunnion.base.statistics import factor_of
from trunnion.base.units import Flags, Floats

NOISES = tuple((0.5 * 0.6 ** np.arange(15)).tolist())
"""Noise beside the rounding that is tried, in steps."""
NOISES_OF_SETS = (0.4, 0.2, 0.1, 0.05, 0.02)
"""The same for likeliest places: with less, one column more of hundreds of touches lets all be read
without noise now and then, from hardly any place."""
WIDER = 10.0  # times the standard errors of the fit, within which machines are sought
OUT = 6.0  # noises beyond half a step, where nothing is read
MAX_DRAWN = 1000  # readings up to which machines are drawn
PARTS = 1000  # of an integral
HALVED = 3  # times, spaces between noises about the likeliest
NEAR = 0.5  # of ln P, within which noises are near enough
BENT = 2.0  # of ln P, within which it is a parabola between noises
PAST = 5.0  # of ln P, below the most, from which a still smaller noise is less likely
ROUNDS = 40
SHARE = 0.7  # of a change of normal distributions that is made in a round
MOVED = 1e-3  # of the variance of a place: no change
MAX_STEPS = 30
MAX_HALVINGS = 20
SETTLED = 1e-2  # of ln P
SUFFICIENT = 1e-4  # share of the rise that is promised
SAME = 1e-14  # of the largest eigenvalue of a covariance: rounding
SAME_READING = 1e-6  # of a step, and of the largest derivative
MIN_EXPONENT = -1e-12
MIN_SHARE = 1e-10  # of a variance that one reading leaves of it
HAZARD = float(np.sqrt(2.0 / np.pi))
INSIDE = 0.1  # of a step over the count of readings, that machines lie inside of half a step
FAR = 0.55  # rms residual of a fit, in steps, beyond which no machine is within half a step


@dataclass(frozen=True, eq=False)
class Place:
    """Where machines lie that were read so.

    Attributes
    ----------
    along:
        Directions of the covariance of the fit, each as long as a standard error, shape (p, q).
    off:
        How much more the readings of a machine there are than those of the fit, (n, q).
    left, half, used:
        What the fit leaves of each reading, half its step, and whether it is used, shape (n,).
    noises, likely:
        Standard deviations beside the rounding and how probable each is, shape (k,), sum 1.
    at, normal:
        Mean of the lengths along these, shape (q,), and the covariance of the normal distribution
        that is nearest, (q, q).
    """

    along: Floats
    off: Floats
    left: Floats
    half: Floats
    used: Flags
    noises: Floats
    likely: Floats
    at: Floats
    normal: Floats

    @property
    def noise(self) -> float:
        """Standard deviation beside the rounding in the middle of all."""
        return float(np.exp(self.likely @ np.log(self.noises)))

    @cached_property
    def covariance(self) -> Floats:
        """Mean products of lengths along these, less their mean, of machines drawn, (q, q).

        Those of the normal distribution where the mean leaves a reading further beyond its step
        than any noise reaches, as no machine is near such readings, and for many readings, for
        which it is as good and machines that are drawn one after the other move slowly.
        """
        used, root = self.used, factor_of(self.normal)
        left, off = self.left[used] - self.off[used] @ self.at, self.off[used] @ root
        half = self.half[used]
        if len(left) > MAX_DRAWN or np.any(np.abs(left) - half > OUT * self.noises.max()):
            return self.normal
        own = drawn_covariance(left, off, half, self.noises, self.likely)
        return np.asarray(root @ own @ root.T)

    def drawn(self, count: int, rng: np.random.Generator) -> Floats:
        """How readings of some machines differ from those of the fit, shape (n, count).

        Machines of the normal distribution, not those whose covariance is that above.
        """
        root = factor_of(self.normal)
        own = root @ rng.standard_normal((len(root), count))
        return np.asarray(self.off @ (self.at[:, None] + own))


@dataclass(frozen=True)
class _Readings:
    """Different readings that are used.

    What a fit leaves of each, shape (m,), their columns (m, q), half their steps, (m,), and how
    often each was read, (m,).
    """

    left: Floats
    off: Floats
    half: Floats
    times: Floats

    @classmethod
    def of(cls, left: Floats, off: Floats, step: Floats) -> "_Readings":
        """Take readings of the same step that are equal, and depend alike on everything, once."""
        size = np.abs(off).max(axis=0, initial=0.0)
        rows = np.round(off / np.where(size > 0, size, 1.0) / SAME_READING)
        label, first = equal_rows([*rows.T, np.round(left / step / SAME_READING), step])
        return cls(left[first], off[first], step[first] / 2, np.bincount(label).astype(np.float64))


@dataclass(frozen=True)
class _Places:
    """Normal distribution of places at a noise, and ln P of all readings over all places.

    tilt, weight: Of the normal distribution that takes the place of each P, (m,).
    """

    mean: Floats
    covariance: Floats
    log: float
    noise: float
    tilt: Floats
    weight: Floats


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
    from scipy.optimize import linprog  # takes 0.1 s to load

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
    readings = _Readings.of(left, off, step)
    at, most = np.zeros(off.shape[1]), -np.inf
    for noise in _noises(left, step, NOISES_OF_SETS):
        at, log = _top(readings, noise, at)
        most = max(most, log)
    return most


def log_of(residuals: Floats, step: Floats, noise: float) -> float:
    """Log of the probability of what was read of one machine; its residuals and steps, (n,)."""
    return float(_of_readings(residuals, step / 2, noise)[0].sum())


def gained(residuals: Floats, jacobian: Floats, more: Floats, step: Floats) -> float:
    """What ``more`` columns gain of the probability of what was read, as chi² if by chance.

    Twice ln P at the likeliest places would gain far more now and then: of a few readings near an
    edge, one column more lets all be read without noise, from hardly any place. So P is averaged
    over all places, and the averages are compared as those of readings that determine places as
    well as these do in the mean.
    ``more``: with those of ``jacobian``; other arguments as in :func:`log_probability`.
    """
    (few, before), (many, after) = (
        _over_all(residuals, columns, step) for columns in (jacobian, more)
    )
    likeliest = max(before, key=lambda places: places.log)
    usual = float(np.mean(likeliest.weight * step.max() ** 2))
    one, other = (float(np.linalg.slogdet(usual * off.T @ off)[1]) for off in (few, many))
    return 2.0 * (_most(after) - _most(before)) + other - one


def _over_all(residuals: Floats, jacobian: Floats, step: Floats) -> tuple[Floats, "list[_Places]"]:
    """Return columns, and places at noises about that at which what was read is likeliest."""
    left, off = _without(residuals, jacobian, step)
    readings = _Readings.of(left, off, step)
    return off, _at_noises(readings, _noises(left, step, NOISES))


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
    return [scatter or largest * shares[-1], *smaller]


def place_of(
    residuals: Floats,
    jacobian: Floats,
    covariance: Floats,
    step: Floats,
    used: Floats,
    noise: float | None = None,
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
        Standard deviation of a reading beside the rounding; None: each by how probable it makes the
        readings.
    """
    free = np.flatnonzero(np.diag(covariance) > 0)
    size, axes = np.linalg.eigh(covariance[np.ix_(free, free)])
    seen = size > SAME * size.max(initial=0.0)
    along = np.zeros((len(covariance), int(seen.sum())))
    along[free] = axes[:, seen] * np.sqrt(size[seen])
    off, rows, largest = jacobian @ along, used > 0, float(step.max())
    readings = _Readings.of(residuals[rows], off[rows], step[rows])
    tried = [share * largest for share in NOISES] if noise is None else [noise]
    found = _at_noises(readings, tried)
    noises = np.array([places.noise for places in found])
    most = max(places.log for places in found)
    weight = np.exp([places.log - most for places in found])
    if len(found) > 1:
        weight *= _shares(noises)
    weight /= weight.sum()
    at = np.asarray(weight @ [places.mean for places in found])
    every = [places.covariance + np.outer(d, d) for places in found for d in (places.mean - at,)]
    normal = np.asarray(np.tensordot(weight, every, 1))
    return Place(along, off, residuals, step / 2, rows, noises, weight, at, normal)


def _shares(noises: Floats) -> Floats:
    """Shares of noises, the largest first, of all that there are: evenly in their root, (k,).

    Each stands for those to the middle between it and the next, the smallest for all below it.
    """
    root = np.sqrt(noises)
    middles = (root[1:] + root[:-1]) / 2
    return -np.diff([2.0 * root[0] - middles[0], *middles, 0.0])


def _at_noises(readings: _Readings, noises: Sequence[float]) -> list[_Places]:
    """Places at each noise, from the largest on, as long as a smaller one may be likelier.

    And at some about the likeliest, where the probability changes much to its neighbours.
    """
    found = list[_Places]()
    for noise in noises:
        found.append(_places(readings, noise, found[-1] if found else None))
        if found[-1].log < max(one.log for one in found) - PAST:
            break
    for _ in range(HALVED):
        i = max(range(len(found)), key=lambda i: found[i].log)
        best, about = found[i], (found[k] for k in (i - 1, i + 1) if 0 <= k < len(found))
        between = [one for one in about if best.log - one.log > NEAR]
        middles = [float(np.sqrt(best.noise * one.noise)) for one in between]
        found += [_places(readings, noise, best) for noise in middles]
        found.sort(key=lambda one: -one.noise)
    return found


def _most(found: Sequence[_Places]) -> float:
    """Largest ln P, between noises as a parabola through three says."""
    i = max(range(len(found)), key=lambda i: found[i].log)
    three = found[max(i - 1, 0) : i + 2]
    if len(three) < 3 or min(one.log for one in three) < found[i].log - BENT:
        return found[i].log
    (x, y), (u, v) = (
        (float(np.log(one.noise / found[i].noise)), one.log - found[i].log)
        for one in (three[0], three[2])
    )
    bent = (y / x - v / u) / (x - u)
    slope = y / x - bent * x
    return found[i].log - (slope**2 / (4.0 * bent) if bent < 0 else 0.0)


def _places(readings: _Readings, noise: float, near: _Places | None) -> _Places:
    """Places at a noise, by expectation propagation; ``near``: those of a noise nearby.

    ln P over all of them is less ln(2π) / 2 a direction, as a top's and its curvature's would be.
    """
    left, off = readings.left, readings.off
    tilt = weight = np.zeros(len(left))
    if near is not None:
        tilt, weight = near.tilt, near.weight
    half, noises = _together(readings, noise)
    ridge = WIDER**-2 * np.eye(off.shape[1])
    for _ in range(ROUNDS):
        covariance = np.asarray(np.linalg.inv(ridge + _gram(off, weight)), dtype=np.float64)
        mean = covariance @ (off.T @ tilt)
        place, variance = off @ mean, np.sum((off @ covariance) * off, axis=1)
        rest = np.maximum(1.0 - weight * variance, MIN_SHARE)
        wide, about = variance / rest, (place - tilt * variance) / rest
        log, slope, curvature = _of_readings(left - about, half, np.sqrt(noises**2 + wide))
        own = np.maximum(1.0 - wide * curvature, MIN_SHARE)
        further = SHARE * ((curvature * about - slope) / own - tilt)
        more = SHARE * (curvature / own - weight)
        if np.max(np.abs(more) * variance, initial=0.0) < MOVED:
            break
        tilt, weight = tilt + further, weight + more
    log += np.log1p(weight * wide) / 2 - variance * tilt**2 / 2
    log -= rest * (2.0 * about * tilt - weight * about**2) / 2
    size = float(np.linalg.slogdet(covariance)[1])
    total = float(log.sum()) + (size + float(tilt @ place)) / 2
    return _Places(mean, covariance, total, noise, tilt, weight)


def _together(readings: _Readings, noise: float) -> tuple[Floats, Floats]:
    """Half the step and the noise that one reading would have that says what its repeats do (m,).

    The product of their P has the integral and the variance of such a one.
    """
    half, noises = readings.half.copy(), np.full(len(readings.half), noise)
    for times, step in {
        (t, h) for t, h in zip(readings.times.tolist(), half.tolist(), strict=True)
    }:
        if times == 1.0:
            continue
        off = np.linspace(0.0, step + OUT * noise, PARTS)
        of_all = np.exp(times * _of_readings(off, np.full(PARTS, step), noise)[0])
        area = float(np.trapezoid(of_all, off))
        variance = float(np.trapezoid(off**2 * of_all, off)) / area - area**2 / 3
        alike = (readings.times == times) & (readings.half == step)
        half[alike], noises[alike] = area, np.sqrt(max(variance, (noise / times) ** 2))
    return half, noises


def _top(readings: _Readings, noise: float, at: Floats) -> tuple[Floats, float]:
    """Likeliest place from a start, and ln P of all readings there."""
    ridge, off, times = WIDER**-2, readings.off, readings.times

    def value(z: Floats) -> tuple[float, Floats, Floats]:
        log, slope, curvature = _of_readings(readings.left - off @ z, readings.half, noise)
        return float(times @ log) - ridge * float(z @ z) / 2, times * slope, times * curvature

    log, slope, curvature = value(at)
    for _ in range(MAX_STEPS):
        rise = -(off.T @ slope) - ridge * at
        step = np.linalg.solve(_gram(off, curvature) + ridge * np.eye(len(at)), rise)
        promised, share = float(rise @ step), 1.0
        if promised < SETTLED:
            break
        for _ in range(MAX_HALVINGS):
            new = value(at + share * step)
            if new[0] >= log + SUFFICIENT * share * promised:
                break
            share /= 2
        else:
            break
        at, (log, slope, curvature) = at + share * step, new
    return at, log + ridge * float(at @ at) / 2


def _of_readings(off: Floats, half: Floats, noise: Floats | float) -> tuple[Floats, Floats, Floats]:
    """Log of P of each reading, its derivative by u, and less the second one, shapes (n,)."""
    low, high = (np.abs(off) - half) / noise, (np.abs(off) + half) / noise
    above, beyond = log_ndtr(-low), log_ndtr(-high)
    inside = -np.expm1(np.minimum(beyond - above, MIN_EXPONENT))
    # Densities over P: differences of logarithms say nothing of them far off.
    at_low = HAZARD / erfcx(low / np.sqrt(2.0)) / inside
    at_high = at_low * np.exp((low - high) * (low + high) / 2)
    slope = (at_high - at_low) / noise
    curvature = at_low * (at_low - low) + at_high * (high + at_high - 2.0 * at_low)
    return above + np.log(inside), np.sign(off) * slope, np.clip(curvature, 0.0, 1.0) / noise**2
