"""The model of an axis log that the diagnosis engine asks."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import InputError
from trunnion.base.report import rough
from trunnion.base.units import Floats, Integers
from trunnion.contouring.servo import Servo
from trunnion.data.axis_log import AxisLog
from trunnion.diagnosis.effect import Effect, EffectLike, EffectValues
from trunnion.diagnosis.model import FINEST_NOISE, Covariate, Model, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.noise import Channel, whitener
from trunnion.diagnosis.own_effects import Binding, with_own
from trunnion.machine.estimate import Estimate
from trunnion.machine.geometry import made_with
from trunnion.models.axis_log.beginnings import settled
from trunnion.models.axis_log.checks import check_axis, check_loops, check_servo, has_tip
from trunnion.models.axis_log.columns import Places, Signals, on_readings
from trunnion.models.axis_log.effects import (
    LOG_DELAY,
    RESONANCE,
    Located,
    catalogue,
    changed_servo,
    scale_ppm,
    servo_effects,
)
from trunnion.models.axis_log.inputs import Inputs
from trunnion.models.axis_log.near import Point, near
from trunnion.models.axis_log.signals import (
    TIP_COLUMNS,
    AxisSignal,
    Blocks,
    Run,
    ToolTip,
    Units,
    runs_of,
)
from trunnion.models.axis_log.steps import LogSteps, Rounded, may_matter, without_steps
from trunnion.setup import Setup

SENSES = ((1.0, "forward"), (0.0, "at rest"), (-1.0, "backward"))
MORE_DIGITS = "positions logged with more digits show smaller causes"
OF_THE_SERVO = "it depends on how the axes move, or has no motion(pose, values)"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedServo(Estimate):
    """The servo model with what a diagnosis found.

    Attributes
    ----------
    servo:
        Gain, time constant, delay, Coulomb friction, backlash, cyclic error of each axis as found.
        Offsets of the rotary axes (`rotary_centre`) are location errors, in `errors`.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("contour/setup.toml"))
    >>> log = tn.read_axis_log(tn.sample_path("contour/axislog.csv"))
    >>> d = tn.diagnose(log[:400], setup)
    >>> sorted(d.model.effects)
    ['backlash_y']
    """

    servo: Servo


class AxisLogModel(Model):
    """Servo model of an axis log; see the package.

    Parameters
    ----------
    log:
        One run a feed, two or more: at one, gain and backlash look alike.
    setup:
        With a ``[servo]`` table that has every axis of the log.
    effects:
        A user's own effects; ``change(log, values)`` gives the change of each sample of each axis
        in µm or arcsec, shape (rows, axes).
    chords:
        Values at which the effects' columns are taken; by default those of this log.
    block:
        Samples in a reading; by default so many that some thousand readings are left.

    Raises
    ------
    InputError, DataError
        The set-up lacks an axis of the log; the log is not one (:mod:`.checks`).

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("contour/setup.toml"))
    >>> log = tn.read_axis_log(tn.sample_path("contour/axislog.csv"))
    >>> model = tn.AxisLogModel(log[:400], setup)
    >>> len(model.readings)
    2000
    """

    def __init__(
        self,
        log: AxisLog,
        setup: Setup,
        effects: Sequence[EffectLike | str] = (),
        *,
        chords: Mapping[str, float] | None = None,
        block: int | None = None,
        point: Point | None = None,
    ) -> None:
        self.data = log
        self.setup = setup
        self.servo = Servo.from_setup(setup)
        self.axes = tuple(letter.upper() for letter in log.axes)
        check_servo(self.axes, self.servo)
        commanded = {x: Units.of(x).scale * log.commanded(x.lower()) for x in self.axes}
        self.runs = settled(runs_of(log, self.servo), commanded, self.servo)
        self.has_tip = has_tip(log)
        channels = len(self.axes) + (len(TIP_COLUMNS) if self.has_tip else 0)
        self._blocks = Blocks(self.runs, len(self.axes), channels, block)
        self._point = point
        self.inside = frozenset(() if point is None else point.effects)
        self._signals = self._read()
        self._off = self._deviations()
        self.nuisance, self._design = self._initial_states()
        self.readings = replace(self._off, values=self._off.values + self._design @ self._starts)
        self._given, self._chords = tuple(effects), dict(chords or {})
        own = [e for e in effects if not isinstance(e, str)]
        with_own([], own, log, described=self)  # checked at once
        if any(isinstance(e, str) for e in effects):
            with_own(self.effects, [e for e in effects if isinstance(e, str)], log)
        if point is not None:
            self.readings = self._without_point(point)

    @cached_property
    def effects(self) -> tuple[Effect, ...]:  # type: ignore[override]
        """The catalogue, and the user's own effects."""
        return tuple(one.effect for one in self._located)

    @cached_property
    def _made(self) -> tuple[list[Located], Mapping[str, float]]:
        """The catalogue, and the values at which its columns are taken."""
        amounts = {} if self._point is None else self._point.effects
        given = self._chords or self._near[0].places
        places = Places(self._design, self._off.values, given, amounts)
        made = catalogue(self._signals, places)
        axes = range(len(self.axes))
        made += [Located(e, axes) for e in self._inputs.effects(self._signals)]
        return made, places.found

    @cached_property
    def _inputs(self) -> Inputs:
        """Further columns of the log."""
        return Inputs.of(self.data, self._signals.axes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Say which rows are left out, what a reading is, and which columns are no inputs."""
        left_out = (
            f"The first {rough(1e3 * run.left_out * run.period_s, 3)} ms of run "
            f"{self._label(run).removeprefix('_') or 1} ({run.left_out} rows) are left out: an "
            "axis has just turned there, and how its play is taken up is not known."
            for run in self.runs
            if run.left_out
        )
        size = self._blocks.size
        means = (
            f"Each reading is the mean of {size} samples in a row: noise and residual are of such "
            "means, not of one sample.",
        )
        return (*left_out, *self._inputs.remarks(), *(means if size > 1 else ()))

    @property
    def scale_doubts(self) -> tuple[str, ...]:
        """Ask about axes whose recorded positions look like those of another scale."""
        return tuple(
            f"The recorded positions of {axis.letter} go with the commanded ones at a scale that "
            f"is {rough(ppm, 3, signed=True)} ppm off: is it another gear ratio, count of lines or "
            "unit?"
            for axis in self._signals.axes
            if (ppm := scale_ppm(axis)) is not None
        )

    @cached_property
    def _located(self) -> tuple[Located, ...]:
        """Effects with the channels that they act on."""
        made, _ = self._made
        every = range(self._blocks.channels)
        catalogued = [m.effect for m in made]
        own = with_own(catalogued, self._given, self.data, described=self)[len(made) :]
        own_ones = [e for e in self._given if not isinstance(e, str)]
        by_reading = {e.id for e in own_ones if isinstance(e, Binding)}
        at = (
            e if e.id in by_reading else on_readings(e, len(self.data), self._signals) for e in own
        )
        return (*made, *(Located(e, every) for e in at))

    def _read(self) -> Signals:
        """Axes and tool tip of the log, checked."""
        log, feedback = self.data, self.servo.feedback
        axes = tuple(
            AxisSignal(
                letter,
                channel,
                self.servo.axes[letter],
                self.servo.axes[letter],
                feedback,
                np.array(log.commanded(letter.lower()), dtype=np.float64),
                np.array(log.actual(letter.lower()), dtype=np.float64),
                self.runs,
                self._blocks,
            )
            for channel, letter in enumerate(self.axes)
        )
        check_loops(axes, self.servo)
        for axis in axes:
            check_axis(axis)
        axes = tuple(map(without_steps, axes))
        if self._point is not None:
            axes = tuple(self._at(axis, self._point) for axis in axes)
        tip = ToolTip.of(log, self.setup) if self.has_tip else None
        return Signals(axes, tip, self._blocks)

    @staticmethod
    def _at(axis: AxisSignal, point: Point) -> AxisSignal:
        """Axis about a point."""
        servo = axis.nominal
        for name, entry in servo_effects(axis).items():
            if name in point.effects:
                servo = entry.added(servo, axis, point.effects[name])
        starts = point.starts.get(axis.letter, axis.begins)
        delay_ms = point.effects.get(LOG_DELAY, 0.0)
        return replace(axis, servo=servo, starts=starts, log_delay_ms=delay_ms)

    def _without_point(self, point: Point) -> Readings:
        """To what the point leaves the effects that it holds are added."""
        values = self.readings.values.copy()
        for effect in self.effects:
            if effect.id in point.effects:
                values += np.asarray(effect.change(effect.values([point.effects[effect.id]])))
        return replace(self.readings, values=values)

    @property
    def _starts(self) -> Floats:
        """States at the starts of the runs that the model is about, as the nuisance has them."""
        return np.concatenate([axis.begins.ravel() for axis in self._signals.axes])

    def near(self, *, always: bool = False) -> "AxisLogModel":
        """Return the model about a point near its log; itself where chords are exact enough."""
        return self._nearby if always or self._near[1] else self

    @cached_property
    def _near(self) -> tuple[Point, bool]:
        if self._point is not None:
            return self._point, False
        return near(self._signals.axes, self._inputs.columns.values())

    @cached_property
    def _nearby(self) -> "AxisLogModel":
        return self._about(self._near[0])

    def about(self, nuisance: Floats, effects: EffectValues) -> "AxisLogModel":
        """Return the model about a fit of itself."""
        point = self._point_of(nuisance, effects)
        return self._about(replace(point, starts=self._better_starts(point, effects)))

    def _point_of(self, nuisance: Floats, effects: EffectValues) -> Point:
        starts = np.asarray(nuisance).reshape(len(self.axes), len(self.runs), 2)
        known = {name for axis in self._signals.axes for name in servo_effects(axis)} | {LOG_DELAY}
        amounts = {n: float(next(iter(v.values()))) for n, v in effects.items() if n in known}
        places = self._near[0].places
        return Point(amounts, dict(zip(self.axes, starts, strict=True)), places)

    def exact_residuals(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return what a fit leaves when its servo effects and resonances are simulated together.

        They are from the states of the runs' starts that the model is about; how far a fit is from
        these is added as fitted. It is mostly noise, which a loop with friction or play answers
        otherwise than one without: that speaks against no set of causes.
        """
        point = replace(
            self._point_of(nuisance, effects),
            starts={} if self._point is None else self._point.starts,
        )
        out = self.readings.values - self.predict(nuisance, effects)
        added = self.predict(nuisance - self._starts, self._not_simulated(effects))
        for axis in self._signals.axes:
            out[axis.rows] = self._left(axis, point, effects) - added[axis.rows]
        return out

    def _not_simulated(self, effects: EffectValues) -> EffectValues:
        """Effects that are added to what `_left` simulates."""
        at = self._point_of(self._starts, effects).effects
        simulated = {*at, *(RESONANCE.id_of(axis) for axis in self._signals.axes)}
        return {name: values for name, values in effects.items() if name not in simulated}

    def _left(self, axis: AxisSignal, point: Point, effects: EffectValues) -> Floats:
        """What an axis's servo at a point leaves of its readings, with its resonance behind it."""
        at = self._at(axis, point)
        left = at.deviation()
        if values := effects.get(RESONANCE.id_of(axis)):
            left = left - RESONANCE.of(at, values)
        return left

    def _better_starts(self, point: Point, effects: EffectValues) -> dict[str, Floats]:
        """Starts of the runs at a point, or those of this model where less is left with them.

        Where friction holds an axis at first, a fit knows next to nothing of its speed there.
        """
        added = self.predict(np.zeros(len(self.nuisance)), self._not_simulated(effects))
        run_of = self._blocks.run_of[: len(self._blocks)]
        out = {}
        for axis in self._signals.axes:
            each = np.stack([point.starts[axis.letter], axis.begins])
            left = [
                self._left(axis, replace(point, starts={axis.letter: s}), effects) for s in each
            ]
            squares = (np.stack(left) - added[axis.rows]) ** 2
            of_run = [squares[:, run_of == i].sum(axis=1) for i in range(len(self.runs))]
            out[axis.letter] = each[np.argmin(of_run, axis=1), np.arange(len(self.runs))]
        return out

    def _about(self, point: Point) -> "AxisLogModel":
        size = self._blocks.size
        return AxisLogModel(
            self.data, self.setup, self._given, chords=self._chords, block=size, point=point
        )

    def _deviations(self) -> Readings:
        """Readings of every channel: deviations from the model."""
        blocks, axes = self._blocks, self._signals.axes
        values = [axis.deviation() for axis in axes]
        units = [axis.units.small_symbol for axis in axes]
        if self._signals.tip is not None:
            values += list((1e3 * blocks.mean(self._signals.tip.deviation())).T)
            units += ["µm"] * len(TIP_COLUMNS)
        rows = np.tile(blocks.starts + blocks.size // 2, blocks.channels)
        each = tuple(np.repeat(units, len(blocks)).tolist())
        return Readings(np.concatenate(values), rows, each, hint=MORE_DIGITS, least=FINEST_NOISE)

    def _initial_states(self) -> tuple[tuple[Nuisance, ...], Floats]:
        """Position and speed of each axis at the start of each run, and their columns, (n, p)."""
        columns, nuisance = [], []
        for axis in self._signals.axes:
            free, small = axis.place(axis.free()), axis.units.small
            for i, run in enumerate(self.runs):
                columns.append(np.where((self._blocks.run_of == i)[:, None], free, 0.0))
                start = f"{axis.letter}{self._label(run)}_start"
                nuisance.append(Nuisance(f"{start}_{small}", small))
                nuisance.append(Nuisance(f"{start}_speed", f"{small}/ms"))
        return tuple(nuisance), np.concatenate(columns, axis=1)

    def _label(self, run: Run) -> str:
        if self.data.run is None or len(self.runs) == 1:
            return ""
        return f"_{self.data.run[run.rows.start]}"

    # --- what the engine asks

    def base(self, nuisance: Floats) -> Floats:
        """Return the deviation from the servo model that initial states make."""
        return self._design @ nuisance

    def base_jacobian(self, nuisance: Floats) -> Floats:  # noqa: ARG002
        """Free response of each axis of each run, from position and velocity at its start."""
        return self._design

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Axis, run, commanded motion and time."""
        blocks = self._blocks
        time = np.array(self.data.time_s, dtype=np.float64)
        for run in self.runs:
            time[run.rows] -= time[run.rows][0]
        position, speed, acceleration = (self._kinematic(order) for order in range(3))
        unit = " or ".join(dict.fromkeys(Units.of(x).large for x in self.axes))
        out = [
            Covariate("axis", blocks.channel_of, classes=True),
            Covariate("time", blocks.mean_everywhere(time), "s", sequence=True),
            Covariate("commanded speed of the axis", speed, f"{unit}/s"),
            Covariate("commanded acceleration of the axis", acceleration, f"{unit}/s²"),
            Covariate("sense of travel", np.sign(speed), classes=True, words=SENSES),
            Covariate("position of the axis", position, unit),
        ]
        if len(self.runs) > 1:
            names = (self._label(run).removeprefix("_") for run in self.runs)
            words = tuple((float(i), name) for i, name in enumerate(names))
            out.append(Covariate("run", blocks.run_of, classes=True, words=words))
        return tuple(out)

    def _kinematic(self, order: int) -> Floats:
        """Commanded position, speed or acceleration of each reading's axis; of the tip 0."""
        rows = self._blocks.rows(0, len(self.axes))
        parts = [axis.kinematic(order) for axis in self._signals.axes]
        return self._blocks.place(rows, np.concatenate(parts))

    @property
    def components(self) -> Mapping[str, Floats]:
        """Each axis, and each coordinate of the tool tip, by itself."""
        channel_of = self._blocks.channel_of
        return {name: (channel_of == i).astype(np.float64) for i, name in enumerate(self._channels)}

    @property
    def _channels(self) -> tuple[str, ...]:
        """Names of what is read, in the order of the readings."""
        return (*self.axes, *(TIP_COLUMNS if self.has_tip else ()))

    @property
    def allows_outliers(self) -> bool:
        """An encoder has no false readings; an axis that is off is not a heap of them."""
        return False

    @property
    def groups(self) -> Integers:
        """Runs (feeds); of a single run five blocks of time."""
        return self._blocks.groups

    def whitener(self, residuals: Floats) -> Callable[[Floats], Floats]:
        """Divide by the noise of each axis, after an autoregression where the noise has one.

        Both come from what is left when every effect of the axis is fitted at once.
        """
        return whitener(self, residuals, self._noise_channels(), self.groups)

    def dependent(self, residuals: Floats) -> Callable[[Floats], Floats]:
        """Divide by the long-run noise of each axis, beside what every effect of it explains."""
        channels = self._noise_channels()
        return whitener(self, residuals, channels, self.groups, all_dependent=True)

    @cached_property
    def grid(self) -> LogSteps | None:
        """Steps of the positions, where they matter."""
        axes = [axis for axis in self._signals.axes if may_matter(axis)]
        found = (Rounded.of(axis, self._noise_channel(axis.channel)) for axis in axes)
        return LogSteps.of_axes(found, self._off.values)

    def _noise_channels(self) -> Iterator[Channel]:
        """Each channel; what rounding makes of one for certain is no noise with a memory."""
        for i in range(len(self._channels)):
            channel = self._noise_channel(i)
            yield channel if self.grid is None else self.grid.on(channel, i)

    def _noise_channel(self, i: int) -> Channel:
        """Return a channel with the columns that in it are no noise: initial states and effects.

        Of an effect with a grid the middle, of a cyclic error every pitch.
        """
        rows = self._blocks.rows(i)
        fixed, sought = [self._design[rows]], []
        for located in self._located:
            if i not in located.channels:
                continue
            effect = located.effect
            linear = [j for j, p in enumerate(effect.parameters) if p.linear]
            grids = [p.grid or (0.0,) for p in effect.parameters]
            if not located.whole_grid:
                grids = [(g[len(g) // 2],) for g in grids]
            places = [
                effect.columns(effect.values(map(float, place)))[rows][:, linear]
                for place in product(*grids)
            ]
            if len(places) == 1:
                fixed += places
            else:
                sought.append(np.stack(places))
        own = np.arange(rows.start, rows.stop)
        return Channel(own, np.concatenate(fixed, axis=1), tuple(sought), self._channels[i])

    def bind(self, data: AxisLog) -> "AxisLogModel":
        """Return the same model, with the same columns, on another log."""
        return AxisLogModel(data, self.setup, self._given, chords=self._made[1])

    def extended(
        self,
        nuisance: Floats,  # noqa: ARG002
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedServo:
        """Return the servo model with the causes in it."""
        found = {name: dict(values) for name, values in effects.items()}
        centre = found.pop("rotary_centre", {})
        fields = self.estimated(found, uncertainty, OF_THE_SERVO)
        std_errors = fields.setdefault("std_errors", {})
        known, errors = self.setup.machine.errors, {}
        for name, value in centre.items():
            error = name.removesuffix("_um")
            errors[error] = known.get(error, 0.0) + value
            std_errors[error] = std_errors.pop(f"rotary_centre.{name}", 0.0)
        return ExtendedServo(
            servo=changed_servo(self.servo, self._signals.axes, effects),
            errors=errors,
            **fields,
            **(made_with(self.setup, self.data) if errors else {}),
        )


@checked
def build(
    data: AxisLog, setup: Setup | None, effects: Sequence[EffectLike | str] = ()
) -> AxisLogModel:
    """Build the model of an axis log; the set-up with its ``[servo]`` table is needed."""
    if not isinstance(setup, Setup):
        raise InputError(
            "setup: missing, expected a set-up (TOML) that names each axis of the log: [servo.X] "
            "with gain_per_s and time_constant_ms; nominal values will do"
            if setup is None
            else f"setup: got {type(setup).__name__}, expected the Setup with [servo] of this log"
        )
    return AxisLogModel(data, setup, effects)
