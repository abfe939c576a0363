"""Effects on axis logs: one table, `AXIS_EFFECTS` for each axis and `LOG_EFFECTS` for the log.

An entry says its id, its label, its parameters, and how it changes the log; an effect of the servo
names the parameters of `LinearAxis` or `RotaryAxis` that it changes. In names and labels ``{axis}``
stands for the letter, ``{small}`` for um or arcsec and ``{large}`` for mm or deg.

The response of an axis is not linear in most parameters. The column of an effect is therefore a
chord: the exact change of the response divided by the parameter, at the value where this effect
alone fits the log best.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from trunnion.base.rotation import cosine_sine
from trunnion.base.units import Floats
from trunnion.contouring.servo import Axis, Servo, varied
from trunnion.diagnosis.effect import Effect, Parameter, gridded, linear
from trunnion.machine.effects import Owner
from trunnion.models.axis_log.columns import Places, Signals
from trunnion.models.axis_log.servo_effects import (
    AxisEffect,
    FrictionByDirection,
    ServoEffect,
    Stribeck,
)
from trunnion.models.axis_log.signals import AxisSignal

LINEAR_PITCHES_MM = tuple(float(v) for v in np.geomspace(1.5, 60.0, 90))
ROTARY_PITCHES_DEG = tuple(float(v) for v in np.geomspace(0.5, 90.0, 110))
RESONANCES_HZ = tuple(float(v) for v in np.geomspace(15.0, 150.0, 48))
DAMPINGS = (0.03, 0.08, 0.2)
MIN_DAMPING = 0.01  # below, nothing is built so; what rings through a whole run fits noise anywhere
MAX_DAMPING = 0.35  # beyond, nothing resonates: the response has a peak of 1.5 at most
OF_SCALE = 0.9  # of the variance that motion leaves, from which on positions look like a scale
MIN_SEEN = 1e-3  # of the variance of positions, that motion does not explain
DELAY_STEP_MS = 0.01  # over which a delay of the log is differenced
LOG_DELAY = "log_delay"
LOWEST_HZ = 2.0
MAX_CHANGE = 1e9  # µm or arcsec: beyond, a loop runs away
BEYOND = 1.2  # times the highest frequency that is tried, to which the best one is refined


@dataclass(frozen=True)
class LogEffect:
    """An entry of the table for the whole log; ``build`` gives None without its data."""

    id: str
    label: str
    build: Callable[["LogEffect", Signals, Places], Effect | None]


@dataclass(frozen=True)
class CyclicError(AxisEffect):
    """The load is ahead of the motor by a wave over the motor's position; its pitch is sought."""

    id: str = "cyclic"
    label: str = "cyclic error of the {axis} axis"
    whole_grid: bool = field(default=True, kw_only=True)

    def build(self, axis: AxisSignal, places: Places) -> Effect:
        """Return the effect on an axis of a log."""
        units = axis.units
        pitches = LINEAR_PITCHES_MM if units.large == "mm" else ROTARY_PITCHES_DEG
        span = float(np.ptp(axis.predicted)) if len(axis.predicted) else 0.0
        # Over less than a tenth of a turn a cyclic error is a straight line.
        seen = tuple(p for p in pitches if p <= max(10.0 * span, pitches[2]))
        waves = {p: _waves(axis, p) for p in seen}
        seen = tuple(sorted({*seen, self._best_pitch(axis, waves, places)}))
        pitch = units.name("pitch_{large}")
        parameters = (
            Parameter(units.name("cosine_{small}")),
            Parameter(units.name("sine_{small}")),
            Parameter(pitch, grid=seen, bounds=(0.5 * seen[0], 2 * seen[-1])),
        )
        columns = CyclicColumns(axis, pitch, waves)
        return gridded(self.id_of(axis), parameters, columns, self.label_of(axis))

    def changed(self, servo: Axis, axis: AxisSignal, values: Mapping[str, float]) -> Axis:
        """Return the servo of an axis with the cyclic error; as it is if it has one already."""
        names = [axis.units.name(n) for n in ("cyclic_{small}", "pitch_{large}", "phase_deg")]
        if getattr(servo, names[0]):
            return servo
        cosine, sine, pitch = values.values()
        numbers = (np.hypot(cosine, sine), pitch, np.rad2deg(np.arctan2(cosine, sine)))
        changed: dict[str, Any] = dict(zip(names, map(float, numbers), strict=True))
        return replace(servo, **changed)

    def _best_pitch(self, axis: AxisSignal, waves: Mapping[float, Floats], places: Places) -> float:
        """Pitch at which a cyclic error alone fits best; ``waves``: columns of a grid of pitches.

        The grid is close enough to find the valley, not for its bottom: what a large error leaves
        there would be named as another cause.
        """
        name = f"{self.id_of(axis)}_pitch"
        if name in places.found:
            return places.found[name]
        left, y = places.unexplained(axis.rows)

        def gain(wave: Floats) -> float:
            basis, sizes, _ = np.linalg.svd(left(wave), full_matrices=False)
            kept = basis[:, sizes > 1e-6 * max(float(sizes[0]), 1e-300)]
            return float(np.sum((kept.T @ y) ** 2))

        def miss(pitch: float) -> float:
            return -gain(_waves(axis, pitch))

        pitches = list(waves)
        best = int(np.argmax([gain(wave) for wave in waves.values()]))
        low, high = pitches[max(best - 1, 0)], pitches[min(best + 1, len(pitches) - 1)]
        found = minimize_scalar(miss, bounds=(low, high), method="bounded")
        places.found[name] = float(found.x)
        return places.found[name]


