"""Readings that are recorded in steps: a control's tick, the resolution of a scale, a display.

A reading in steps of t has an error of rounding between -t/2 and t/2 beside its noise: variance
t²/12 (GUM, F.2.2.1). Three things follow.

- The noise of a reading is never below t/√12, however well some model fits. A model with enough
  parameters always finds readings on one grid that it fits exactly.
- Errors of rounding are a function of where the machine is, not noise: readings that differ by a
  part of a step round alike. What that does to a machine like the fitted one is simulated
  (:meth:`Grid.draws`), and each candidate is judged against it.
- Repeats of one reading on one grid have the same error of rounding as long as their noise is small
  beside the step: they are no independent readings. With noise of standard deviation s their errors
  of rounding correlate by (6/π²) Σ exp(-4π²k²s²/t²) / k², from the Fourier series of the sawtooth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trunnion.base.rows import equal_rows
from trunnion.base.rows import where as where_true
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats, Integers

MIN_NOISE_STEPS = 0.02  # noise of a reading, in steps, that is taken as there
MAX_NOISE_STEPS = 1.0  # from here on errors of rounding are noise like any other
ANY_PLACE = 1.0  # steps: machines that differ as much lie anywhere between two steps
MAX_SIMULATED_STEPS = 0.5  # noise, in steps, from which rounding is as good as random
MAX_DRAWS = 128
MIN_DRAWS = 16
MAX_DRAWN = 1 << 22  # numbers that are drawn
SEED = 1
SAME_PHASE_STEPS = 0.02
SAME_ROW = 1e-3  # of the largest derivative: the same line of approach
OFF_EDGE = 0.3141  # so that round numbers do not lie where two cells meet
MAX_ROUNDING = 1e-13  # of the largest reading: rounding of numbers
MIN_STEP = 1e-8  # µm, arcsec: what computers make of coordinates of metres
MAX_PARTS = 5  # steps between the nearest readings
SAME_STEP = 0.02
MAX_STEP_SIGMAS = 100.0  # of steps that are recognised; a fit takes much of what rounding leaves
MIN_EXACT = 8  # distinct readings that a step is recognised in although they fit far better
SMALLEST = 1e-3  # µm, arcsec: steps below this are digits that no instrument resolves
COARSER = 1.5  # times a stated step, that a recognised one is to be taken instead
MIN_REPEATS = 5  # degrees of freedom from which repeats tell the noise
TINY = 1e-300

_STEPS = np.linspace(0.0, MAX_NOISE_STEPS, 401)
_ORDERS = np.arange(1, 200)[:, None]
_CORRELATION = (6 / np.pi**2) * np.sum(
    np.exp(-4 * np.pi**2 * _ORDERS**2 * _STEPS**2) / _ORDERS**2, axis=0
)
_PURE = _STEPS**2 + (1 - np.minimum(_CORRELATION, 1.0)) / 12


@dataclass(frozen=True)
class Floor:
    """Least variance of the noise of a whitened reading; 0: none is known."""

    variance: float = 0.0

    def deviance(self, rss: Floats | float, dof: int) -> Floats:
        """-2 ln L of a sum of squares, up to a constant, over all variances from the floor up."""
        least = dof * self.variance
        rss = np.asarray(rss, dtype=np.float64)
        value = dof * np.log(np.maximum(rss, max(least, TINY)))
        if self.variance > 0:
            value = value + np.minimum(rss - least, 0.0) / self.variance
        return np.asarray(value)

    def noise(self, rss: Floats | float, dof: int | Integers) -> Floats:
        """Return the variance that a sum of squares shows, or the floor."""
        return np.maximum(np.asarray(rss) / np.maximum(dof, 1), self.variance)


NO_FLOOR = Floor()


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Coordinates of which each may be recorded in steps, where a reading is a sum of them.

    Attributes
    ----------
    places:
        In the unit of the readings, shape (n, k).
    parts:
        Of each coordinate in the reading, that of the squares adds up to 1, shape (n, k).
    """

    places: Floats
    parts: Floats

    def on(self, step: Floats, readings: Sequence[Floats]) -> bool:
        """Whether these lie on a grid of that step, and the readings by themselves on none."""
        least = float(step.min())
        return (
            0 < least == step.max()
            and _on_grid(self.places, least)
            and not any(_on_grid(own, least) for own in readings)
        )


