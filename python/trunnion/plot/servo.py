"""Pictures of the log of a position loop, in time and frequency.

Following error over time and speed, reversals, frequency response of data and model. The model is
the servo simulated on the logged commands; both responses are estimated from positions in the same
way (Welch's method), so that leakage and thin excitation show in both alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

import trunnion._core as _core
from trunnion.base.checks import choose
from trunnion.base.errors import DataError
from trunnion.base.units import ARCSEC, Floats
from trunnion.contouring.servo import Servo
from trunnion.data.axis_log import AxisLog
from trunnion.diagnosis.result import Diagnosis
from trunnion.plot.picture import Axis, Picture, Series, line, points
from trunnion.plot.static import panels
from trunnion.plot.style import BLUE, MUTED, PALETTE, VERMILLION
from trunnion.setup import Setup

MIN_SAMPLES = 64
WINDOW_S = 0.06
"""Before and after a reversal."""
MAX_REVERSALS = 8
REVERSAL_SHARE = 0.02  # of the largest speed: what counts as moving
WINDOW = "blackmanharris"
MIN_COHERENCE = 0.9
MIN_POWER = 1e-6  # of the largest: below, the window of the estimate leaks
MIN_BANDS = 6


@dataclass(frozen=True)
class _Run:
    """One run of one axis: time (s), commanded and actual position, mm or deg; its label."""

    time: Floats
    commanded: Floats
    actual: Floats
    label: str

    @property
    def period(self) -> float:
        return float(np.median(np.diff(self.time)))

    @property
    def speed(self) -> Floats:
        """Commanded speed, mm/min or deg/min."""
        return np.asarray(np.gradient(self.commanded, self.time) * 60.0)


def _runs(log: AxisLog, axis: str) -> list[_Run]:
    labels = np.full(len(log), "") if log.run is None else np.asarray(log.run).astype(str)
    edges = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1), len(log)]
    found = [
        _Run(log.time_s[i:j], log.commanded(axis)[i:j], log.actual(axis)[i:j], str(labels[i]))
        for i, j in pairwise(edges)
        if j - i >= MIN_SAMPLES
    ]
    if not found:
        raise DataError(f"axis log: got {len(log)} samples, expected a run of {MIN_SAMPLES}")
    return found


def _axis_of(log: AxisLog, axis: str | None) -> str:
    """The axis given, or the linear one of the largest following error."""
    if axis is not None:
        return choose("axis", axis.lower(), log.axes)
    linear = [a for a in log.axes if a in "xyz"] or list(log.axes)
    return max(linear, key=lambda a: float(np.std(log.commanded(a) - log.actual(a))))


def _units(axis: str) -> tuple[str, str, float]:
    """Units of speed and of the following error, and its size in a mm or degree."""
    if axis in "xyz":
        return "mm/min", "µm", 1e3
    return "°/min", "arcsec", float(np.radians(1.0) / ARCSEC)


def plot_axis_log(
    log: AxisLog | Diagnosis,
    *,
    axis: str | None = None,
    servo: Any = None,
    ax: Any = None,
    **style: Any,
) -> Any:
    """Draw an axis of a log: following error over time and speed, reversals, frequency response.

    Parameters
    ----------
    log
        A log, or the diagnosis of one, whose servo model is drawn as well.
    axis
        Letter; the linear axis of the largest following error unless given.
    servo
        Servo, or a set-up with one, whose response is drawn beside that of the data.
    ax
        Axes for the following error over time alone; all in a new figure unless given.
    **style
        As :meth:`trunnion.plot.picture.Picture.draw` takes it.
    """
    pictures = axis_log_pictures(log, axis=axis, servo=servo)
    if ax is not None:
        return pictures[0].draw(ax, **style)
    return panels(pictures, columns=2, size=(6.2, 3.7), **style)


def axis_log_pictures(
    log: AxisLog | Diagnosis, *, axis: str | None = None, servo: Any = None
) -> list[Picture]:
    """Return following error over time and speed, reversals where there are, and the response."""
    data: AxisLog = log.data if isinstance(log, Diagnosis) else log
    if isinstance(log, Diagnosis) and servo is None:
        servo = getattr(log.model, "servo", None)
    letter = _axis_of(data, axis)
    runs = _runs(data, letter)
    model = servo if isinstance(servo, Servo | None) else _servo_of(servo)
    found = [following_picture(runs, letter), speed_picture(runs, letter)]
    zoom = reversal_picture(runs, letter)
    if zoom is not None:
        found.append(zoom)
    response = response_picture(runs, letter, model)
    return found if response is None else [*found, response]


def _servo_of(thing: Any) -> Servo:
    found: Servo = Servo.from_setup(thing) if isinstance(thing, Setup) else thing.servo
    return found


def _per_run(runs: Sequence[_Run]) -> list[tuple[_Run, str, str]]:
    """Each run with its colour and label."""
    return [
        (run, PALETTE[k % len(PALETTE)], run.label or (f"run {k + 1}" if len(runs) > 1 else ""))
        for k, run in enumerate(runs)
    ]


def following_picture(runs: Sequence[_Run], axis: str) -> Picture:
    """Return commanded less actual position over time."""
    _, unit, size = _units(axis)
    series, largest = [], 0.0
    for run, colour, label in _per_run(runs):
        error = size * (run.commanded - run.actual)
        largest = max(largest, float(np.abs(error).max()))
        series.append(line(run.time - run.time[0], error, label, colour=colour, width=1.0))
    return Picture(
        f"{axis.upper()}: following error, largest {largest:.3g} {unit}",
        Axis("Time in the run", "s"),
        Axis("Commanded less actual", unit),
        tuple(series),
        note="Most of it is the lag of the loop at speed, no fault: see the next picture.",
    )


def speed_picture(runs: Sequence[_Run], axis: str) -> Picture:
    """Return the following error over the commanded speed: its slope is 1 / gain."""
    speed_unit, unit, size = _units(axis)
    series: list[Series] = []
    for run, colour, label in _per_run(runs):
        error = size * (run.commanded - run.actual)
        series.append(points(run.speed, error, label, colour=colour, size=3.0, opacity=0.7))
    speed = np.concatenate([run.speed for run in runs])
    error = size * np.concatenate([run.commanded - run.actual for run in runs])
    slope = float(speed @ error / max(speed @ speed, 1e-300))
    ends = np.array([speed.min(), speed.max()])
    gain = size / (60.0 * slope) if slope > 0 else np.inf
    series.append(line(ends, slope * ends, "in proportion to speed", colour=MUTED, dash="dash"))
    said = f": loop gain {gain:.4g} /s" if np.isfinite(gain) else ""
    return Picture(
        f"{axis.upper()}: following error over speed{said}",
        Axis("Commanded speed", speed_unit),
        Axis("Commanded less actual", unit),
        tuple(series),
        note="What leaves the line changes with the sense of motion (friction, backlash), or lags.",
    )


def reversal_picture(runs: Sequence[_Run], axis: str) -> Picture | None:
    """Return the following error about each reversal, less the lag by speed and acceleration.

    Friction and backlash show as a step or a spike at 0. None where the axis does not reverse.
    """
    _, unit, size = _units(axis)
    motion = [np.column_stack([run.speed, np.gradient(run.speed, run.time)]) for run in runs]
    errors = [size * (run.commanded - run.actual) for run in runs]
    lag = np.linalg.lstsq(np.vstack(motion), np.concatenate(errors), rcond=None)[0]
    least = REVERSAL_SHARE * max(float(np.abs(run.speed).max()) for run in runs)
    found: list[tuple[float, Floats, Floats]] = []
    for run, moved, error in zip(runs, motion, errors, strict=True):
        moving = np.flatnonzero(np.abs(run.speed) > least)
        sign = np.sign(run.speed[moving])
        for k in np.flatnonzero(np.diff(sign)):
            middle = (run.time[moving[k]] + run.time[moving[k + 1]]) / 2
            near = np.abs(run.time - middle) <= WINDOW_S
            left = error[near] - moved[near] @ lag
            found.append((float(sign[k + 1]), run.time[near] - middle, left))
    if not found:
        return None
    series: list[Series] = []
    seen: set[float] = set()
    for into, time, left in found[:MAX_REVERSALS]:
        label = "into +" if into > 0 else "into −"
        colour = BLUE if into > 0 else VERMILLION
        shown = "" if into in seen else label
        series.append(line(1e3 * time, left, shown, colour=colour, width=1.2))
        seen.add(into)
    count = len(found)
    return Picture(
        f"{axis.upper()}: {min(count, MAX_REVERSALS)} of {count} reversals",
        Axis("Time from the reversal", "ms"),
        Axis("Following error less lag", unit),
        tuple(series),
        note="The lag in proportion to speed and acceleration is taken off.",
    )


def response_picture(runs: Sequence[_Run], axis: str, servo: Servo | None) -> Picture | None:
    """Return the amplitude of actual over commanded position by frequency, of data and model.

    Only where the command moves the axis enough (coherence above 0.9); None where it does nowhere.
    """
    run = max(runs, key=lambda r: len(r.time))
    data = _response(run, run.actual)
    if len(data[0]) < MIN_BANDS:
        return None
    series = [points(data[0], data[1], "data", colour=BLUE, size=3.0)]
    said = ""
    if servo is not None and axis.upper() in "XYZABC":
        model = _response(run, _simulated(run, axis, servo))
        kept = np.isin(model[0], data[0])
        series.append(line(model[0][kept], model[1][kept], "servo model", colour=VERMILLION))
        both = np.isin(data[0], model[0])
        apart = np.abs(data[1][both] - model[1][kept])
        said = f", data and model within {np.max(apart, initial=0.0):.2g} dB"
    return Picture(
        f"{axis.upper()}: frequency response{said}",
        Axis("Frequency", "Hz", log=True),
        Axis("Actual over commanded", "dB"),
        tuple(series),
        note="Where the command moves the axis: coherence above 0.9.",
    )


def _response(run: _Run, actual: Floats) -> tuple[Floats, Floats]:
    """Frequencies (Hz) and amplitude (dB) of actual over commanded position, by their speeds."""
    from scipy import signal

    u, y = (np.diff(x) for x in (run.commanded, actual))
    count = max(MIN_SAMPLES, len(u) // 4)
    options: dict[str, Any] = {
        "fs": 1.0 / run.period,
        "nperseg": min(count, len(u)),
        "window": WINDOW,
    }
    f, cross = signal.csd(u, y, **options)
    _, power = signal.welch(u, **options)
    _, coherence = signal.coherence(u, y, **options)
    good = (f > 0) & (coherence > MIN_COHERENCE) & (power > MIN_POWER * power.max())
    return f[good], 20 * np.log10(np.abs(cross[good]) / power[good])


def _simulated(run: _Run, axis: str, servo: Servo) -> Floats:
    """Positions that the servo makes of the logged command, in its own control period."""
    letter = axis.upper()
    stride = max(1, round(run.period / (servo.period_ms * 1e-3))) if servo.period_ms else 1
    step = run.period / stride
    fine = np.arange((len(run.time) - 1) * stride + 1) * step
    command = np.interp(fine, run.time - run.time[0], run.commanded)
    row = np.ascontiguousarray(servo.row(letter)[None])
    made = _core.contour_axis_responses(
        letter, row, step, servo.feedback, np.ascontiguousarray(command), stride=stride
    )
    return np.asarray(made[0])