@dataclass(frozen=True, eq=False)
class CyclicColumns:
    """Columns of a wave over the motor's position, (n, 2); ``known``: those of some pitches."""

    axis: AxisSignal
    name: str
    known: Mapping[float, Floats]

    def __call__(self, values: Mapping[str, float]) -> Floats:
        """Return the columns at a pitch."""
        pitch = values[self.name]
        waves = self.known.get(pitch)
        if waves is None:
            waves = _waves(self.axis, pitch)
        return self.axis.blocks.place(self.axis.rows, waves)


def _waves(axis: AxisSignal, pitch: float) -> Floats:
    """Means of cosine and sine over the modelled position, (blocks, 2).

    With feedback from the load less what the loop makes good of them.
    """
    waves = cosine_sine(2 * np.pi * axis.predicted / pitch)
    if axis.feedback == "load":
        waves = waves - axis.through_loop(waves)
    return axis.blocks.mean(waves, axis=1).T


@dataclass(frozen=True)
class Resonance(AxisEffect):
    """A share of the load hangs on a structure that resonates.

    The servo model stays as it is: there the structure carries all of the load or nothing. With
    feedback from the load the loop is closed behind it; then the share is that of the change that
    the whole makes.
    """

    id: str = "resonance"
    label: str = "resonance of the structure of the {axis} axis"

    def build(self, axis: AxisSignal, places: Places) -> Effect:
        """Return the effect on an axis of a log."""
        top = top_hz(axis)
        frequency, damping = self._best_place(axis, top, places)
        sought = sum(f <= top for f in RESONANCES_HZ)
        frequencies = tuple(frequency * k for k in (0.97, 1.0, 1.03))
        dampings = tuple(
            float(np.clip(damping * k, MIN_DAMPING, MAX_DAMPING)) for k in (0.8, 1.0, 1.25)
        )
        parameters = (
            Parameter("share", unit="1", bounds=(0.0, 1.5)),
            Parameter(
                "frequency_hz", unit="Hz", grid=frequencies, bounds=(LOWEST_HZ, BEYOND * top)
            ),
            Parameter("damping", unit="1", grid=dampings, bounds=(MIN_DAMPING, MAX_DAMPING)),
        )
        columns = ResonanceColumns(axis)
        return gridded(self.id_of(axis), parameters, columns, self.label_of(axis), sought=sought)

    @staticmethod
    def of(axis: AxisSignal, values: Mapping[str, float]) -> Floats:
        """Return the change of an axis's readings, (blocks,)."""
        return values["share"] * _resonance(axis, values["frequency_hz"], values["damping"])

    def _best_place(self, axis: AxisSignal, top: float, places: Places) -> tuple[float, float]:
        """Frequency and damping at which a structure that carries the whole load fits best.

        A resonance's place is sharp, and with a free share of the load many a wrong frequency fits
        about as well at the start: so it is sought with the whole load, on a grid, then refined.
        """
        keys = (f"{self.id_of(axis)}_hz", f"{self.id_of(axis)}_damping")
        if keys[0] not in places.found:
            left, y = places.unexplained(axis.rows)
            grid = [(f, d) for f in RESONANCES_HZ if f <= top for d in DAMPINGS]
            cost = np.concatenate(
                [np.sum((y[:, None] - left(c)) ** 2, axis=0) for c in _resonances(axis, grid)]
            )

            def miss(place: Floats) -> Floats:
                frequency, damping = np.exp(place)
                return y - left(_resonance(axis, float(frequency), float(damping)))

            low, high = np.log([LOWEST_HZ, MIN_DAMPING]), np.log([BEYOND * top, MAX_DAMPING])
            fits = [
                least_squares(
                    miss, np.log(grid[i]), bounds=(low, high), diff_step=[1e-4], max_nfev=25
                )
                for i in np.argsort(cost)[:2]
            ]
            best = np.exp(min(fits, key=lambda f: f.cost).x)
            places.found.update(zip(keys, map(float, best), strict=True))
        return places.found[keys[0]], places.found[keys[1]]