@dataclass(frozen=True, eq=False)
class Grid:
    """The steps of readings, and which of them share their error of rounding.

    Attributes
    ----------
    step:
        Of each reading, in its unit; 0: none. Shape (n,).
    label:
        Equal for repeats on one grid, -1 for the others, shape (n,).
    parts:
        Of coordinates that are rounded, each by itself, in each reading, shape (n, k); None: the
        reading is rounded.
    """

    step: Floats
    label: Integers
    parts: Floats | None = None

    @classmethod
    def of(
        cls,
        values: Floats,
        step: Floats,
        jacobian: Floats,
        groups: Integers,
        recorded: Sequence[Floats] = (),
        coordinates: Coordinates | None = None,
    ) -> "Grid":
        """Find the repeats: readings on one grid and of one group that depend alike on everything.

        Parameters
        ----------
        values, step, groups:
            Of each reading, shape (n,).
        jacobian:
            Derivative of the readings, shape (n, p).
        recorded, coordinates:
            What may lie on the steps beside the readings.
        """
        size = np.abs(jacobian).max(axis=0)
        rows = np.floor(jacobian / np.where(size > 0, size * SAME_ROW, 1.0) + OFF_EDGE)
        label, first = equal_rows([*rows.T, step, groups])
        places, parts = values[:, None], None
        if coordinates is not None and coordinates.on(step, (values, *recorded)):
            places, parts = coordinates.places, coordinates.parts
        off = (places - places[first][label]) / np.where(step > 0, step, np.inf)[:, None]
        alike = np.all(np.abs(off - np.round(off)) < SAME_PHASE_STEPS, axis=1) & (step > 0)
        return cls(step, _several(np.where(alike, label, -1)), parts)

    def correlation(self, steps: Floats) -> Floats:
        """Correlation of the errors of rounding of repeats with so much noise, in steps (n,)."""
        parts = np.ones((len(self.step), 1)) if self.parts is None else np.abs(self.parts)
        own = np.interp(parts * steps[:, None], _STEPS, _CORRELATION, right=0.0)
        return np.asarray(np.sum(parts**2 * own, axis=1))

    @property
    def rounding(self) -> float:
        """Mean variance of the errors of rounding."""
        return float(np.mean(self.step**2)) / 12

    def without(self, bad: Integers) -> "Grid":
        """Return the grid when these readings are left out: they repeat no other."""
        label = self.label.copy()
        label[bad] = -1
        return replace(self, label=_several(label))

    def noise(self, residuals: Floats, dof: int) -> float:
        """Estimate the noise beside the rounding (standard deviation), from repeats if there are.

        ``residuals``: of all readings, not whitened, shape (n,).
        """
        step = float(np.sqrt(np.mean(self.step**2)))
        index, count = _groups(self.label)
        r = residuals[self.label >= 0]
        mean = np.bincount(index, r) / count if len(count) else np.zeros(0)
        freedom = len(r) - len(count)
        if freedom >= MIN_REPEATS:
            pure = float(np.sum((r - mean[index]) ** 2)) / freedom / step**2
            scatter = self._scatter_of_repeats()
            if pure < scatter[-1]:
                return step * float(np.interp(pure, scatter, _STEPS))
            return step * float(np.sqrt(pure - 1 / 12))
        total = float(residuals @ residuals) / max(dof, 1)
        return float(np.sqrt(max(total - step**2 / 12, 0.0)))

    def errors(self, noise: float) -> "Repeats | None":
        """Errors of readings with this noise beside the rounding.

        None: they are white and of one size.
        """
        largest = float(self.step.max())
        if noise >= MAX_NOISE_STEPS * largest and np.all(self.step == largest):
            return None
        noise = max(noise, MIN_NOISE_STEPS * largest)
        rounding = self.step**2 / 12
        steps = noise / np.where(self.step > 0, self.step, noise)
        correlation = self.correlation(steps)
        if not np.any(self.label >= 0) and np.all(rounding == rounding[0]):
            return None
        total = noise**2 + self.rounding
        shared = rounding * correlation / total
        return Repeats((noise**2 + rounding) / total, shared, self.label)

    def _scatter_of_repeats(self) -> Floats:
        """Variance of repeats for each noise of `_STEPS`, in squares of steps."""
        if self.parts is None:
            return np.asarray(_PURE)
        alike = np.unique(np.round(np.abs(self.parts[self.label >= 0]), 2), axis=0)
        own = np.interp(alike * _STEPS[:, None, None], _STEPS, _CORRELATION, right=0.0)
        shared = np.minimum(np.sum(alike**2 * own, axis=2).mean(axis=1), 1.0)
        return np.asarray(_STEPS**2 + (1 - shared) / 12)

    def matters(self, noise: float) -> bool:
        """Whether the steps are so large beside the noise that rounding is not random."""
        return noise < MAX_SIMULATED_STEPS * float(self.step.max())

    def draws(
        self,
        values: Floats,
        residuals: Floats,
        jacobian: Floats,
        covariance: Floats,
        noise: float,
        spread: float = 0.0,
    ) -> Floats | None:
        """Errors of rounding and noise of machines like a fitted one, all readings, shape (n, s).

        None where the noise is large beside the steps. The machine is drawn from the fit's
        covariance; each of its readings is the step next to what it would be. ``spread``: the
        readings of these machines differ by as many steps at least (rms); 0: as the fit says.
        """
        if not self.matters(noise):
            return None
        largest = float(self.step.max())
        count = int(np.clip(MAX_DRAWN // len(values), MIN_DRAWS, MAX_DRAWS))
        rng = np.random.default_rng(SEED)
        free = np.flatnonzero(np.diag(covariance) > 0)
        size, axes = np.linalg.eigh(covariance[np.ix_(free, free)])
        root = axes * np.sqrt(np.maximum(size, 0.0))
        off = jacobian[:, free] @ (root @ rng.standard_normal((len(free), count)))
        off *= max(1.0, spread * largest / max(float(np.sqrt(np.mean(off**2))), TINY))
        where = (values - residuals)[:, None] + off
        noisy = where + max(noise, MIN_NOISE_STEPS * largest) * rng.standard_normal(where.shape)
        step = np.where(self.step > 0, self.step, 1.0)[:, None]
        steps, rounded = (noisy - values[:, None]) / step, np.zeros(noisy.shape)
        for part in (np.ones(len(values)),) if self.parts is None else self.parts.T:
            rounded += part[:, None] * np.round(part[:, None] * steps)
        off = np.where(self.step[:, None] > 0, values[:, None] + step * rounded, noisy) - where
        return np.asarray(off)


def recognised(values: Floats) -> float:
    """Return the largest step whose multiples readings differ by; 0: none.

    Such a step is the tick of a control, the resolution of an instrument, or the digits of a file.
    """
    distinct = np.unique(values)
    gaps = np.diff(distinct)
    rounding = max(MAX_ROUNDING * float(np.abs(distinct).max(initial=0.0)), MIN_STEP)
    gaps = gaps[gaps > rounding]
    if not len(gaps):
        return 0.0
    off = distinct - distinct[0]
    for step in float(gaps.min()) / np.arange(1, MAX_PARTS + 1):
        if step > rounding and np.all(np.abs(off - step * np.round(off / step)) < SAME_STEP * step):
            return float(step)
    digits = 10.0 ** np.floor(np.log10(float(gaps.min())))
    while digits > rounding:
        count = np.round(off / digits)
        if np.all(np.abs(off - digits * count) < SAME_STEP * digits):
            return float(digits * np.gcd.reduce(count.astype(np.int64)))
        digits /= 10
    return 0.0


def _on_grid(values: Floats, step: float) -> bool:
    """Whether values differ by multiples of a step."""
    off = (values - values[:1]) / step
    return bool(np.all(np.abs(off - np.round(off)) < SAME_STEP))


def unstated(
    recorded: Sequence[Floats], stated: float, sigma: float, off: Callable[[], Floats]
) -> float:
    """Coarsest step that is recognised in what was recorded, above the stated one; 0: none.

    Places of a plan lie on a regular grid, too: a step far above the standard deviation of the
    readings is one only where none is stated, and they differ from what a machine without errors
    gives (``off``).
    """
    for step, values in sorted(((recognised(v), v) for v in recorded), key=_first, reverse=True):
        if step <= COARSER * stated:
            break
        if step <= MAX_STEP_SIGMAS * sigma:
            return step
        many = stated == 0 and step >= SMALLEST and len(np.unique(values)) >= MIN_EXACT
        if many and np.any(np.abs(off()) > SAME_STEP * step):
            return step
    return 0.0


def _first(pair: tuple[float, Floats]) -> float:
    return pair[0]


class Repeats:
    """Errors of readings of which repeats share a part; called, it makes them white.

    White readings keep the size of the readings.

    Parameters
    ----------
    variance, shared:
        Variance of each reading, and its covariance with its repeats, shape (n,).
    label:
        Equal for repeats, -1 for the others, shape (n,).
    """

    def __init__(self, variance: Floats, shared: Floats, label: Integers) -> None:
        self.variance, self.shared = variance, shared
        self._repeated = label >= 0
        self.rows = np.flatnonzero(self._repeated)
        self.index, self.count = _groups(label)
        own = np.where(label >= 0, variance - shared, variance)
        self.scale = np.sqrt(own)
        first = np.zeros(len(self.count), dtype=np.intp)
        first[self.index] = self.rows
        own, together = own[first], self.count * shared[first]
        self.shrink = 1 - np.sqrt(own / (own + together))

    def with_labels(self, label: Integers) -> "Repeats":
        """Return the same for other repeats."""
        return Repeats(self.variance, self.shared, label)

    def within(self, label: Integers) -> bool:
        """Whether all repeats of a reading have its label, (n,): columns keep to their rows."""
        own, first = label[self.rows], np.zeros(len(self.count), dtype=label.dtype)
        first[self.index] = own
        return bool(np.array_equal(first[self.index], own))

    def covariance(self, columns: Floats) -> Floats:
        """Return columns (n, k) times the covariance of the errors between them, shape (k, k)."""
        own = columns[self.rows] * np.sqrt(self.shared[self.rows])[:, None]
        together = np.zeros((len(self.count), columns.shape[1]))
        np.add.at(together, self.index, own)
        alone = self.scale**2
        return np.asarray(columns.T @ (columns * alone[:, None]) + together.T @ together)

    def __call__(self, columns: Floats) -> Floats:
        """Whiten columns (n, ...)."""
        flat = columns.reshape(len(columns), -1) / self.scale[:, None]
        if len(self.count) and len(columns) >= MANY_ROWS:
            # Each column by itself: columns lie in a row in memory.
            every, share = where_true(self._repeated), self.shrink / self.count
            for column in flat.T:
                own = column[every]
                column[every] = own - (share * np.bincount(self.index, own))[self.index]
        elif len(self.count):
            own = flat[self.rows]
            order = np.argsort(self.index, kind="stable")
            start = np.concatenate([[0], np.cumsum(self.count)[:-1]])
            total = np.add.reduceat(own[order], start, axis=0)
            flat[self.rows] = own - (total * (self.shrink / self.count)[:, None])[self.index]
        return np.asarray(flat.reshape(columns.shape))


def growth(off: Floats, variance: Floats) -> Floats:
    """How many times its standard error rounding makes an estimate's error.

    ``off``: errors of the estimates in draws from machines that lie anywhere between two steps
    (`ANY_PLACE`), shape (p, s): around one place errors have a mean of their own. ``variance``: as
    stated, shape (p,). Below 1 where steps happen to lie so that errors cancel.
    """
    known = variance > 0
    share = np.mean(off**2, axis=1) / np.where(known, variance, 1.0)
    return np.sqrt(np.where(known, share, 1.0))


def grown(covariance: Floats, off: Floats) -> Floats:
    """Covariance of estimates whose errors in such draws are ``off``, shape (p, s)."""
    more = growth(off, np.diag(covariance))
    return covariance * np.outer(more, more)


def inflation(
    gains: Callable[[Floats], Floats], errors: Floats, rank: Integers, chance: Floats
) -> Floats:
    """How many times more candidates gain from errors of rounding than from noise, 1 at least.

    Errors of rounding of a machine that is known to a part of a step are much the same each time:
    what they do along a candidate has a mean, and scatters about it.

    gains: What blocks gain from errors (n, s), in units of the noise, shape (b, s).
    errors: White errors of unit variance in draws, shape (n, s).
    rank: Of each block, shape (b,).
    chance: What each gains from noise at the level at which it is judged, shape (b,).
    """
    count = errors.shape[1]
    every = gains(errors).mean(axis=1)
    mean = gains(errors.mean(axis=1, keepdims=True))[:, 0]
    mean = np.maximum(count * mean - every, 0.0) / (count - 1)
    scatter = np.maximum(every - mean, 0.0) / np.maximum(rank, 1)
    reached = (np.sqrt(mean) + np.sqrt(scatter * chance)) ** 2
    return np.asarray(np.maximum(reached / np.maximum(chance, TINY), 1.0))


def _groups(label: Integers) -> tuple[Integers, Integers]:
    """Group of each reading that repeats another, and how many each group has."""
    _, index, count = np.unique(label[label >= 0], return_inverse=True, return_counts=True)
    return index.reshape(-1), count


def _several(label: Integers) -> Integers:
    """Keep the labels that several readings have."""
    if not np.any(label >= 0):
        return label
    count = np.bincount(label[label >= 0], minlength=int(label.max()) + 1)
    return np.where((label >= 0) & (count[np.maximum(label, 0)] > 1), label, -1)
