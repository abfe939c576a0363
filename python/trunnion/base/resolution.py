"""Readings that are recorded in steps: a control's tick, the resolution of a scale, a display.

A reading in steps of t has an error of rounding between -t/2 and t/2 beside its noise: variance
t²/12 (GUM, F.2.2.1). Three things follow.

- The noise of a reading is never below t/√12, however well some model fits. A model with enough
  parameters always finds readings on one grid that it fits exactly.
- Errors of rounding are a function of where the machine is, not noise: readings that differ by a
  part of a step round alike. What that does to a machine like the fitted one, which rounds to what
  was read (:mod:`.rounded`), is simulated (:meth:`Grid.draws`), and each candidate is judged
  against it.
- Repeats of one reading on one grid have the same error of rounding as long as their noise is small
  beside the step: they are no independent readings. With noise of standard deviation s their errors
  of rounding correlate by (6/π²) Σ exp(-4π²k²s²/t²) / k², from the Fourier series of the sawtooth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from trunnion.base.recognition import on_grid
from trunnion.base.repeats import (
    CORRELATION,
    MAX_NOISE_STEPS,
    SCATTER,
    STEPS,
    Repeats,
    noise_beside,
    repeated,
    several,
)
from trunnion.base.rounded import Place, place_of
from trunnion.base.rows import equal_rows
from trunnion.base.statistics import factor_of
from trunnion.base.units import Flags, Floats, Integers

MIN_NOISE_STEPS = 0.02  # noise of a reading, in steps, that is taken as there
ANY_PLACE = 1.0  # steps: machines that differ as much lie anywhere between two steps
MAX_SIMULATED_STEPS = 0.5  # noise, in steps, from which rounding is as good as random
MAX_DRAWS = 128
MIN_DRAWS = 16
MAX_DRAWN = 1 << 22  # numbers that are drawn
SEED = 1
SAME_PHASE_STEPS = 0.02
SAME_ROW = 1e-3  # of the largest derivative: the same line of approach
OFF_EDGE = 0.3141  # so that round numbers do not lie where two cells meet
MIN_REPEATS = 5  # degrees of freedom from which repeats tell the noise
AT_EDGE = 1e-6  # of a step: rounding of numbers, where a machine is just between two steps
TINY = 1e-300


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
            and on_grid(self.places, least)
            and not any(on_grid(own, least) for own in readings)
        )


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of the readings of several measurements, each with steps and noise of its own.

    Attributes
    ----------
    noise:
        Standard deviation of each reading beside the rounding, shape (n,).
    scale:
        Largest step of the measurement of each reading; 0: it has none. Shape (n,).
    rounding:
        Mean variance of the errors of rounding of white readings.
    """

    noise: Floats
    scale: Floats
    rounding: float

    @classmethod
    def nothing(cls, count: int) -> "Known":
        """Of so many readings that are not recorded in steps."""
        return cls(np.zeros(count), np.zeros(count), 0.0)

    def completed(self, white: Floats) -> Floats:
        """Return white errors (n, s) with white noise where a measurement has no steps."""
        rng = np.random.default_rng(SEED)
        return np.where(self.scale[:, None] > 0, white, rng.standard_normal(white.shape))


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
    known:
        Of several measurements, what each of them says of its own readings.
    follows:
        Whether the noise beside the rounding is known and rounding is to be simulated on what was
        found, however the readings are made white.
    """

    follows: ClassVar[bool] = False
    step: Floats
    label: Integers
    parts: Floats | None = None
    known: Known | None = None

    @classmethod
    def of(
        cls,
        values: Floats,
        step: Floats,
        jacobian: Floats,
        repeats: Integers | None,
        recorded: Sequence[Floats] = (),
        coordinates: Coordinates | None = None,
    ) -> "Grid":
        """Find which repeats are on one grid, and depend alike on everything that is fitted.

        Parameters
        ----------
        values, step:
            Of each reading, shape (n,).
        repeats:
            Equal labels for repeats of a reading, -1 for one without, shape (n,); None: no repeats.
        jacobian:
            Derivative of the readings, shape (n, p).
        recorded, coordinates:
            What may lie on the steps beside the readings.
        """
        size = np.abs(jacobian).max(axis=0)
        rows = np.floor(jacobian / np.where(size > 0, size * SAME_ROW, 1.0) + OFF_EDGE)
        again = np.full(len(values), -1) if repeats is None else repeats
        label, first = equal_rows([*rows.T, step, again])
        places, parts = values[:, None], None
        if coordinates is not None and coordinates.on(step, (values, *recorded)):
            places, parts = coordinates.places, coordinates.parts
        off = (places - places[first][label]) / np.where(step > 0, step, np.inf)[:, None]
        alike = np.all(np.abs(off - np.round(off)) < SAME_PHASE_STEPS, axis=1)
        alike &= (step > 0) & (again >= 0)
        return cls(step, several(np.where(alike, label, -1)), parts)

    def stated(self, step: Floats | None) -> Flags:
        """Return which readings have the step that is stated for them, ``step`` (n,), if any is."""
        return np.zeros(len(self.step), dtype=bool) if step is None else self.step == step

    def correlation(self, steps: Floats) -> Floats:
        """Correlation of the errors of rounding of repeats with so much noise, in steps (n,)."""
        parts = np.ones((len(self.step), 1)) if self.parts is None else np.abs(self.parts)
        own = np.interp(parts * steps[:, None], STEPS, CORRELATION, right=0.0)
        return np.asarray(np.sum(parts**2 * own, axis=1))

    @classmethod
    def joined(cls, measured: Sequence[tuple["Grid | None", int]]) -> "Grid | None":
        """Grid of several measurements below each other; None: none has one.

        ``measured``: the grid of each, with what is known of its readings, and their count.
        """
        if not any(grid for grid, _ in measured):
            return None
        every = [grid or cls.none(count) for grid, count in measured]
        known = [grid.known or Known.nothing(len(grid.step)) for grid in every]
        width = max(1 if grid.parts is None else grid.parts.shape[1] for grid in every)
        labels, parts, first = [], [], 0
        for grid in every:
            own = np.ones((len(grid.step), 1)) if grid.parts is None else grid.parts
            parts.append(np.pad(own, ((0, 0), (0, width - own.shape[1]))))
            labels.append(np.where(grid.label >= 0, grid.label + first, -1))
            first += int(grid.label.max(initial=-1)) + 1
        step = np.concatenate([grid.step for grid in every])
        rounding = sum(k.rounding * len(k.noise) for k in known) / len(step)
        return cls(
            step,
            np.concatenate(labels),
            np.concatenate(parts) if width > 1 else None,
            Known(
                np.concatenate([k.noise for k in known]),
                np.concatenate([k.scale for k in known]),
                rounding,
            ),
        )

    @classmethod
    def none(cls, count: int) -> "Grid":
        """Grid of so many readings that are not recorded in steps."""
        return cls(np.zeros(count), np.full(count, -1))

    @property
    def by_reading(self) -> bool:
        """Whether each reading of one measurement is recorded in a step."""
        return self.known is None and self.parts is None and bool(np.all(self.step > 0))

    @property
    def rounding(self) -> float:
        """Mean variance of the errors of rounding."""
        if self.known is not None:
            return self.known.rounding
        return float(np.mean(self.step**2)) / 12

    def read_of(self, off: Floats, rows: Integers) -> bool:
        """Whether all ``rows`` of one measurement are read so of a machine, without any noise.

        ``off``: Readings less what they would be without steps, (n,). Just between two steps a
        machine is read as either.
        """
        parts = np.ones((len(self.step), 1)) if self.parts is None else np.abs(self.parts)
        half = (0.5 + AT_EDGE) * self.step * parts.sum(axis=1)
        inside = (self.step > 0) & (np.abs(off) <= half)
        return self.known is None and bool(np.all(inside[rows]))

    def without(self, bad: Integers) -> "Grid":
        """Return the grid when these readings are left out: they repeat no other."""
        label = self.label.copy()
        label[bad] = -1
        return replace(self, label=several(label))

    def noise(
        self, residuals: Floats, dof: int, jacobian: Floats, weights: Floats | float = 1.0
    ) -> float:
        """Estimate the noise beside the rounding (standard deviation), from repeats if there are.

        Of several steps the finest show it: of what they leave, what the others brought into the
        fit is taken off. ``residuals``: of all readings, not whitened, shape (n,); ``jacobian``
        and ``weights``: of the fit, shapes (n, p) and (n,).
        """
        step = float(self.step.min())
        freedom = self._freedom_of_repeats
        if step > 0 and freedom >= MIN_REPEATS:
            label = np.where(self.step == step, self.label, -1)
            index, count = repeated(label)
            r = residuals[label >= 0]
            mean = np.bincount(index, r) / count
            pure = float(np.sum((r - mean[index]) ** 2)) / freedom / step**2
            scatter = self._scatter_of_repeats()
            return step * noise_beside(pure, scatter)
        if np.all(self.step == self.step[0]):
            total = float(residuals @ residuals) / max(dof, 1)
            return float(np.sqrt(max(total - self.step[0] ** 2 / 12, 0.0)))
        return self._noise_of_finest(residuals, jacobian, np.broadcast_to(weights, len(residuals)))

    def _noise_of_finest(self, residuals: Floats, jacobian: Floats, weights: Floats) -> float:
        """Noise from the readings of the finest steps that are enough to tell it."""
        cofactor = np.asarray(
            np.linalg.pinv(jacobian.T @ (weights[:, None] * jacobian), hermitian=True), np.float64
        )
        noise = 0.0
        for step in np.unique(self.step):
            used = self.step <= step
            seen = partial(_left, jacobian, weights, cofactor, used)
            freedom = max(seen(np.ones(len(residuals))), 1.0)
            left = float(residuals[used] @ residuals[used]) - seen(self.step**2 / 12)
            noise = float(np.sqrt(max(left / freedom, 0.0)))
            if freedom >= MIN_REPEATS:
                break
        return noise

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

    @cached_property
    def _freedom_of_repeats(self) -> int:
        """Degrees of freedom of repeats in the finest steps."""
        again = (self.label >= 0) & (self.step == self.step.min())
        return int(again.sum()) - len(np.unique(self.label[again]))

    def _scatter_of_repeats(self) -> Floats:
        """Variance of repeats for each noise of `STEPS`, in squares of steps."""
        if self.parts is None:
            return np.asarray(SCATTER)
        alike = np.unique(np.round(np.abs(self.parts[self.label >= 0]), 2), axis=0)
        own = np.interp(alike * STEPS[:, None, None], STEPS, CORRELATION, right=0.0)
        shared = np.minimum(np.sum(alike**2 * own, axis=2).mean(axis=1), 1.0)
        return np.asarray(STEPS**2 + (1 - shared) / 12)

    def matters(self, noise: float) -> bool:
        """Whether the steps are so large beside the noise that rounding is not random."""
        return noise < MAX_SIMULATED_STEPS * float(self.step.max())

    def place(
        self, residuals: Floats, jacobian: Floats, covariance: Floats, noise: float, used: Floats
    ) -> Place | None:
        """Where machines lie that were read so (:mod:`.rounded`).

        None where the noise is large beside the steps. Arguments as of :meth:`draws`; ``used``: 1
        for readings, 0 for others, shape (n,).
        """
        if not self.matters(noise):
            return None
        return place_of(residuals, jacobian, covariance, self.step, used)

    def draws_in(self, noise: float) -> bool:
        """Whether there are :meth:`draws` in this noise: steps are large beside it somewhere."""
        if self.known is None:
            return self.matters(noise)
        return bool(np.any(self.known.noise < MAX_SIMULATED_STEPS * self.known.scale))

    def draws(
        self,
        values: Floats,
        residuals: Floats,
        jacobian: Floats,
        covariance: Floats,
        noise: float,
        spread: float = 0.0,
        place: Place | None = None,
    ) -> Floats | None:
        """Errors of rounding and noise of machines like a fitted one, all readings, shape (n, s).

        None where the noise is large beside the steps. The machine is drawn from the fit's
        covariance; each of its readings is the step next to what it would be. ``spread``: the
        readings of these machines differ by as many steps at least (rms); 0: as the fit says.
        ``noise``: of all readings, unless that of each is known. ``place``: of machines that were
        read so, from which they are drawn in place of the covariance.
        """
        if not self.draws_in(noise):
            return None
        known, every = self.known, np.ones(len(values))
        each, scale = noise * every, float(self.step.max()) * every
        if known is not None:
            each, scale = known.noise, known.scale
        count = int(np.clip(MAX_DRAWN // len(values), MIN_DRAWS, MAX_DRAWS))
        rng = np.random.default_rng(SEED)
        if place is None:
            off = machines(jacobian, covariance, scale, spread, count, rng)
        else:
            off, each = place.drawn(count, rng), place.noise * every
        if not spread or self.parts is None:  # it would distinguish equal repeats
            each = np.maximum(each, MIN_NOISE_STEPS * scale)
        where = (values - residuals)[:, None] + off
        noisy = where + each[:, None] * rng.standard_normal(where.shape)
        step = np.where(self.step > 0, self.step, 1.0)[:, None]
        steps, rounded = (noisy - values[:, None]) / step, np.zeros(noisy.shape)
        for part in (np.ones(len(values)),) if self.parts is None else self.parts.T:
            rounded += part[:, None] * np.round(part[:, None] * steps)
        off = np.where(self.step[:, None] > 0, values[:, None] + step * rounded, noisy) - where
        return np.asarray(off)


def machines(
    jacobian: Floats,
    covariance: Floats,
    scale: Floats,
    spread: float,
    count: int,
    rng: np.random.Generator,
) -> Floats:
    """How readings of machines like a fitted one differ from its own, shape (n, count).

    ``scale``: step of each reading, 0: none, (n,); ``spread``: see :meth:`Grid.draws`.
    """
    free = np.flatnonzero(np.diag(covariance) > 0)
    root = factor_of(covariance[np.ix_(free, free)])
    off = jacobian[:, free] @ (root @ rng.standard_normal((len(free), count)))
    steps = off[scale > 0] / scale[scale > 0, None]
    off *= max(1.0, spread / max(float(np.sqrt(np.mean(steps**2))), TINY))
    return np.asarray(off)


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


def _left(
    jacobian: Floats, weights: Floats, cofactor: Floats, used: Flags, variance: Floats
) -> float:
    """Sum of squares that errors of these variances (n,) leave in the used readings of a fit."""
    own = jacobian[used] @ cofactor
    kept = 1 - 2 * weights[used] * np.sum(own * jacobian[used], axis=1)
    brought = jacobian.T @ ((weights**2 * variance)[:, None] * jacobian)
    return float(kept @ variance[used] + np.sum((own @ brought) * own))
