"""What an axis log must be before anything is read from it: errors, not causes."""

from collections.abc import Iterable

import numpy as np

from trunnion.base.errors import DataError, InputError
from trunnion.contouring.servo import Servo
from trunnion.data.axis_log import AxisLog
from trunnion.models.axis_log.signals import TIP_COLUMNS, AxisSignal

MAX_PERIOD_GAIN = 2.0  # time between samples, times the loop gain
MIN_MOTION = 0.01  # rms motion from which on it is checked, mm or deg
MAX_LEAD = 0.25  # time by which an axis may be ahead of its command, times the loop gain


def check_servo(letters: Iterable[str], servo: Servo) -> None:
    """Check that the set-up has the servo parameters of every axis of the log.

    Raises InputError: an axis has none.
    """
    missing = [letter for letter in letters if letter not in servo.axes]
    if missing:
        raise InputError(
            f"set-up: [servo.{missing[0]}]: got no such table, expected gain_per_s and "
            f"time_constant_ms of every axis of the log ({', '.join(letters)})"
        )


def check_loops(signals: Iterable[AxisSignal], servo: Servo) -> None:
    """Check that every loop is stable and that the samples are close enough to see it.

    Raises DataError, InputError: samples further apart than `MAX_PERIOD_GAIN` over the loop gain;
        an unstable loop.
    """
    for signal in signals:
        gain, tau = signal.servo.gain_per_s, signal.servo.time_constant_ms
        for run in signal.runs:
            unstable = float(np.abs(np.linalg.eigvals(signal.step(run))).max()) >= 1.0
            if unstable and servo.period_ms is not None:
                raise InputError(
                    f"set-up: servo.{signal.letter}: got gain_per_s = {gain:g} and "
                    f"time_constant_ms = {tau:g}, expected a loop that is stable at a control "
                    f"period of {run.control_s * 1e3:.6g} ms"
                )
            if unstable or run.period_s * gain > MAX_PERIOD_GAIN:
                raise DataError(
                    f"axis log, row {run.rows.start}: got samples every {run.period_s * 1e3:.6g} "
                    f"ms, expected at most {1e3 * MAX_PERIOD_GAIN / gain:.3g} ms "
                    f"({MAX_PERIOD_GAIN:g} over the loop gain {gain:g} 1/s of {signal.letter}); "
                    "time_s is in s"
                )


def check_motion(signal: AxisSignal) -> None:
    """Check that an axis goes where it is commanded, as far and not earlier.

    Raises DataError: actual positions that move less than half or more than twice as far as the
        servo model says (another unit), or that are ahead of the commanded ones (columns
        exchanged).
    """
    unit, name = signal.units.large, signal.letter.lower()
    actual, model = signal.actual.copy(), signal.predicted.copy()
    speed = np.empty(len(model))
    for run in signal.runs:
        for values in (actual, model):
            values[run.rows] -= values[run.rows].mean()
        speed[run.rows] = np.gradient(signal.commanded[run.rows], run.period_s)
    if float(model @ model) < len(model) * MIN_MOTION**2:
        return  # at rest, or nearly
    ratio = float(model @ actual / (model @ model))
    if not 0.5 < ratio < 2.0:
        raise DataError(
            f"axis log, {name}_act_{unit}: got {ratio:.3g} times the motion that the servo model "
            f"says for {name}_cmd_{unit}, expected about 1: both in {unit}, of one axis"
        )
    late_s = float(speed @ (signal.commanded - signal.actual) / (speed @ speed))
    if late_s < -MAX_LEAD / signal.servo.gain_per_s:
        raise DataError(
            f"axis log, {name}_act_{unit}: got positions {-1e3 * late_s:.3g} ms ahead of "
            f"{name}_cmd_{unit}, expected them behind: are the columns exchanged?"
        )


def has_tip(log: AxisLog) -> bool:
    """Whether the log has the tool tip.

    Raises DataError: some of its three columns only, or a value that is not a finite number.
    """
    there = [name for name in TIP_COLUMNS if name in log.extra]
    if there and len(there) < len(TIP_COLUMNS):
        every = ", ".join(TIP_COLUMNS)
        raise DataError(f"axis log: got {', '.join(there)}, expected all of {every}")
    for name in there:
        for row, value in enumerate(log.extra[name]):
            try:
                good = bool(np.isfinite(float(value)))
            except ValueError:
                good = False
            if not good:
                got = f"got {str(value)!r}, expected a finite number"
                raise DataError(f"axis log, {name}, {log.place(row)}: {got}")
    return bool(there)
