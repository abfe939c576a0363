"""Positions that are logged in steps: what rounding does to the readings of a log.

The error of rounding of an axis is no noise: it is a sawtooth of the position, slow where the axis
is slow, constant where it rests, and what an axis does (friction, backlash, its delay) depends on
the same position. So where the noise of the positions is small beside their step, rounding is
simulated at the samples (:meth:`LogSteps.draws`): of actual positions about the fitted motion, of
commanded ones through the loop that the servo model puts them through.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from trunnion.base.recognition import recognised
from trunnion.base.resolution import (
    MAX_DRAWN,
    MAX_DRAWS,
    MAX_SIMULATED_STEPS,
    MIN_DRAWS,
    MIN_NOISE_STEPS,
    SEED,
    Grid,
    Known,
    machines,
)
from trunnion.base.rounded import Place
from trunnion.base.units import Flags, Floats
from trunnion.diagnosis.dependence import length
from trunnion.diagnosis.noise import Channel, basis_beside
from trunnion.models.axis_log.signals import AxisSignal, Run

MIN_DISTINCT = 5  # positions in which a step is recognised
MIN_TURNS = 0.2  # changes of the pace of rounded positions, a jump; places of a plan are even
FINE = 1.0  # noise of samples, in steps of the actual positions, of which rounding is noise
FINE_COMMAND = 3.0  # the same, of the commanded ones
MIN_SHARE = 0.01  # of the variance of readings, that rounded commands make before they count
NOISES = (MIN_NOISE_STEPS, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
MAX_PACE = 2.5  # steps a sample, of an axis that goes up stairs
MAX_ROUGH = 0.25  # noise, in steps, below which the size of errors changes with the position
LONGER = 2.0  # times the longest memory of simulated rounding, from which on it is another's
COARSER = 1.5  # times the stated step, from which on a recognised one is another
FEW_DRAWS = 8
EXPECTED_DRAWS = 32
GROWTH_DRAWS = 128
DIFFERENCE = 20.0**0.5  # noise of third differences, of white noise
TINY = 1e-300


def step_of(values: Floats) -> float:
    """Step of positions; of a fixed count of digits, that of the largest ones."""
    distinct = np.unique(values)
    size = float(np.abs(distinct).max(initial=0.0))
    if size <= 0.0:
        return 0.0
    largest = distinct[np.abs(distinct) >= 10.0 ** np.floor(np.log10(size))]
    return max(recognised(distinct), recognised(largest) if len(largest) > MIN_DISTINCT else 0.0)


@dataclass(frozen=True, eq=False)
class Rounded:
    """An axis of which positions are logged in steps that matter.

    Attributes
    ----------
    signal:
        The axis.
    actual, commanded:
        Steps of its positions, mm or deg; 0: none.
    noise:
        Of a sample of its actual position, beside the rounding, mm or deg.
    expected:
        Mean errors of its readings beside the noise, µm or arcsec, shape (blocks,).
    growth:
        How many times more its errors may change what is estimated from its readings than white
        noise of the same size, in variance.
    memory:
        Readings that count as one, at most, where rounding alone makes them depend on each other.
    stated:
        Whether the larger step is the one that the set-up states.
    """

    signal: AxisSignal
    actual: float
    commanded: float
    noise: float
    expected: Floats
    growth: float = 1.0
    memory: float = np.inf
    stated: bool = False

    @classmethod
    def of(cls, signal: AxisSignal, channel: Channel) -> "Rounded | None":
        """Look at an axis with steps; None: rounding is noise like any other.

        ``channel``: with all that is no noise in the readings of the axis.
        """
        (actual, stated), commanded = _actual_step(signal), signal.command_step
        y = signal.deviation()
        q = basis_beside(y, channel)
        left = y - q @ (q.T @ y)
        dof: int = max(len(y) - q.shape[1], 1)
        found = float(left @ left) / dof
        free = cls(signal, actual, commanded, 0.0, np.zeros(len(y)))
        rng = np.random.default_rng(SEED)
        of_command = free.of_command(rng, FEW_DRAWS)
        fitted, top = (y - left)[:, None], max(actual, commanded)

        def variance(errors: Floats) -> float:
            white = errors - q @ (q.T @ errors)
            return float(np.mean(np.sum(white**2, axis=0))) / dof

        sizes = top * np.array(NOISES)
        made = [
            variance(of_command + free.of_actual(fitted, noise, rng, FEW_DRAWS)) for noise in sizes
        ]
        noise = float(np.interp(found, np.maximum.accumulate(made), sizes))
        by_command = variance(of_command) > MIN_SHARE * found
        if noise >= MAX_SIMULATED_STEPS * actual and not by_command:
            return None
        own = replace(free, commanded=commanded if by_command else 0.0, noise=noise)
        errors = own.of_actual(fitted, noise, rng, EXPECTED_DRAWS)
        expected, growth = errors.mean(axis=1), own._growth(fitted, q)
        errors += own.of_command(rng, EXPECTED_DRAWS)
        memory, stated = own._memory(errors, q), stated and actual >= own.commanded
        return replace(own, expected=expected, growth=growth, memory=memory, stated=stated)

    def _memory(self, errors: Floats, basis: Floats) -> float:
        """Readings that may count as one by errors (blocks, draws) beside what is estimated."""
        left = errors - errors.mean(axis=1, keepdims=True)
        left -= basis @ (basis.T @ left)
        groups = self.signal.blocks.groups[self.signal.rows]
        each = [left[groups == g] for g in np.unique(groups)]
        return LONGER * max(length([x[:, i] for x in each]) for i in range(left.shape[1]))

    def _growth(self, fitted: Floats, basis: Floats) -> float:
        """Largest variance that errors have along a combination of what is estimated, over white's.

        The steps lie anywhere. ``basis``: orthonormal, of all that is estimated, (blocks, k).
        """
        rng = np.random.default_rng(SEED)
        shift = self.signal.units.scale * max(self.actual, self.commanded)
        anywhere = fitted + shift * rng.uniform(-0.5, 0.5, GROWTH_DRAWS)
        errors = self.of_actual(anywhere, self.noise, rng, GROWTH_DRAWS)
        errors += self.of_command(rng, GROWTH_DRAWS)
        white = float(np.sqrt(np.mean(errors**2))) * rng.standard_normal(errors.shape)
        found, usual = (float(np.linalg.norm(basis.T @ some, ord=2)) for some in (errors, white))
        return max((found / max(usual, TINY)) ** 2, 1.0)

    def of_actual(
        self, fitted: Floats, noise: float, rng: np.random.Generator, count: int
    ) -> Floats:
        """Errors of readings by noise and rounding of actual positions, shape (blocks, count).

        ``fitted``: what the readings would be without, (blocks, 1 or count).
        """
        signal, step = self.signal, self.actual
        out = np.empty((len(signal.actual), count))
        for i in range(count):
            own = fitted[:, min(i, fitted.shape[1] - 1)]
            where = signal.predicted + signal.between(own) / signal.units.scale
            noisy = where + noise * rng.standard_normal(len(where))
            if step > 0:
                noisy = signal.actual + step * np.round((noisy - signal.actual) / step)
            out[:, i] = noisy - where
        return signal.mean(signal.units.scale * out)

    def of_command(self, rng: np.random.Generator, count: int) -> Floats:
        """Errors of readings by rounded commands, wherever the steps lie: (blocks, count)."""
        signal, step = self.signal, self.commanded
        if step <= 0:
            return np.zeros((len(signal.blocks), count))
        out = np.empty((len(signal.commanded), count))
        smooth = _smooth(signal.commanded, np.inf, signal.runs)
        # Of an axis that goes a step a sample or more these lie on steps: it is anywhere between.
        quick = np.abs(np.gradient(smooth)) >= step
        for i, place in enumerate(step * rng.uniform(-0.5, 0.5, count)):
            true = smooth + step / 2 * quick * rng.uniform(-1.0, 1.0, len(smooth))
            read = place + step * np.round((true - place) / step)
            off = _smooth(read, step, signal.runs) - true
            out[:, i] = -signal.through_loop(off)
        return signal.mean(signal.units.scale * out)


@dataclass(frozen=True, eq=False)
class LogSteps(Grid):
    """The steps of a log's positions; of axes where they do not matter, 0.

    Attributes
    ----------
    axes:
        Those where they matter.
    off:
        Readings of the log, shape (n,).
    """

    follows: ClassVar[bool] = True
    axes: tuple[Rounded, ...] = ()
    off: Floats = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of_axes(cls, axes: Iterable[Rounded | None], off: Floats) -> "LogSteps | None":
        """Grid of a log's axes; None: no step matters. ``off``: the readings."""
        rounded = tuple(axis for axis in axes if axis is not None)
        if not rounded:
            return None
        n = len(off)
        step, noise, scale = np.zeros(n), np.zeros(n), np.zeros(n)
        for axis in rounded:
            rows, units = axis.signal.rows, axis.signal.units
            step[rows] = float(f"{units.scale * max(axis.actual, axis.commanded):.6g}")
            noise[rows] = units.scale * axis.noise
            scale[rows] = step[rows]
        # White readings have a variance of 1, rounding included, and no cause takes any of it.
        known = Known(noise, scale, 1.0)
        return cls(step, np.full(n, -1), None, known, rounded, off)

    def stated(self, step: Floats | None) -> Flags:  # noqa: ARG002
        """Return which readings have the step that the set-up states, shape (n,)."""
        out = np.zeros(len(self.step), dtype=bool)
        for axis in self.axes:
            out[axis.signal.rows] = axis.stated
        return out

    def on(self, channel: Channel, number: int) -> Channel:
        """Return a channel with what is known of its rounding."""
        for axis in self.axes:
            if axis.signal.channel == number:
                white = axis.commanded > 0 or axis.noise < MAX_ROUGH * axis.actual
                return replace(
                    channel,
                    rounding=axis.expected,
                    growth=axis.growth,
                    white=white,
                    memory=axis.memory,
                )
        return channel

    def noise(self, *_: object) -> float:
        """Return nothing: the noise of each axis is known."""
        return 0.0

    def draws(
        self,
        values: Floats,
        residuals: Floats,
        jacobian: Floats,
        covariance: Floats,
        noise: float,  # noqa: ARG002
        spread: float = 0.0,
        place: Place | None = None,  # noqa: ARG002
    ) -> Floats | None:
        """Errors of noise and rounding of machines like a fitted one: see the base class.

        ``noise``, ``place``: what the base class is given; that of each axis is known, and machines
        are drawn about the fitted one.
        """
        samples = sum(len(axis.signal.actual) for axis in self.axes)
        count = int(np.clip(MAX_DRAWN // max(samples, len(values)), MIN_DRAWS, MAX_DRAWS))
        rng = np.random.default_rng(SEED)
        scale = np.zeros(len(values)) if self.known is None else self.known.scale
        off = machines(jacobian, covariance, scale, spread, count, rng)
        out = np.zeros(off.shape)
        for axis in self.axes:
            rows = axis.signal.rows
            fitted = (self.off - residuals)[rows, None] + off[rows]
            out[rows] = axis.of_actual(fitted, axis.noise, rng, count)
            out[rows] += axis.of_command(rng, count)
        return out


def without_steps(signal: AxisSignal) -> AxisSignal:
    """Return an axis with a smooth command in place of one in steps that are seen beside the noise.

    A loop follows a staircase otherwise than what it was made of: friction and backlash would act
    on each of its steps.
    """
    step = rounded_in(signal.commanded, _noise_of(signal) / FINE_COMMAND)
    if not step:
        return signal
    smooth = _smooth(signal.commanded, step, signal.runs)
    return replace(signal, commanded=smooth, command_step=step)


def may_matter(signal: AxisSignal) -> bool:
    """Whether an axis has steps that are not plainly small beside its noise."""
    return signal.command_step > 0 or _actual_step(signal)[0] > 0


def _actual_step(signal: AxisSignal) -> tuple[float, bool]:
    """Step of actual positions that matters, 0: none, and whether the set-up states it.

    Positions that are plainly in coarser steps than is stated are taken as they are.
    """
    least = _noise_of(signal) / FINE
    stated = getattr(signal.nominal, signal.units.name("resolution_{small}")) / signal.units.scale
    found = rounded_in(signal.actual, least)
    if stated > least and found < COARSER * stated:
        return stated, True
    return found, False


def _noise_of(signal: AxisSignal) -> float:
    """Noise of samples, rounding included, at most: the rough part of the readings, mm or deg."""
    off = signal.actual - signal.predicted
    rough = np.concatenate([np.diff(off[run.rows], n=3) for run in signal.runs])
    return float(np.std(rough)) / DIFFERENCE


def rounded_in(values: Floats, least: float) -> float:
    """Step in which positions are rounded, larger than ``least``; 0: none.

    Even places of a plan lie on a grid, too: an axis at constant speed goes a step a sample there.
    """
    step = step_of(values)
    if step <= least:
        return 0.0
    pace = np.round(np.diff(values) / step)
    jumps = int(np.sum(pace != 0))
    return step if np.sum(np.diff(pace) != 0) > MIN_TURNS * jumps else 0.0


def _smooth(values: Floats, step: float, runs: Sequence[Run]) -> Floats:
    """Positions without their steps: through the middles between different ones in a row.

    Where an axis goes several steps a sample they stay as they are: there rounding is noise.
    """
    out = values.copy()
    for run in runs:
        own = values[run.rows]
        jumps = np.abs(np.diff(own))
        at = np.flatnonzero(jumps)
        places = np.concatenate([[0.0], at + 0.5, [len(own) - 1.0]])
        middles = np.concatenate([own[:1], (own[at] + own[at + 1]) / 2, own[-1:]])
        smooth = np.interp(np.arange(len(own)), places, middles)
        pace = np.maximum(np.append(jumps, 0.0), np.append(0.0, jumps))
        out[run.rows] = np.where(pace < MAX_PACE * step, smooth, own)
    return out