RESONANCE = Resonance()


@dataclass(frozen=True, eq=False)
class ResonanceColumns:
    """Column of a resonance of the whole load, (n, 1)."""

    axis: AxisSignal

    def __call__(self, values: Mapping[str, float]) -> Floats:
        """Return the column at a frequency and damping."""
        column = _resonance(self.axis, values["frequency_hz"], values["damping"])
        return self.axis.blocks.place(self.axis.rows, column[:, None])


def top_hz(axis: AxisSignal) -> float:
    """Highest frequency at which a resonance is sought."""
    return min(0.4 / min(run.period_s for run in axis.runs), RESONANCES_HZ[-1])


def resonances_hz(axis: AxisSignal) -> tuple[float, ...]:
    """Frequencies at which a structure is sought beside the servo; none if the set-up has one."""
    if axis.nominal.resonance_hz:
        return ()
    return tuple(f for f in RESONANCES_HZ if f <= top_hz(axis))


def _resonance(axis: AxisSignal, frequency_hz: float, damping: float) -> Floats:
    """Change of an axis's readings by a structure that carries all of the load, (blocks,)."""
    return np.asarray(next(_resonances(axis, [(frequency_hz, damping)]))[:, 0])


def _resonances(axis: AxisSignal, places: Sequence[tuple[float, float]]) -> Iterator[Floats]:
    """The same at many frequencies (Hz) and dampings: in parts, (blocks, m)."""
    servos = [varied(axis.servo, {"resonance_hz": f, "damping": d}) for f, d in places]
    for responses in axis.responses(servos):
        change = axis.blocks.mean(axis.units.scale * (responses - axis.predicted), axis=1).T
        # Of a loop that a structure makes unstable, nothing is taken.
        yield np.where(np.max(np.abs(change), axis=0) <= MAX_CHANGE, change, 0.0)


@dataclass(frozen=True)
class RecordedScale(AxisEffect):
    """Actual positions are recorded in a unit of another size: a gear ratio, a count of lines.

    Few logs have it, and a candidate has its price: it is one where positions look like it.
    """

    id: str = "recorded_scale"
    label: str = "scale of the recorded positions of the {axis} axis"

    def applies(self, axis: AxisSignal, places: Places) -> bool:
        """Whether positions look like it, or those of the log that the model was made of."""
        if self.id_of(axis) not in places.found and is_scaled(axis):
            places.found[self.id_of(axis)] = 1.0
        return self.id_of(axis) in places.found

    def build(self, axis: AxisSignal, places: Places) -> Effect:  # noqa: ARG002
        """Return the effect on an axis of a log."""
        moved = 1e-6 * axis.units.scale * axis.blocks.mean(axis.predicted)
        columns = axis.blocks.place(axis.rows, moved[:, None])
        name, label = self.id_of(axis), self.label_of(axis)
        return linear(name, ["scale_ppm"], columns, label, owner=Owner.INSTRUMENT, rare=True)


def is_scaled(axis: AxisSignal) -> bool:
    """Whether the deviation from the command goes with the position, not with the motion."""
    return scale_ppm(axis) is not None


def scale_ppm(axis: AxisSignal) -> float | None:
    """Scale of the deviation from the command over the position; None where it is not most of it.

    Speed, acceleration and sense of travel, which a servo's errors go with, are taken out first.
    """
    left = axis.blocks.mean(axis.actual - axis.commanded)
    speed = axis.kinematic(1)
    every = np.stack([left, axis.kinematic(0), speed, axis.kinematic(2), np.sign(speed)])
    run_of = axis.blocks.run_of[: len(left)]
    for run in np.unique(run_of):
        every[:, run_of == run] -= every[:, run_of == run].mean(axis=1, keepdims=True)
    size = np.sqrt(np.einsum("ij,ij->i", every, every))
    if not size[0] or not size[1]:
        return None
    left, place, *servo = (v / n for v, n in zip(every, size, strict=True) if n > 0)
    if servo:
        basis = np.linalg.qr(np.stack(servo, axis=1))[0]
        left, place = (v - basis @ (basis.T @ v) for v in (left, place))
    along, seen = float(left @ place), float(place @ place)
    if seen <= MIN_SEEN or along**2 <= OF_SCALE * seen * float(left @ left):
        return None
    return 1e6 * along / seen * float(size[0] / size[1])


