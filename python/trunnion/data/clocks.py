"""Two recordings of one motion whose clocks are not common: the offset that brings them together.

Both are brought to one rate and smoothed alike. The offset is found roughly by cross-correlating
their speeds, then by least squares: the first signal is an affine function of the second at times
shifted by the offset. The standard error allows for residuals that depend on each other
(the
larger of two long-run variances: of the scores, and of residuals alike everywhere).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import interpolate, ndimage, optimize

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError, InputError
from trunnion.base.report import Result, Table, measured, plus_minus
from trunnion.base.units import Floats

SMOOTHING = 2.0
"""Standard deviation of the smoothing, in samples of the slower recording."""
MIN_SAMPLES = 30
MIN_CORRELATION = 0.5
RIVAL = 0.95
"""A second peak of the cross-correlation this high makes the offset ambiguous."""
MAX_SAMPLES = 1_000_000


@dataclass(frozen=True, eq=False, repr=False)
class ClockOffset(Result):
    """Offset between two clocks.

    Attributes
    ----------
    offset_s
        What to add to the second clock to get the first.
    std_error_s
        Its standard uncertainty, by the residuals.
    correlation
        Of the speeds, at the offset.
    rms
        What the affine function leaves, in the first signal's unit.

    Examples
    --------
    >>> import trunnion as tn
    >>> import numpy as np
    >>> time = np.arange(0.0, 20.0, 0.05)
    >>> signal = np.sin(time) + 0.3 * np.sin(2.7 * time)
    >>> round(tn.align_clocks(time, signal, time + 0.2, signal).offset_s, 3)
    -0.2
    """

    offset_s: float
    std_error_s: float
    correlation: float
    rms: float

    def sentences(self) -> Sequence[str]:
        """Say the offset."""
        said = plus_minus(1e3 * self.offset_s, 1e3 * self.std_error_s)
        return (
            f"The first clock is the second plus {said} ms (standard uncertainty); "
            f"correlation of the speeds {self.correlation:.4f}, residual {self.rms:.4g} rms.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Return the offset."""
        row = ("offset", *measured(1e3 * self.offset_s, 1e3 * self.std_error_s), "ms")
        return (Table.of("Clocks", ("", "value", "standard uncertainty", "unit"), [row]),)


@checked
def align_clocks(
    time_a_s: ArrayLike, a: ArrayLike, time_b_s: ArrayLike, b: ArrayLike
) -> ClockOffset:
    """Find the offset between the clocks of two recordings of the same motion.

    Parameters
    ----------
    time_a_s, time_b_s
        Times by each clock, rising, (n,) and (m,).
    a, b
        Signals, (n,) or (n, p) and (m,) or (m, q). Each of `a` is an affine function of `b` (a gain
        and a zero; for a place that turns with an angle, `b` is its cosine and sine).

    Raises
    ------
    InputError
        Times that do not rise, other lengths, fewer than 30 samples.
    DataError
        Signals that do not move, do not agree at any offset, or agree at several.

    Examples
    --------
    >>> import trunnion as tn
    >>> import numpy as np
    >>> time = np.arange(0.0, 20.0, 0.05)
    >>> signal = np.sin(time) + 0.3 * np.sin(2.7 * time)
    >>> found = tn.align_clocks(time, signal, time + 0.2, signal)
    >>> round(found.offset_s, 3)
    -0.2
    """
    first, second = _Recording.of("a", time_a_s, a), _Recording.of("b", time_b_s, b)
    step = max(first.step, second.step)
    x, y = first.even(step), second.even(step)
    begin, correlation = _rough(x, y)
    start = begin * step + first.time[0] - second.time[0]
    fit = _Fit(first.time[0] + step * np.arange(len(x)), x, second.time[0], y, step)
    # the overlap is kept fixed, so that sums of squares at neighbouring offsets compare
    fit.keep(start - 2 * step, start + 2 * step)
    best = optimize.minimize_scalar(
        lambda offset: fit.residual(offset)[1],
        bounds=(start - 2 * step, start + 2 * step),
        method="bounded",
        options={"xatol": 1e-6 * step},
    )
    offset = float(best.x)
    left, sum_of_squares = fit.residual(offset)
    return ClockOffset(
        offset_s=offset,
        std_error_s=fit.std_error(offset, left),
        correlation=correlation,
        rms=float(np.sqrt(sum_of_squares / left.size)),
    )


