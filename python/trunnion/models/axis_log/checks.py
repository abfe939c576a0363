"""What an axis log must be before anything is read from it: errors, not causes."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from trunnion.base.errors import DataError, InputError
from trunnion.base.units import Floats, unit_of
from trunnion.contouring.servo import Servo
from trunnion.data.axis_log import AxisLog
from trunnion.data.mistaken import factors
from trunnion.models.axis_log.signals import TIP_COLUMNS, AxisSignal
from trunnion.models.axis_log.steps import rounded_in

MAX_PERIOD_GAIN = 2.0  # time between samples, times the loop gain
MIN_MOTION = 0.01  # rms motion from which on it is checked, mm or deg
MAX_UNCOMMANDED = 0.2  # of the motion, that goes otherwise than commanded
TINY = 1e-300
SAME_UNIT = 0.05  # what a servo with another gain makes of a ratio of units
MIN_ERROR = 1.0  # following error from which on the reference is checked, µm or arcsec
MAX_AGREEMENT = 1e-3  # of the following error that the servo model says
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
                    f"time_s is in s{_steps_said(signal)}"
                )


def check_axis(signal: AxisSignal) -> None:
    """Check that positions of an axis can say something of its servo.

    Raises DataError: see the checks.
    """
    check_resolution(signal)
    check_motion(signal)
    check_reference(signal)


def check_resolution(signal: AxisSignal) -> None:
    """Check that positions are recorded finely enough.

    Raises DataError: in steps that are larger than what the axis is away from its command.
    """
    unit, name = signal.units.large, signal.letter.lower()
    error = float(np.std(signal.commanded - signal.actual))
    for what, values in (("act", signal.actual), ("cmd", signal.commanded)):
        step = rounded_in(values, 0.0)
        if step > error > 0.0 and len(np.unique(signal.commanded)) > 1:
            raise DataError(
                f"axis log, {name}_{what}_{unit}: got positions in steps of {step:.3g} {unit}, "
                f"where actual and commanded ones differ by {error:.3g} {unit} rms: such data do "
                "not tell what the servo does; expected positions with more digits"
            )


def _steps_said(signal: AxisSignal) -> str:
    """Return the other reason why a log says nothing of the servo: its positions are rounded."""
    step, unit = rounded_in(signal.actual, 0.0), signal.units.large
    lag = float(np.std(signal.commanded - signal.actual))
    if step <= lag:
        return ""
    return (
        f". And {signal.letter.lower()}_act_{unit} is in steps of {step:.3g} {unit}, more than the "
        f"axis is away from its command ({lag:.2g} {unit}): gain, friction and backlash cannot be "
        "distinguished from it"
    )


def check_motion(signal: AxisSignal) -> None:
    """Check that an axis goes where it is commanded, as far and not earlier.

    Raises DataError: actual positions that move less than half or more than twice as far as the
        servo model says (another unit), the other way (another sense), or otherwise (another
        axis); or that are ahead of the commanded ones (columns exchanged).
    """
    unit, name = signal.units.large, signal.letter.lower()
    steady = _at_speed(signal)
    actual = _about_means(signal, signal.actual)
    # As recorded, a run begins wherever a mistake puts the axis; at speed, not as it really does.
    models = [_about_means(signal, model) for model in (signal.predicted, steady)]
    if min(float(model @ model) for model in models) < len(actual) * MIN_MOTION**2:
        return  # at rest, or nearly
    off, ratio = min(_off(actual, model) for model in models)
    travels = off <= MAX_UNCOMMANDED * float(np.sqrt(np.mean(actual**2)))
    if asked := _as_errors(signal, steady, off if travels else np.inf):
        raise DataError(f"axis log, {name}_act_{unit}: got {asked}")
    if -2.0 < ratio < -0.5:
        raise DataError(
            f"axis log, {name}_act_{unit}: got motion opposite to {name}_cmd_{unit}, expected the "
            "same sense: change the sign of one of them"
        )
    if not travels:
        raise DataError(
            f"axis log, {name}_act_{unit}: got motion of {off:.3g} {unit} rms that "
            f"{name}_cmd_{unit} does not command: does another axis move what is measured, or are "
            "these columns of different axes?"
        )
    if not 0.5 < ratio < 2.0:
        raise DataError(
            f"axis log, {name}_act_{unit}: got {ratio:.3g} times the motion that the servo model "
            f"says for {name}_cmd_{unit}, expected about 1: both in {unit}, of one axis"
            f"{_unit_said(f'{name}_act_{unit}', ratio)}"
        )
    speed = np.zeros(len(signal.commanded))
    for run in signal.runs:
        speed[run.rows] = np.gradient(signal.commanded[run.rows], run.period_s)
    late_s = float(speed @ (signal.commanded - signal.actual) / (speed @ speed))
    if late_s < -MAX_LEAD / signal.servo.gain_per_s:
        raise DataError(
            f"axis log, {name}_act_{unit}: got positions {-1e3 * late_s:.3g} ms ahead of "
            f"{name}_cmd_{unit}, expected them behind: are the columns exchanged?"
        )


def _at_speed(signal: AxisSignal) -> Floats:
    """Positions, mm or deg, of an axis that is at the speed of its first commands in each run."""
    runs = [(run, signal.commanded[run.rows]) for run in signal.runs]
    speed = np.array([(command[1] - command[0]) / run.period_s for run, command in runs])
    begins = np.column_stack([-speed / signal.nominal.gain_per_s, 1e-3 * speed])
    return replace(signal, starts=signal.units.scale * begins).predicted


def _about_means(signal: AxisSignal, values: Floats) -> Floats:
    """Values by row without their mean in each run."""
    return np.concatenate([values[run.rows] - values[run.rows].mean() for run in signal.runs])


def _off(actual: Floats, model: Floats) -> tuple[float, float]:
    """How far values are off a multiple of those of a model, rms, and the multiple."""
    ratio = float(model @ actual) / max(float(model @ model), TINY)
    return float(np.sqrt(np.mean((actual - ratio * model) ** 2))), ratio


def _as_errors(signal: AxisSignal, steady: Floats, off_position: float) -> str:
    """Ask whether actual positions are following errors; empty: they are not.

    steady: Positions from a start at speed: those as recorded would begin with the errors.
    off_position: How far they are off as positions in whichever unit, rms; infinite: they do not
        travel with the command.
    """
    off, share = _off(signal.actual, signal.commanded - steady)
    units = {signal.units.large: 1.0, signal.units.small_symbol: signal.units.scale}
    near = [unit for unit, factor in units.items() if 0.5 < abs(share) / factor < 2.0]
    # A position may look like its own following error for a while; it is more like the command.
    most = min(off_position, MAX_UNCOMMANDED * float(np.sqrt(np.mean(signal.actual**2))))
    if not near or off > most:
        return ""
    small = signal.letter.lower(), signal.units.large
    command = "{}_cmd_{}".format(*small)
    less = "commanded less actual" if share > 0 else "actual less commanded"
    return (
        f"what the axis is behind {command}, expected its position: are these following errors, "
        f"{less}, in {near[0]}?"
    )


def _unit_said(column: str, ratio: float) -> str:
    """Say which unit makes an axis go so many times as far; empty: none that is known."""
    other_way = " and count the other way" if ratio < 0 else ""
    near = {
        abs(abs(ratio) * factor - 1.0): f"{said} (× {factor:.4g})"
        for said, factor in factors(unit_of(column)).items()
    }
    best = min(near, default=SAME_UNIT)
    if best >= SAME_UNIT:
        return ""
    return f". Likely cause: {column}: its positions {near[best]}{other_way}"


def check_reference(signal: AxisSignal) -> None:
    """Check that commanded and actual positions are two things.

    Raises DataError: they agree far better than a servo follows.
    """
    units, name = signal.units, signal.letter.lower()
    expected = float(np.std(signal.commanded - signal.predicted)) * units.scale
    found = float(np.std(signal.commanded - signal.actual)) * units.scale
    if expected > MIN_ERROR and found < MAX_AGREEMENT * expected:
        raise DataError(
            f"axis log, {name}_act_{units.large}: got positions that agree with "
            f"{name}_cmd_{units.large} within {found:.2g} {units.small_symbol} rms, where the "
            f"servo model says {expected:.3g}: both look like the same counter"
        )


def has_tip(log: AxisLog) -> bool:
    """Whether the log has the tool tip."""
    return TIP_COLUMNS[0] in log.columns
