"""Axis logs on the diagnosis engine: what in the servo model is wrong.

A reading is an actual axis position less what the servo model of the set-up's ``[servo]`` table
says for the commanded positions, in µm or arcsec. Axes are taken as controlled independently: in a
cross-coupled control the commands to log are those that the position loops get.

Readings are means over blocks of samples (as many as keep some thousand readings), predictions
likewise. Noise is divided out axis by axis and, where what no servo effect can make is
autocorrelated, whitened by an autoregression.

The response of an axis is simulated exactly (:mod:`trunnion.contouring`), and is not linear in most
parameters. Each effect's column is therefore a chord: the exact change of the response divided by
the parameter, at the value where this effect alone fits the log best. A single effect is thus
compared and sized without any linearisation; of several on one axis, what one does to the other's
column is left out, which is of second order (1 % of gain with 0.3 ms of time constant: 0.05 µm).

Where two effects look alike:

- e = v/K + a (τ/K - 1/K²): a gain mismatch goes with the velocity, a time-constant mismatch with
  the acceleration; a delay in the loop is like a time constant, a stiff structure likewise;
- a delay of the log is a gain mismatch of one axis, and told apart by showing in all axes;
- backlash and Coulomb friction both lie on the side that the axis comes from, and differ at
  reversals only; at one feed a gain mismatch is like backlash: log two feeds;
- a rotary axis out of place shows nothing in an axis log. With the tool tip measured in the table's
  frame (columns ``tip_x_mm``, ``tip_y_mm``, ``tip_z_mm``) it does.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise, product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares, minimize, minimize_scalar
from scipy.special import chdtri

import trunnion._core as _core
from trunnion.base.errors import DataError, InputError
from trunnion.contouring.servo import ROTARY, Axis, Servo
from trunnion.data.axis_log import AxisLog
from trunnion.diagnosis.effect import (
    Effect,
    EffectLike,
    EffectValues,
    Parameter,
    for_compensation,
    gridded,
    linear,
    with_own,
)
from trunnion.diagnosis.engine import NAMELESS
from trunnion.diagnosis.model import BaseModel, Covariate, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.scan import SCAN_LEVEL, Dictionary
from trunnion.machine.estimate import Estimate
from trunnion.setup import Setup

__all__ = ["AxisLogModel", "ExtendedServo"]

Array: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.intp]

MOST_READINGS = 4500
LINEAR_PITCHES_MM = tuple(float(v) for v in np.geomspace(1.5, 60.0, 90))
ROTARY_PITCHES_DEG = tuple(float(v) for v in np.geomspace(0.5, 90.0, 110))
RESONANCES_HZ = tuple(float(v) for v in np.geomspace(15.0, 150.0, 48))
DAMPINGS = (0.03, 0.08, 0.2)
MOST_ORDER = 6
MOST_STRUCTURE = 4
TRIED = 2
SAFE = 1.0  # σ by which an estimated memory of the noise is taken longer
TIPS = ("tip_x_mm", "tip_y_mm", "tip_z_mm")
MOST_SUBSTEPS = 100
SLOWEST = 2.0  # samples apart, times the loop gain
SHORTEST = 0.01  # rms motion from which on it is checked, mm or deg
SMALLEST_NOISE = 1e-6  # µm, arcsec: a simulated log has rounding only
SCALE = {"mm": 1e3, "deg": 3600.0}
OF_THE_SERVO = "it depends on how the axes move, or has no motion(pose, values)"


@dataclass(frozen=True)
class _Run:
    """Rows of one run, evenly sampled."""

    rows: slice
    period_s: float
    substeps: int  # control periods between two samples

    @property
    def control_s(self) -> float:
        """Control period."""
        return self.period_s / self.substeps

    @property
    def count(self) -> int:
        return int(self.rows.stop - self.rows.start)


@dataclass(frozen=True, eq=False, kw_only=True)
class ExtendedServo(Estimate):
    """The servo model with what a diagnosis found.

    Attributes
    ----------
    servo:
        Gain, time constant, delay, friction, backlash, cyclic error of each axis as found.
        Offsets of the rotary axes (`rotary_centre`) are location errors, in `errors`.
    """

    servo: Servo


def _names(axis: str) -> tuple[str, str]:
    """Unit at the face and suffix of small quantities."""
    return ("deg", "arcsec") if axis.upper() in ROTARY else ("mm", "um")


class AxisLogModel(BaseModel):
    """Servo model of an axis log; see the module.

    Parameters
    ----------
    log:
        One run a feed, two or more for gain and backlash to be told apart.
    setup:
        With a ``[servo]`` table that has every axis of the log.
    effects:
        A user's own effects; ``change(log, values)`` gives the change of each sample of each axis
        in µm or arcsec, shape (rows, axes).
    chords:
        Values at which the effects' columns are taken; by default those of this log.
    """

    def __init__(
        self,
        log: AxisLog,
        setup: Setup,
        effects: Sequence[EffectLike | str] = (),
        *,
        chords: Mapping[str, float] | None = None,
        block: int | None = None,
    ) -> None:
        self.data = log
        self.setup = setup
        self._own = tuple(effects)
        self.servo = Servo.from_table(setup.servo)
        self.axes = tuple(letter.upper() for letter in log.axes)
        missing = [a for a in self.axes if a not in self.servo.axes]
        if missing:
            raise InputError(
                f"set-up: [servo.{missing[0]}] is missing; gain_per_s and time_constant_ms of "
                f"every axis of the log ({', '.join(self.axes)}) are wanted"
            )
        self.runs = _runs(log, self.servo)
        total = len(log) * len(self.axes)
        self.block = block or max(1, -(-total // MOST_READINGS))
        self._index()
        self._check_loops()
        self._motor = {a: self._response(a, self.servo.row(a)) for a in self.axes}
        self._predicted = self._motor  # at the load: the set-up may know of backlash and the like
        self._check_motion()
        self.has_tip = self._tip_is_there()
        self._build(chords or {})

    # --- what the engine asks

    def base(self, nuisance: Array) -> Array:
        """Return the deviation from the servo model that initial states make."""
        return self._design @ nuisance

    def base_jacobian(self, nuisance: Array) -> Array:  # noqa: ARG002
        """Free response of each axis of each run, from position and velocity at its start."""
        return self._design

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Axis, run, commanded motion and time."""
        out = [
            Covariate("axis", self._channel_of, classes=True),
            Covariate("time", self._mean_rows(self._row_time()), "s", sequence=True),
            Covariate("commanded speed of the axis", self._kinematic(1), "face units/s"),
            Covariate("commanded acceleration of the axis", self._kinematic(2), "face units/s²"),
            Covariate("sense of travel", np.sign(self._kinematic(1)), classes=True),
            Covariate("position of the axis", self._kinematic(0), "face units"),
        ]
        if len(self.runs) > 1:
            out.append(Covariate("run", self._run_of, classes=True))
        return tuple(out)

    @property
    def components(self) -> Mapping[str, Array]:
        """Each axis by itself."""
        return {
            name: (self._channel_of == i).astype(np.float64)
            for i, name in enumerate(self._channels)
        }

    @property
    def _channels(self) -> tuple[str, ...]:
        """Names of what is read, in the order of the readings."""
        return (*self.axes, *(TIPS if self.has_tip else ()))

    @property
    def single_faults(self) -> bool:
        """An encoder has no false readings; an axis that is off is not a heap of them."""
        return False

    @property
    def groups(self) -> IntArray:
        """Runs (feeds); of a single run five blocks of time."""
        return self._groups

    def whitener(self, residuals: Array) -> Callable[[Array], Array]:
        """Divide by the noise of each axis, after an autoregression where the noise has one.

        Both come from what is left when every effect of the axis is fitted at once, so that an
        effect is not mistaken for noise; what the fit takes of the noise is allowed for. Where the
        rest has a memory, structure without a name is fitted too if that says more than the memory:
        a jump or a wave is not noise.
        """
        fixed, sought = self._taken()
        terms: dict[str, list[Array]] | None = None
        filters: list[tuple[IntArray, _Noise]] = []
        for channel in np.unique(self._channel_of):
            own = np.flatnonzero(self._channel_of == channel)
            segments = [np.flatnonzero(self._groups[own] == g) for g in np.unique(self._groups)]
            segments = [s for s in segments if len(s)]
            y, some = residuals[own], [x[:, own] for x in sought if np.any(x[:, own])]
            noise = _noise(y, _absorbed(y, fixed[own], some, _Noise(), segments), segments)
            if len(noise.sizes) > 1:  # of noise with a memory another place may fit best
                q = _absorbed(y, fixed[own], some, noise, segments)
                terms = self._terms() if terms is None else terms
                nameless = [x[own] for x in terms[self._channels[channel]]]
                noise = _with_structure(y, q, segments, nameless)
            filters += [(own[s], noise) for s in segments]

        def apply(values: Array) -> Array:
            flat = values.reshape(len(values), -1)
            out = np.empty_like(flat, dtype=np.float64)
            for rows, noise in filters:
                out[rows] = noise.whiten(flat[rows])
            return out.reshape(values.shape)

        return apply

    def bind(self, data: AxisLog) -> "AxisLogModel":
        """Return the same model, with the same columns, on another log."""
        return AxisLogModel(data, self.setup, self._own, chords=self._chords)

    def extended(
        self,
        nuisance: Array,  # noqa: ARG002
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedServo:
        """Return the servo model with the causes in it."""
        from dataclasses import replace

        axes = dict(self.servo.axes)
        for name, values in effects.items():
            kind, _, letter = name.rpartition("_")
            letter = letter.upper()
            if letter in axes and kind in _SERVO_CHANGE:
                axes[letter] = _changed(axes[letter], kind, values)
        found = {k: dict(v) for k, v in effects.items()}
        fields = {} if uncertainty is None else uncertainty.fields()
        std_errors = fields.setdefault("std_errors", {})
        known, errors = self.setup.machine.errors, {}
        for name, value in found.pop("rotary_centre", {}).items():
            error = name.removesuffix("_um")
            errors[error] = known.get(error, 0.0) + value
            std_errors[error] = std_errors.pop(f"rotary_centre.{name}", 0.0)
        return ExtendedServo(
            servo=replace(self.servo, axes=axes),
            errors=errors,
            effects=found,
            **fields,
            **for_compensation(self.effects, found, (), OF_THE_SERVO),
        )

    # --- readings

    def _index(self) -> None:
        """Blocks of samples, and which axis, run and group each reading belongs to."""
        starts: list[int] = []
        run_of: list[int] = []
        for i, run in enumerate(self.runs):
            count = run.count // self.block
            starts += [run.rows.start + self.block * j for j in range(count)]
            run_of += [i] * count
        self._starts = np.asarray(starts, dtype=np.intp)
        per = np.asarray(run_of, dtype=np.intp)
        channels = len(self.axes) + (3 if all(t in self.data.extra for t in TIPS) else 0)
        self._channel_of = np.repeat(np.arange(channels), len(per))
        self._run_of = np.tile(per, channels)
        if len(self.runs) > 1:
            self._groups = self._run_of.copy()
        else:
            blocks = np.arange(len(per)) * 5 // max(len(per), 1)
            self._groups = np.tile(blocks, channels).astype(np.intp)

    def _mean(self, values: Array) -> Array:
        """Means over blocks of values by row, shape (rows, ...)."""
        at = self._starts[:, None] + np.arange(self.block)
        return np.asarray(values[at].mean(axis=1))

    def _mean_rows(self, values: Array) -> Array:
        """Means by row, repeated for every axis."""
        return np.tile(self._mean(values), int(self._channel_of.max()) + 1)

    def _row_time(self) -> Array:
        out = np.array(self.data.time_s, dtype=np.float64)
        for run in self.runs:
            out[run.rows] -= out[run.rows][0]
        return out

    def _at(self, axis: str, values: Array) -> Array:
        """Means of one axis's values in the place of its readings; zero for the others."""
        out = np.zeros((len(self._channel_of), *values.shape[1:]))
        out[self._channel_of == self.axes.index(axis)] = self._mean(values)
        return out

    def _kinematic(self, order: int) -> Array:
        """Commanded position, speed or acceleration of each reading's axis."""
        parts = []
        for axis in self.axes:
            values = np.array(self.data.commanded(axis.lower()), dtype=np.float64)
            for run in self.runs:
                piece = values[run.rows]
                for _ in range(order):
                    piece = np.gradient(piece, run.period_s)
                values[run.rows] = piece
            parts.append(self._mean(values))
        if self.has_tip:
            parts += [np.zeros(len(self._starts))] * 3
        return np.concatenate(parts)

    # --- the servo model

    def _response(self, axis: str, row: Array, feedback: str | None = None) -> Array:
        """Load position of an axis with these parameters, every row, mm or deg."""
        command = self.data.commanded(axis.lower())
        return self._follow(axis, row, feedback or self.servo.feedback, command)

    def _follow(self, axis: str, row: Array, feedback: str, command: Array) -> Array:
        """Load positions for commands by row; between rows the command is a cubic spline."""
        out = np.empty(len(command))
        for run in self.runs:
            values = np.ascontiguousarray(command[run.rows], dtype=np.float64)
            if run.substeps > 1:
                n = np.arange(len(values))
                fine = np.arange((len(values) - 1) * run.substeps + 1) / run.substeps
                values = CubicSpline(n, values)(fine)
            load = _core.contour_axis_response(
                axis, row, run.control_s, feedback, np.asarray(values)
            )
            out[run.rows] = load[:: run.substeps]
        return out

    def _change(self, axis: str, kind: str, value: float) -> Array:
        """Exact change of an axis's response (µm, arcsec) for a change of a parameter, by row."""
        row = self.servo.row(axis)
        row[_SERVO_CHANGE[kind]] += value * (0.01 * row[0] if kind == "gain" else 1.0)
        if kind == "friction":
            row[3] = max(row[3], row[2])
        scale = SCALE[_names(axis)[0]]
        return scale * (self._response(axis, row) - self._predicted[axis])

    def _check_loops(self) -> None:
        """Check that every loop is stable and that the samples are close enough to see it.

        Raises
        ------
        DataError, InputError
            Samples further apart than `SLOWEST` over the loop gain; an unstable loop.
        """
        for axis, run in product(self.axes, self.runs):
            gain, tau = self.servo.row(axis)[:2]
            wild = float(np.abs(np.linalg.eigvals(self._step(axis, run))).max()) >= 1.0
            if wild and self.servo.period_ms is not None:
                raise InputError(
                    f"set-up: servo.{axis}: got gain_per_s = {gain:g} and time_constant_ms = "
                    f"{tau:g}, wanted a loop that is stable at a control period of "
                    f"{run.control_s * 1e3:.6g} ms"
                )
            if wild or run.period_s * gain > SLOWEST:
                raise DataError(
                    f"axis log, row {run.rows.start}: got samples every {run.period_s * 1e3:.6g} "
                    f"ms, wanted at most {1e3 * SLOWEST / gain:.3g} ms ({SLOWEST:g} over the loop "
                    f"gain {gain:g} 1/s of {axis}); time_s is in s"
                )

    def _tip_is_there(self) -> bool:
        """Whether the log has the tool tip.

        Raises
        ------
        DataError
            Some of its three columns only, or what is no finite number.
        """
        there = [t for t in TIPS if t in self.data.extra]
        if there and len(there) < len(TIPS):
            raise DataError(f"axis log: got {', '.join(there)}, wanted all of {', '.join(TIPS)}")
        for name in there:
            for row, value in enumerate(self.data.extra[name]):
                try:
                    good = bool(np.isfinite(float(value)))
                except ValueError:
                    good = False
                if not good:
                    got = f"got {str(value)!r}, wanted a finite number"
                    raise DataError(f"axis log, {name}, row {row}: {got}")
        return bool(there)

    def _check_motion(self) -> None:
        """Check that each axis goes where it is told, as far and not earlier.

        Raises
        ------
        DataError
            Actual positions that move less than half or more than twice as far as the servo model
            says (another unit), or that are ahead of the commanded ones (columns exchanged).
        """
        for axis in self.axes:
            face, name = _names(axis)[0], axis.lower()
            actual = np.array(self.data.actual(name), dtype=np.float64)
            command = np.array(self.data.commanded(name), dtype=np.float64)
            model = np.array(self._predicted[axis])
            speed = np.empty(len(model))
            for run in self.runs:
                for values in (actual, model):
                    values[run.rows] -= values[run.rows].mean()
                speed[run.rows] = np.gradient(command[run.rows], run.period_s)
            if float(model @ model) < len(model) * SHORTEST**2:
                continue  # at rest, or nearly
            ratio = float(model @ actual / (model @ model))
            if not 0.5 < ratio < 2.0:
                raise DataError(
                    f"axis log, {name}_act_{face}: got {ratio:.3g} times the motion that the servo "
                    f"model says for {name}_cmd_{face}, wanted about 1: both in {face}, of one axis"
                )
            lag = command - np.asarray(self.data.actual(name))
            late_s = float(speed @ lag / (speed @ speed))
            if late_s < -0.25 / self.servo.row(axis)[0]:
                raise DataError(
                    f"axis log, {name}_act_{face}: got positions {-1e3 * late_s:.3g} ms ahead of "
                    f"{name}_cmd_{face}, wanted them behind: are the columns exchanged?"
                )

    def _step(self, axis: str, run: _Run) -> Array:
        """Position and velocity a control period later, commanded to 0, by those before: (2, 2)."""
        gain, tau = self.servo.row(axis)[:2] * [1.0, 1e-3]
        e = float(np.exp(-run.control_s / tau)) if tau > 0 else 0.0
        g = tau * (1 - e)
        return np.array([[1 - gain * (run.control_s - g), g], [-gain * (1 - e), e]])

    def _free(self, axis: str) -> Array:
        """Free response of an axis to 1 µm (arcsec) and 1 µm a ms at the start, (rows, 2)."""
        out = np.empty((len(self.data), 2))
        for run in self.runs:
            poles, vectors = np.linalg.eig(self._step(axis, run).astype(complex))
            powers = poles ** (run.substeps * np.arange(run.count))[:, None]
            first = vectors[0] * powers
            out[run.rows] = np.real(first @ np.linalg.inv(vectors)) * [1.0, 1e3]
        return out

    def _earlier(self, axis: str, delay_ms: float) -> Array:
        """Change of the log if it shows positions of so much earlier, µm or arcsec, by row."""
        out = np.empty(len(self.data))
        scale = SCALE[_names(axis)[0]]
        for run in self.runs:
            y = self._predicted[axis][run.rows]
            t = np.arange(run.count) * run.period_s
            shifted = np.clip(t - delay_ms * 1e-3, 0.0, None)
            spline = CubicSpline(t, y)
            inside = np.minimum(shifted, t[-1])
            beyond = (shifted - inside) * (y[-1] - y[-2]) / run.period_s
            out[run.rows] = scale * (spline(inside) + beyond - y)
        return out

    def _sense(self, axis: str) -> tuple[Array, Array]:
        """Sense of travel and speed of the modelled motion by row; rest keeps the last sense."""
        sense, speed = np.zeros(len(self.data)), np.zeros(len(self.data))
        for run in self.runs:
            v = np.gradient(self._predicted[axis][run.rows], run.period_s)
            s = np.sign(np.where(np.abs(v) < 1e-6 * np.abs(v).max(initial=1e-30), 0.0, v))
            kept = np.maximum.accumulate(np.where(s != 0, np.arange(len(s)), 0))
            sense[run.rows], speed[run.rows] = s[kept], np.abs(v)
        return sense, speed

    def _through_loop(self, axis: str, disturbance: Array) -> Array:
        """What the closed loop makes of a position disturbance at the command: linear response."""
        row = np.zeros(13)
        row[:2], row[12] = self.servo.row(axis)[:2], np.inf
        return self._follow(axis, row, "motor", disturbance)

    # --- building

    def _build(self, chords: Mapping[str, float]) -> None:
        deviations = []
        unit = []
        for axis in self.axes:
            face, small = _names(axis)
            actual = np.asarray(self.data.actual(axis.lower()), dtype=np.float64)
            deviations.append(self._mean(SCALE[face] * (actual - self._predicted[axis])))
            unit += ["arcsec" if small == "arcsec" else "µm"] * len(self._starts)
        if self.has_tip:
            deviations += list((1e3 * self._mean(self._tip_deviation())).T)
            unit += ["µm"] * (3 * len(self._starts))
        values = np.concatenate(deviations)
        channels = int(self._channel_of.max()) + 1
        rows = np.tile(self._starts + self.block // 2, channels)
        self.readings = Readings(values, rows, tuple(unit))

        columns, nuisance = [], []
        for axis in self.axes:
            free = self._at(axis, self._free(axis))
            suffix = _names(axis)[1]
            for i, run in enumerate(self.runs):
                mask = (self._run_of == i)[:, None]
                columns.append(np.where(mask, free, 0.0))
                label = self._label(run)
                nuisance.append(Nuisance(f"{axis}{label}_start_{suffix}", suffix))
                nuisance.append(Nuisance(f"{axis}{label}_start_speed", f"{suffix}/ms"))
        self._design = np.concatenate(columns, axis=1)
        self.nuisance = tuple(nuisance)

        self._chords = dict(chords)
        made: list[Effect] = []
        for axis in self.axes:
            made += self._effects_of(axis)
        made.append(self._log_delay())
        if self.has_tip:
            made.append(self._rotary_centre())
        effects = with_own(made, self._own, self.data)
        self.effects = (*made, *(self._foreign(e) for e in effects[len(made) :]))

    def _label(self, run: _Run) -> str:
        if self.data.run is None or len(self.runs) == 1:
            return ""
        return f"_{self.data.run[run.rows.start]}"

    def _chord(self, name: str, start: float, change: Callable[[float], Array]) -> Array:
        """Column of an effect: its exact change over its parameter, where it alone fits best.

        ``change(value)``: change of the readings. Secant steps from ``start``.
        """
        given = self._chords.get(name)
        value = start if given is None else given
        q, _ = np.linalg.qr(self._design)
        y = self.readings.values - q @ (q.T @ self.readings.values)
        column = change(value) / value
        for _ in range(0 if given is not None else 4):
            seen = column - q @ (q.T @ column)
            size = float(seen @ seen)
            if size <= 1e-18 * len(seen):
                break
            best = float(y @ seen) / size
            # A parameter that cannot be negative is chorded at its size: the change is odd.
            odd = abs(best) if name.split("_")[0] in ("loop", "friction", "backlash") else best
            low, high = 0.02 * abs(start), 50.0 * abs(start)
            next_value = float(np.copysign(np.clip(abs(odd), low, high), odd if odd else start))
            if abs(next_value - value) <= 1e-3 * abs(value):
                break
            value = next_value
            column = change(value) / value
        self._chords[name] = value
        return column

    def _servo_effect(
        self, axis: str, kind: str, parameter: Parameter, start: float, words: str
    ) -> Effect:
        name = f"{kind}_{axis.lower()}"
        column = self._chord(name, start, lambda v: self._at(axis, self._change(axis, kind, v)))
        return linear(name, (parameter,), column[:, None], words)

    def _effects_of(self, axis: str) -> list[Effect]:
        face, small = _names(axis)
        known = self.servo.axes[axis]
        who = f"the {axis} axis"
        ends = axis.lower()
        effects = [
            self._servo_effect(
                axis,
                "gain",
                Parameter("gain_percent", unit="%"),
                1.0,
                f"loop gain of {who}",
            ),
            self._servo_effect(
                axis,
                "time_constant",
                Parameter("time_constant_ms"),
                max(0.02 * known.time_constant_ms, 0.02),
                f"time constant of {who}",
            ),
            self._servo_effect(
                axis,
                "loop_delay",
                Parameter("delay_ms"),
                0.1,
                f"delay in the loop of {who}",
            ),
            self._servo_effect(
                axis,
                "backlash",
                Parameter(f"backlash_{small}"),
                1.0,
                f"backlash of {who}",
            ),
        ]
        sense, speed = self._sense(axis)
        coulomb = self._chord(
            f"friction_{ends}",
            1.0,
            lambda v: self._at(axis, self._change(axis, "friction", v)),
        )
        top = float(np.quantile(speed, 0.9)) if len(speed) else 0.0
        peaks = tuple(float(v) for v in np.geomspace(0.01, 0.3, 6) * max(top, 1e-9))
        unit = "mm" if small == "um" else "deg"
        fading = f"speed_{unit}_s"

        def spike(v_s: float) -> Array:
            bump = sense * np.exp(-((speed / v_s) ** 2))
            return self._at(axis, -self._through_loop(axis, bump))

        effects.append(
            gridded(
                f"friction_{ends}",
                (
                    Parameter(f"coulomb_{small}"),
                    Parameter(f"stribeck_{small}"),
                    Parameter(fading, unit=f"{unit}/s", grid=peaks, bounds=(1e-9, np.inf)),
                ),
                lambda v: np.stack([coulomb, spike(v[fading])], axis=1),
                f"friction of {who}",
            )
        )
        motor = self._predicted[axis]
        span = float(np.ptp(motor)) if len(motor) else 0.0
        pitches = LINEAR_PITCHES_MM if small == "um" else ROTARY_PITCHES_DEG
        # Over less than a tenth of a turn a cyclic error is a straight line.
        seen = tuple(p for p in pitches if p <= max(10.0 * span, pitches[2]))

        def cyclic(pitch: float) -> Array:
            angle = 2 * np.pi * motor / pitch
            return self._at(axis, np.stack([np.cos(angle), np.sin(angle)], axis=1))

        seen = tuple(sorted({*seen, self._pitch_of(axis, motor, seen)}))
        effects.append(
            gridded(
                f"cyclic_{ends}",
                (
                    Parameter(f"cosine_{small}"),
                    Parameter(f"sine_{small}"),
                    Parameter(f"pitch_{face}", grid=seen, bounds=(0.5 * seen[0], 2 * seen[-1])),
                ),
                lambda v: cyclic(v[f"pitch_{face}"]),
                f"cyclic error of {who}",
            )
        )
        scale = SCALE[face]

        def resonance(frequency: float, damping: float) -> Array:
            row = self.servo.row(axis)
            row[10], row[11] = frequency, damping
            return self._at(axis, (scale * (self._response(axis, row, "motor") - motor))[:, None])

        nyquist = 0.5 / min(run.period_s for run in self.runs)
        frequency, damping = self._resonance_of(axis, resonance, 0.8 * nyquist)
        near = (0.97, 1.0, 1.03)
        effects.append(
            gridded(
                f"resonance_{ends}",
                (
                    Parameter("share", unit="1", bounds=(0.0, 1.5)),
                    Parameter(
                        "frequency_hz",
                        unit="Hz",
                        grid=tuple(frequency * k for k in near),
                        bounds=(2.0, nyquist),
                    ),
                    Parameter(
                        "damping",
                        unit="1",
                        grid=tuple(min(damping * k, 0.9) for k in (0.8, 1.0, 1.25)),
                        bounds=(1e-3, 0.9),
                    ),
                ),
                lambda v: resonance(v["frequency_hz"], v["damping"]),
                f"resonance of the structure of {who}",
            )
        )
        return effects

    def _pitch_of(self, axis: str, motor: Array, pitches: Sequence[float]) -> float:
        """Pitch at which a cyclic error alone fits best.

        The grid is close enough to find the valley, not for its bottom: what a large error leaves
        there would be named as another cause.
        """
        name = f"cyclic_{axis.lower()}_pitch"
        if name in self._chords:
            return self._chords[name]
        own = self._channel_of == self.axes.index(axis)
        design = self._design[own]
        q, _ = np.linalg.qr(design[:, np.any(design != 0, axis=0)])
        y = self.readings.values[own] - q @ (q.T @ self.readings.values[own])

        def gain(pitch: float) -> float:
            angle = 2 * np.pi * motor / pitch
            x = self._mean(np.stack([np.cos(angle), np.sin(angle)], axis=1))
            basis, sizes, _ = np.linalg.svd(x - q @ (q.T @ x), full_matrices=False)
            kept = basis[:, sizes > 1e-6 * max(float(sizes[0]), 1e-300)]
            return float(np.sum((kept.T @ y) ** 2))

        best = int(np.argmax([gain(p) for p in pitches]))
        low, high = pitches[max(best - 1, 0)], pitches[min(best + 1, len(pitches) - 1)]
        found = minimize_scalar(lambda p: -gain(p), bounds=(low, high), method="bounded")
        self._chords[name] = float(found.x)
        return self._chords[name]

    def _resonance_of(
        self, axis: str, column: Callable[[float, float], Array], top_hz: float
    ) -> tuple[float, float]:
        """Frequency and damping at which a structure that carries the whole load fits best.

        A resonance's place is sharp, and with a free share of the load many a wrong frequency fits
        about as well at the start: so it is sought with the whole load, on a grid, then refined.
        """
        name = f"resonance_{axis.lower()}"
        keys = (f"{name}_hz", f"{name}_damping")
        if keys[0] in self._chords:
            return self._chords[keys[0]], self._chords[keys[1]]
        own = self._channel_of == self.axes.index(axis)
        design = self._design[own]
        q, _ = np.linalg.qr(design[:, np.any(design != 0, axis=0)])

        def left(values: Array) -> Array:
            return np.asarray(values - q @ (q.T @ values))

        y = left(self.readings.values[own])

        def miss(place: Array) -> Array:
            frequency, damping = np.exp(place)
            return y - left(column(float(frequency), float(damping))[own, 0])

        grid = [np.log([f, d]) for f in RESONANCES_HZ if f < top_hz for d in DAMPINGS]
        cost = [float(np.sum(miss(g) ** 2)) for g in grid]
        low, high = np.log([2.0, 1e-3]), np.log([1.2 * top_hz, 0.8])
        fits = [
            least_squares(miss, grid[i], bounds=(low, high), diff_step=[1e-4], max_nfev=25)
            for i in np.argsort(cost)[:2]
        ]
        frequency, damping = np.exp(min(fits, key=lambda f: f.cost).x)
        self._chords[keys[0]], self._chords[keys[1]] = float(frequency), float(damping)
        return float(frequency), float(damping)

    def _log_delay(self) -> Effect:
        def change(delay_ms: float) -> Array:
            return sum(
                (self._at(axis, self._earlier(axis, delay_ms)) for axis in self.axes),
                np.zeros(len(self._channel_of)),
            )

        column = self._chord("log_delay", 0.1, change)
        return linear("log_delay", (Parameter("delay_ms"),), column[:, None], "delay of the log")

    # --- tool tip

    def _tip_deviation(self) -> Array:
        """Tool tip measured less that of the actual axis positions, table's frame, mm."""
        measured = np.stack(
            [np.asarray(self.data.extra[t], dtype=np.float64) for t in TIPS], axis=1
        )
        return measured - self._tip({})

    def _tip(self, errors: Mapping[str, float]) -> Array:
        lowered = [a.lower() for a in self.axes]
        if sorted(lowered) != ["a", "c", "x", "y", "z"]:
            raise InputError(
                f"tool tip in the log: got axes {', '.join(self.axes)}, wanted X, Y, Z, A, C"
            )
        known = dict(self.setup.machine.errors)
        for name, value in errors.items():
            known[name] = known.get(name, 0.0) + value
        machine = _core.Machine("trt-ca", 100.0, list(known.items()))
        axes = np.stack([np.asarray(self.data.actual(a)) for a in "xyzac"], axis=1)
        return np.ascontiguousarray(machine.forward(np.ascontiguousarray(axes)))[:, :3]

    def _rotary_centre(self) -> Effect:
        """C and A axis out of place: their four offsets, exact and linear."""
        names = ("EX0C", "EY0C", "EY0A", "EZ0A")
        zero = self._tip({})
        columns = []
        for name in names:
            moved = 1e3 * self._mean(self._tip({name: 1.0}) - zero)
            column = np.zeros(len(self._channel_of))
            column[self._channel_of >= len(self.axes)] = moved.T.ravel()
            columns.append(column)
        return linear(
            "rotary_centre",
            tuple(Parameter(f"{name}_um") for name in names),
            np.stack(columns, axis=1),
            "location of the rotary axes",
        )

    # --- a user's own

    def _foreign(self, effect: Effect) -> Effect:
        """Bring a user's effect, by row and axis, to readings."""

        def change(values: Mapping[str, float]) -> Array:
            raw = np.asarray(effect.change(values), dtype=np.float64)
            wanted = (len(self.data), len(self.axes))
            if raw.shape != wanted:
                raise InputError(
                    f"effect {effect.id}: change has shape {raw.shape}, wanted {wanted}: "
                    "every row and axis, µm or arcsec"
                )
            parts = [self._at(axis, raw[:, i]) for i, axis in enumerate(self.axes)]
            return np.asarray(np.sum(parts, axis=0))

        return dataclasses.replace(effect, change=change, jacobian=None)

    # --- noise

    def _terms(self) -> dict[str, list[Array]]:
        """Structure without a name that each channel may have, the engine's own: columns (n, k)."""
        dictionary = Dictionary(self, np.arange(len(self.readings)))
        return {
            name: [
                dictionary.block(i)
                for i, term in enumerate(dictionary.terms)
                if term.component == name or term.kind == "class"
            ]
            for name in self._channels
        }

    def _taken(self) -> tuple[Array, list[Array]]:
        """Columns that what is not noise may have: (n, k), and (places, n, k) of which one is."""
        fixed = [self._design]
        sought: list[Array] = []
        for effect in self.effects:
            linear = [i for i, p in enumerate(effect.parameters) if p.linear]
            grids = [p.grid or (0.0,) for p in effect.parameters]
            if not effect.id.startswith("cyclic"):
                grids = [(g[len(g) // 2],) for g in grids]
            places = [
                effect.columns(effect.values(map(float, place)))[:, linear]
                for place in product(*grids)
            ]
            if len(places) == 1:
                fixed += places
            else:
                sought.append(np.stack(places))
        return np.concatenate(fixed, axis=1), sought


# Which number of an axis's row a servo effect changes.
_SERVO_CHANGE: dict[str, list[int]] = {
    "gain": [0],
    "time_constant": [1],
    "friction": [2, 3],
    "backlash": [5],
    "loop_delay": [9],
}


def _changed(axis: Axis, kind: str, values: Mapping[str, float]) -> Axis:
    """Return an axis with a servo effect in it."""
    from dataclasses import fields, replace

    names = [f.name for f in fields(axis)]
    amount = float(next(iter(values.values())))
    if kind == "gain":
        amount *= 0.01 * axis.gain_per_s
    new = {names[i]: getattr(axis, names[i]) + amount for i in _SERVO_CHANGE[kind]}
    return replace(axis, **new)


def _runs(log: AxisLog, servo: Servo) -> tuple[_Run, ...]:
    """Runs of a log, each evenly sampled.

    Raises
    ------
    DataError
        A run is shorter than 20 samples or not evenly sampled (1 %).
    """
    n = len(log)
    edges = [0, n]
    if log.run is not None:
        edges = [0, *(np.flatnonzero(log.run[1:] != log.run[:-1]) + 1).tolist(), n]
    runs = []
    for start, stop in pairwise(edges):
        if stop - start < 20:
            raise DataError(
                f"axis log, rows {start} to {stop - 1}: got {stop - start} samples in a run, "
                "wanted at least 20"
            )
        steps = np.diff(log.time_s[start:stop])
        period = float((log.time_s[stop - 1] - log.time_s[start]) / (stop - 1 - start))
        uneven = np.abs(steps - period)
        if uneven.max() > 0.01 * period:
            row = start + 1 + int(np.argmax(uneven))
            raise DataError(
                f"axis log, row {row}: got {steps[row - start - 1]:.6g} s after the row before, "
                f"wanted even sampling ({period:.6g} s within 1 %); give each run its label"
            )
        control = period if servo.period_ms is None else servo.period_ms * 1e-3
        substeps = max(1, round(period / control))
        if substeps > MOST_SUBSTEPS:
            raise DataError(
                f"axis log, row {start}: got samples every {period * 1e3:.6g} ms, wanted at most "
                f"{MOST_SUBSTEPS} times servo.period_ms = {control * 1e3:.6g}"
            )
        if abs(period - substeps * control) > 0.01 * period:
            raise DataError(
                f"axis log, row {start}: sampled every {period * 1e3:.6g} ms, wanted a multiple of "
                f"servo.period_ms = {control * 1e3:.6g}"
            )
        runs.append(_Run(slice(start, stop), period, substeps))
    return tuple(runs)


def _autoregression(series: Sequence[Array]) -> Array:
    """Coefficients of an autoregression, of the order that BIC takes; empty for white noise."""
    n = sum(len(s) for s in series)
    best: Array = np.zeros(0)
    best_cost = np.inf
    for order in range(MOST_ORDER + 1):
        rows = [s[MOST_ORDER:] for s in series if len(s) > 2 * MOST_ORDER]
        if not rows:
            return best
        y = np.concatenate(rows)
        lags = [
            np.stack([s[MOST_ORDER - k : len(s) - k] for k in range(1, order + 1)], axis=1)
            for s in series
            if len(s) > 2 * MOST_ORDER and order
        ]
        if order:
            x = np.concatenate(lags)
            coefficients: Array = np.asarray(np.linalg.lstsq(x, y, rcond=None)[0], np.float64)
            rss = float(np.sum((y - x @ coefficients) ** 2))
        else:
            coefficients, rss = np.zeros(0, dtype=np.float64), float(y @ y)
        cost = len(y) * np.log(max(rss, 1e-300)) + order * np.log(max(n, 2))
        if cost < best_cost - 1e-9:
            best, best_cost = coefficients, cost
    return best


@dataclass(frozen=True)
class _Noise:
    """Autoregressive noise: ``predictors[k]`` foretells a reading from the k before it.

    ``sizes[k]``: what is left then (1 σ); the last pair holds from there on.
    """

    predictors: tuple[Array, ...] = (np.zeros(0),)
    sizes: tuple[float, ...] = (1.0,)

    def whiten(self, values: Array) -> Array:
        """Innovations of (n, m) consecutive values in units of their size."""
        order = min(len(self.predictors) - 1, len(values))
        out = np.array(values, dtype=np.float64)
        for i, ar in enumerate(self.predictors[:order]):
            for k, a in enumerate(ar, start=1):
                out[i : i + 1] -= a * values[i - k : i - k + 1]
            out[i : i + 1] /= self.sizes[i]
        if len(values) > order:
            for k, a in enumerate(self.predictors[-1], start=1):
                out[order:] -= a * values[order - k : len(values) - k]
            out[order:] /= self.sizes[-1]
        return out


def _noise(y: Array, q: Array, segments: Sequence[IntArray]) -> _Noise:
    """Noise of readings y (n,) of which columns q (n, k), orthonormal, may be no noise.

    The order is the one that BIC takes for what q leaves. Its coefficients maximise the restricted
    likelihood (of what no q can change): those of the rest itself would be too small, for q takes
    most of the slow part of the noise.
    """
    rest = y - q @ (q.T @ y)
    start = _autoregression([rest[s] for s in segments])
    order = len(start)
    both = np.concatenate([q, y[:, None]], axis=1)
    count = sum(max(len(s) - order, 0) for s in segments) - q.shape[1]

    def triangle(ar: Array) -> Array:
        white = []
        for s in segments:
            if len(s) <= order:
                continue
            out = both[s][order:].copy()
            for k, a in enumerate(ar, start=1):
                out -= a * both[s][order - k : len(s) - k]
            white.append(out)
        corner = np.asarray(np.linalg.qr(np.concatenate(white), mode="r"), dtype=np.float64)
        return np.asarray(np.abs(np.diag(corner)))

    def cost(z: Array) -> float:
        d = np.maximum(triangle(_levinson(np.tanh(z))[-1]), 1e-300)
        return float(2 * count * np.log(d[-1]) + 2 * np.sum(np.log(d[:-1])))

    partial = np.clip(_partial(start), -0.999, 0.999)
    if order:
        z = np.asarray(minimize(cost, np.arctanh(partial), method="BFGS").x)
        partial = np.tanh(z + SAFE * _longer(cost, z))
    predictors = _levinson(partial)
    size = max(float(triangle(predictors[-1])[-1]) / np.sqrt(max(count, 1)), SMALLEST_NOISE)
    left = np.cumprod((1.0 / np.sqrt(1.0 - np.minimum(partial**2, 1 - 1e-12)))[::-1])[::-1]
    return _Noise(predictors, (*(size * left).tolist(), size))


def _with_structure(
    y: Array, q: Array, segments: Sequence[IntArray], terms: Sequence[Array]
) -> _Noise:
    """Noise of y where structure without a name may be beside q, a term at a time.

    A term is taken if it makes readings likelier than noise with a longer memory does, by the price
    that the engine asks for it.
    """

    def told(basis: Array) -> tuple[float, _Noise]:
        noise = _noise(y, basis, segments)
        both = np.concatenate([basis, y[:, None]], axis=1)
        white = np.concatenate([noise.whiten(both[s])[MOST_ORDER:] for s in segments])
        rest = float(np.abs(np.asarray(np.linalg.qr(white, mode="r"))[-1, -1])) * noise.sizes[-1]
        order = len(noise.sizes) - 1
        return len(white) * 2 * np.log(max(rest, 1e-300)) + order * np.log(len(white)), noise

    score, noise = told(q)
    for _ in range(MOST_STRUCTURE):
        if len(noise.sizes) == 1:
            break
        rest = y - q @ (q.T @ y)
        seen = [x - q @ (q.T @ x) for x in terms]
        own = [_basis(x) if np.any(np.abs(x) > 1e-6) else np.zeros((len(y), 0)) for x in seen]
        gain = [float(np.sum((x.T @ rest) ** 2)) for x in own]
        tried = []
        for i in np.argsort(gain)[::-1][:TRIED]:
            wider = np.concatenate([q, own[i]], axis=1)
            price = float(chdtri(max(own[i].shape[1], 1), SCAN_LEVEL / len(terms))) + NAMELESS
            tried.append((*told(wider), price, wider))
        value, other, price, wider = min(tried, key=lambda t: t[0] + t[2])
        if value + price >= score:
            break
        score, noise, q = value, other, wider
    return noise


def _longer(cost: Callable[[Array], float], z: Array) -> Array:
    """Change of z = artanh of partial autocorrelations that makes the memory longer by 1 σ.

    ``cost``: -2 ln L, least at z. The slow part of the noise goes with Π 1/(1 - tanh z)².
    """
    step = 0.02 * np.eye(len(z))
    middle = cost(z)
    up, down = np.array([[cost(z + s), cost(z - s)] for s in step]).T
    hessian = np.diag(up + down - 2 * middle)
    for i, j in combinations(range(len(z)), 2):
        both = cost(z + step[i] + step[j]) + cost(z - step[i] - step[j])
        hessian[i, j] = hessian[j, i] = (both + 2 * middle - up[i] - down[i] - up[j] - down[j]) / 2
    values, vectors = np.linalg.eigh(hessian / 0.02**2 / 2)
    covariance = (vectors / np.maximum(values, 1.0)) @ vectors.T
    slope = 1.0 + np.tanh(z)
    return np.asarray(covariance @ slope / np.sqrt(slope @ covariance @ slope))


def _levinson(partial: Array) -> tuple[Array, ...]:
    """Coefficients of every order from 0 up, from partial autocorrelations."""
    out: list[Array] = [np.zeros(0)]
    for r in partial:
        out.append(np.append(out[-1] - r * out[-1][::-1], r))
    return tuple(out)


def _partial(ar: Array) -> Array:
    """Partial autocorrelations of an autoregression; of an unstable one, those to where it is."""
    out, a = np.zeros(len(ar)), np.asarray(ar, dtype=np.float64)
    for k in range(len(ar) - 1, -1, -1):
        out[k] = a[k]
        a = (a[:k] + a[k] * a[:k][::-1]) / max(1.0 - a[k] ** 2, 1e-6)
    return out


def _absorbed(
    y: Array,
    fixed: Array,
    sought: Sequence[Array],
    noise: _Noise,
    segments: Sequence[IntArray],
) -> Array:
    """Orthonormal basis of the columns and, of each set of places, the one that fits y best.

    So little of the noise goes with what is not noise. ``noise``: what is known of it.
    """

    def white(columns: Array) -> Array:
        return np.concatenate([noise.whiten(columns[s]) for s in segments])

    taken = fixed[:, np.any(fixed != 0, axis=0)]
    q = _basis(white(taken))
    r = white(y[:, None])
    rest = r - q @ (q.T @ r)
    for places in sought:
        own = [_basis(x - q @ (q.T @ x)) for x in map(white, places)]
        best = int(np.argmax([float(np.sum((b.T @ rest) ** 2)) for b in own]))
        taken = np.concatenate([taken, places[best]], axis=1)
        q = np.concatenate([q, own[best]], axis=1)
        rest = rest - own[best] @ (own[best].T @ rest)
    return _basis(taken)


def _basis(columns: Array) -> Array:
    """Orthonormal basis of columns; those that vanish are left out."""
    size = np.sqrt((columns**2).sum(axis=0))
    seen = size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)
    u, s, _ = np.linalg.svd(columns[:, seen] / size[seen], full_matrices=False)
    return np.asarray(u[:, s > 1e-6 * s.max(initial=0.0)])


def build(
    data: AxisLog, setup: Setup | None, effects: Sequence[EffectLike | str] = ()
) -> AxisLogModel:
    """Build the model of an axis log; the set-up with its ``[servo]`` table is needed."""
    if not isinstance(setup, Setup):
        raise InputError(
            f"setup: got {type(setup).__name__}, wanted the Setup with [servo] of this log"
        )
    return AxisLogModel(data, setup, effects)