@dataclass(frozen=True)
class _Recording:
    time: Floats
    values: Floats

    @classmethod
    def of(cls, name: str, time_s: ArrayLike, values: ArrayLike) -> _Recording:
        time = np.asarray(time_s, dtype=np.float64).reshape(-1)
        found = np.asarray(values, dtype=np.float64)
        found = found[:, None] if found.ndim == 1 else found
        if found.ndim != 2 or len(found) != len(time) or len(time) < MIN_SAMPLES:
            raise InputError(
                f"{name}: got {found.shape} values at {len(time)} times, expected a row for each, "
                f"at least {MIN_SAMPLES}"
            )
        if np.any(np.diff(time) <= 0):
            raise InputError(f"time_{name}_s: got times that do not rise, expected rising ones")
        if np.all(np.ptp(found, axis=0) == 0):
            raise DataError(f"{name}: got a signal that does not move")
        return cls(time, found)

    @property
    def step(self) -> float:
        return float(np.median(np.diff(self.time)))

    def even(self, step: float) -> Floats:
        """Return the signal at even times, smoothed."""
        count = int((self.time[-1] - self.time[0]) / step) + 1
        if not MIN_SAMPLES <= count <= MAX_SAMPLES:
            raise InputError(f"times: got {count} common steps, expected {MIN_SAMPLES} or more")
        times = self.time[0] + step * np.arange(count)
        # the mean over a step where samples are closer than that
        fine = max(1, round(step / self.step))
        values = ndimage.uniform_filter1d(self.values, fine, axis=0) if fine > 1 else self.values
        even = np.stack([np.interp(times, self.time, v) for v in values.T], axis=1)
        return np.asarray(ndimage.gaussian_filter1d(even, SMOOTHING, axis=0))


def _rough(x: Floats, y: Floats) -> tuple[int, float]:
    """Return the lag, in steps, at which the speeds agree most, and their correlation there."""
    from scipy import signal  # it imports scipy.stats

    speeds = [np.linalg.norm(np.gradient(v / v.std(axis=0).max(), axis=0), axis=1) for v in (x, y)]
    s, t = (v - v.mean() for v in speeds)
    found = signal.correlate(s, t) / np.sqrt(np.sum(s**2) * np.sum(t**2))
    lags = signal.correlation_lags(len(s), len(t))
    best = int(np.argmax(found))
    if not found[best] >= MIN_CORRELATION:
        raise DataError(
            f"signals: got speeds with a correlation of {found[best]:.2f} at best, expected "
            f"{MIN_CORRELATION} or more: are they of the same motion?"
        )
    peaks = signal.find_peaks(found, height=RIVAL * found[best])[0]
    others = [lags[p] for p in peaks if abs(p - best) > 5 * SMOOTHING]
    if others:
        raise DataError(
            f"signals: got a motion that repeats: lags of {lags[best]} and {others[0]} samples fit "
            "alike, expected one that does not"
        )
    return int(lags[best]), float(found[best])


class _Fit:
    """The first signal as an affine function of the second at shifted times."""

    def __init__(self, time: Floats, x: Floats, begin: float, y: Floats, step: float) -> None:
        self.time, self.x, self.step = time, x, step
        self.end = begin + step * (len(y) - 1)
        self.begin = begin
        self.spline = interpolate.CubicSpline(begin + step * np.arange(len(y)), y)

    def keep(self, low: float, high: float) -> None:
        """Keep the rows that both have at every offset from low to high."""
        edge = 4 * SMOOTHING * self.step
        there = (self.time - high >= self.begin + edge) & (self.time - low <= self.end - edge)
        there &= (self.time >= self.time[0] + edge) & (self.time <= self.time[-1] - edge)
        if there.sum() < MIN_SAMPLES:
            raise DataError(
                f"signals: got {there.sum()} samples in common, expected {MIN_SAMPLES} or more"
            )
        self.time, self.x = self.time[there], self.x[there]

    def residual(self, offset: float) -> tuple[Floats, float]:
        """Return the residuals (n, p) and their sum of squares."""
        design = self._design(offset)
        left = self.x - design @ np.linalg.lstsq(design, self.x, rcond=None)[0]
        return left, float(np.sum(left**2))

    def _design(self, offset: float) -> Floats:
        at = self.spline(self.time - offset)
        return np.column_stack([np.ones(len(at)), at])

    def std_error(self, offset: float, left: Floats) -> float:
        """Standard error of the offset from residuals that depend on their neighbours."""
        design = self._design(offset)
        gain = np.linalg.lstsq(design, self.x, rcond=None)[0]
        by = -self.spline(self.time - offset, 1) @ gain[1:]
        by = by - design @ np.linalg.lstsq(design, by, rcond=None)[0]
        # weight 1 over what the smoothing makes dependent, then falling (Politis and Romano 1995)
        n = len(by)
        whole = round(6 * SMOOTHING) + int(4 * (n / 100) ** (2 / 9))
        weights = [(k, 2 * min(1.0, 2.0 - k / whole)) for k in range(1, min(n // 4, 2 * whole) + 1)]
        score = np.sum(by * left, axis=1)
        local = float(score @ score) + sum(w * float(score[k:] @ score[:-k]) for k, w in weights)
        # where the residuals are alike everywhere their own covariance says it more surely
        even = float(np.sum(np.sum(by**2, axis=0) * np.mean(left**2, axis=0))) + sum(
            w * float(np.sum(np.sum(by[k:] * by[:-k], axis=0) * np.mean(left[k:] * left[:-k], 0)))
            for k, w in weights
        )
        return float(np.sqrt(max(local, even, 0.0)) / np.sum(by**2))