AXIS_EFFECTS: tuple[AxisEffect, ...] = (
    ServoEffect(
        "gain",
        "loop gain of the {axis} axis",
        "gain_percent",
        ("gain_per_s",),
        unit="%",
        percent=True,
        expected=True,
        linear=True,
    ),
    ServoEffect(
        "time_constant",
        "time constant of the {axis} axis",
        "time_constant_ms",
        ("time_constant_ms",),
        start=0.02,
        start_share=0.02,
        expected=True,
        linear=True,
    ),
    ServoEffect(
        "loop_delay",
        "delay in the loop of the {axis} axis",
        "delay_ms",
        ("delay_ms",),
        start=0.1,
        signed=False,
        linear=True,
    ),
    ServoEffect(
        "backlash",
        "backlash of the {axis} axis",
        "backlash_{small}",
        ("backlash_{small}",),
        signed=False,
    ),
    ServoEffect(
        "friction",
        "friction of the {axis} axis",
        "coulomb_{small}",
        ("coulomb_{small}", "breakaway_{small}"),
        signed=False,
    ),
    Stribeck(),
    ServoEffect(
        "offset",
        "constant force on the {axis} axis",
        "offset_{small}",
        ("offset_{small}",),
        positive=False,
    ),
    FrictionByDirection(
        "friction_direction",
        "friction of the {axis} axis that depends on speed and direction",
        "drag_percent",
        ("friction_direction_percent",),
        unit="%",
        start=0.1,
        positive=False,
    ),
    ServoEffect(
        "velocity_forward",
        "velocity feed-forward of the {axis} axis",
        "forward_percent",
        ("velocity_forward_percent",),
        unit="%",
        positive=False,
        rare=True,
        linear=True,
    ),
    ServoEffect(
        "acceleration_forward",
        "acceleration feed-forward of the {axis} axis",
        "forward_ms",
        ("acceleration_forward_ms",),
        start=0.1,
        positive=False,
        rare=True,
        linear=True,
    ),
    CyclicError(),
    RESONANCE,
    RecordedScale(),
)


# --- effects of the log


def _log_delay(entry: LogEffect, signals: Signals, places: Places) -> Effect:
    """Positions in the log are those of a little earlier, all axes."""
    blocks = signals.blocks
    rows = blocks.rows(0, len(signals.axes))

    def change(delay_ms: float) -> Floats:
        parts = [axis.mean(axis.earlier(delay_ms)) for axis in signals.axes]
        return blocks.place(rows, np.concatenate(parts))

    if entry.id in places.about:
        column = (change(DELAY_STEP_MS) - change(-DELAY_STEP_MS)) / (2 * DELAY_STEP_MS)
    else:
        column = places.chord(entry.id, 10 * DELAY_STEP_MS, change)
    return linear(entry.id, ["delay_ms"], column[:, None], entry.label, owner=Owner.INSTRUMENT)


def _rotary_centre(entry: LogEffect, signals: Signals, places: Places) -> Effect | None:  # noqa: ARG001
    """Rotary axes are out of place: their offsets."""
    tip, blocks = signals.tip, signals.blocks
    if tip is None:
        return None
    moved = [1e3 * blocks.mean(tip.change(name)) for name in tip.offsets]
    columns = np.stack([m.T.ravel() for m in moved], axis=1)
    placed = blocks.place(blocks.rows(len(signals.axes), 3), columns)
    return linear(entry.id, [f"{n}_um" for n in tip.offsets], placed, entry.label)


LOG_EFFECTS = (
    LogEffect(LOG_DELAY, "delay of the log", _log_delay),
    LogEffect("rotary_centre", "location of the rotary axes", _rotary_centre),
)


# --- the catalogue


@dataclass(frozen=True, eq=False)
class Located:
    """An effect with the channels that it acts on.

    ``whole_grid``: whether the noise is what is left beside any place of the effect's grid; else
    beside its middle.
    """

    effect: Effect
    channels: range
    whole_grid: bool = False


def catalogue(signals: Signals, places: Places) -> list[Located]:
    """Return the effects on a log."""
    every = range(signals.blocks.channels)
    out = []
    for axis in signals.axes:
        own = every[axis.channel : axis.channel + 1]
        out += [
            Located(e.build(axis, places), own, e.whole_grid)
            for e in AXIS_EFFECTS
            if e.applies(axis, places)
        ]
    made = [entry.build(entry, signals, places) for entry in LOG_EFFECTS]
    return out + [Located(effect, every) for effect in made if effect is not None]


def changed_servo(
    servo: Servo, axes: Iterable[AxisSignal], effects: Mapping[str, Mapping[str, float]]
) -> Servo:
    """Return the servo model with what a diagnosis found in it, as far as its parameters say it."""
    changed = dict(servo.axes)
    known = {e.id_of(axis): (e, axis) for axis in axes for e in AXIS_EFFECTS}
    for name, values in effects.items():
        if name in known:
            entry, axis = known[name]
            changed[axis.letter] = entry.changed(changed[axis.letter], axis, values)
    return replace(servo, axes=changed)


def servo_effects(axis: AxisSignal) -> dict[str, ServoEffect]:
    """Return the effects that are an amount of a servo parameter, by id."""
    return {e.id_of(axis): e for e in AXIS_EFFECTS if isinstance(e, ServoEffect)}
