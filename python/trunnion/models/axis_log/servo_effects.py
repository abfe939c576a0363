"""Effects of an axis of a log that are made by its servo: an amount of a parameter, or friction.

The response of an axis is not linear in most parameters. The column of an effect is therefore a
chord: the exact change of the response divided by the parameter, at the value where this effect
alone fits the log best; of an effect that is in already (:mod:`.near`) the slope.

Friction in proportion to the speed is a gain and a time constant, and a Coulomb level of its own in
each direction an offset beside the mean level: neither has an effect of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from trunnion.base.units import Floats
from trunnion.contouring.servo import Axis, varied
from trunnion.diagnosis.effect import Effect, Parameter, gridded, linear
from trunnion.models.axis_log.columns import Places
from trunnion.models.axis_log.signals import AxisSignal
from trunnion.setup.fields import Number, keys_of

MAX_DELAY_PERIODS = 62  # of a servo that is simulated
SLOPE_STEP = 0.1  # of the amount from which a size is sought: over it the slope is differenced


@dataclass(frozen=True)
class AxisEffect:
    """An entry of the table for each axis; id and label are those without the axis.

    whole_grid: Noise is what is left beside any place of its grid, not beside its middle.
    """

    id: str
    label: str
    whole_grid: bool = field(default=False, kw_only=True)

    def id_of(self, axis: AxisSignal) -> str:
        """Return the id on an axis."""
        return f"{self.id}_{axis.letter.lower()}"

    def label_of(self, axis: AxisSignal) -> str:
        """Return the label on an axis."""
        return self.label.format(axis=axis.letter)

    def applies(self, axis: AxisSignal, places: Places) -> bool:  # noqa: ARG002
        """Whether it is looked for."""
        return True

    def build(self, axis: AxisSignal, places: Places) -> Effect:
        """Return the effect on an axis of a log."""
        raise NotImplementedError

    def changed(self, servo: Axis, axis: AxisSignal, values: Mapping[str, float]) -> Axis:  # noqa: ARG002
        """Return the servo of an axis with the effect in it; as it is if it cannot say it."""
        return servo


@dataclass(frozen=True)
class ServoEffect(AxisEffect):
    """Parameters of the servo differ from the set-up's by one amount.

    parameter, unit: Name of the amount; its unit where the name does not say it.
    servo: Fields of `LinearAxis` or `RotaryAxis` that it is added to.
    start, start_share: Amount from which its size is sought; at least this share of the servo's own
        parameter.
    percent: The amount is in % of the servo's own parameter.
    signed: It can be negative.
    positive: The servo's own parameter cannot be negative.
    expected: Where the set-up is far from the log, it costs nothing to name.
    rare: A set-up seldom has it wrong.
    linear: With it the loop stays a linear one.
    """

    parameter: str
    servo: tuple[str, ...]
    unit: str = ""
    start: float = 1.0
    start_share: float = 0.0
    percent: bool = False
    signed: bool = True
    positive: bool = True
    expected: bool = False
    rare: bool = False
    linear: bool = False

    def build(self, axis: AxisSignal, places: Places) -> Effect:
        """Return the effect on an axis of a log, its column the chord."""
        bounds = (self.lowest(axis), self.highest(axis))
        parameter = Parameter(axis.units.name(self.parameter), self.unit, bounds=bounds)
        columns = axis.blocks.place(axis.rows, self.column(axis, places)[:, None])
        expected = self.expected and axis.starts is not None
        label = self.label_of(axis)
        return linear(
            self.id_of(axis), [parameter], columns, label, expected=expected, rare=self.rare
        )

    def column(self, axis: AxisSignal, places: Places) -> Floats:
        """Change of the axis's readings by a unit of the amount, shape (blocks,)."""

        def change(amount: float) -> Floats:
            return axis.place(axis.change(self.added(axis.servo, axis, amount)))

        start = self.least(axis)
        if self.id_of(axis) in places.about:
            step = SLOPE_STEP * start
            down = 0.0 if places.about[self.id_of(axis)] - step < self.lowest(axis) else -step
            return np.asarray((change(step) - (change(down) if down else 0.0)) / (step - down))[
                axis.rows
            ]
        return places.chord(self.id_of(axis), start, change, signed=self.signed)[axis.rows]

    def lowest(self, axis: AxisSignal) -> float:
        """Return the smallest amount: what the set-up has of it can be taken away, not more."""
        own = getattr(axis.nominal, axis.units.name(self.servo[0]))
        if not self.positive:
            return self._limits(axis)[0] - float(own)
        return -99.0 if self.percent else -float(own)

    def highest(self, axis: AxisSignal) -> float:
        """Return the largest amount that the servo's parameter can take."""
        own = getattr(axis.nominal, axis.units.name(self.servo[0]))
        return np.inf if self.percent else self._limits(axis)[1] - float(own)

    def _limits(self, axis: AxisSignal) -> tuple[float, float]:
        """Range of the servo's parameter."""
        takes = keys_of(type(axis.nominal))[axis.units.name(self.servo[0])].takes
        low, high = (takes.low, takes.high) if isinstance(takes, Number) else (-np.inf, np.inf)
        if self.servo[0] == "delay_ms":
            high = min(high, MAX_DELAY_PERIODS * 1e3 * min(run.control_s for run in axis.runs))
        return low, high

    def least(self, axis: AxisSignal) -> float:
        """Amount from which its size is sought."""
        own = getattr(axis.servo, axis.units.name(self.servo[0]))
        return float(max(self.start_share * own, self.start))

    def changed(self, servo: Axis, axis: AxisSignal, values: Mapping[str, float]) -> Axis:
        """Return the servo of an axis with the amount, the first of the values, added."""
        return replace(self.added(servo, axis, float(next(iter(values.values())))))

    def added(self, servo: Axis, axis: AxisSignal, amount: float) -> Axis:
        """Return a servo of an axis with an amount added; a share is one of the set-up's."""
        names = [axis.units.name(name) for name in self.servo]
        share = 0.01 * getattr(axis.nominal, names[0]) if self.percent else 1.0
        return varied(servo, {n: getattr(servo, n) + amount * share for n in names})


@dataclass(frozen=True)
class Stribeck(AxisEffect):
    """Friction is larger at low speed by an amount that falls with the square of the speed.

    The servo model stays as it is: the loop's linear response to it is added.
    """

    id: str = "stribeck"
    label: str = "friction of the {axis} axis at low speed"

    def build(self, axis: AxisSignal, places: Places) -> Effect:  # noqa: ARG002
        """Return the effect on an axis of a log."""
        units = axis.units
        sense, speed = axis.sense_and_speed()
        top = float(np.quantile(speed, 0.9)) if len(speed) else 0.0
        peaks = tuple(float(v) for v in np.geomspace(0.01, 0.3, 6) * max(top, 1e-9))
        drop = units.name("speed_{large}_s")
        parameters = (
            Parameter(units.name("stribeck_{small}"), bounds=(0.0, np.inf)),
            Parameter(
                drop, unit=f"{units.large}/s", grid=peaks, bounds=(0.5 * peaks[0], 2.0 * peaks[-1])
            ),
        )
        columns = StribeckColumns(axis, drop, sense, speed)
        return gridded(self.id_of(axis), parameters, columns, self.label_of(axis))


@dataclass(frozen=True, eq=False)
class StribeckColumns:
    """Column of friction at low speed, (n, 1)."""

    axis: AxisSignal
    name: str
    sense: Floats
    speed: Floats

    def __call__(self, values: Mapping[str, float]) -> Floats:
        """Return the column at a speed."""
        bump = self.sense * np.exp(-((self.speed / values[self.name]) ** 2))
        rise = self.axis.mean(-self.axis.through_loop(bump))
        return self.axis.blocks.place(self.axis.rows, rise[:, None])


@dataclass(frozen=True)
class FrictionByDirection(ServoEffect):
    """Friction that rises with the speed in one direction and falls in the other.

    With it goes a constant force that takes it away at the mean speed of the log: what is the
    same at every speed is `offset`.
    """

    def added(self, servo: Axis, axis: AxisSignal, amount: float) -> Axis:
        """Return a servo of an axis with an amount added."""
        servo = super().added(servo, axis, amount)
        name = axis.units.name("offset_{small}")
        back = 0.01 * amount * axis.typical_speed * axis.units.scale / servo.gain_per_s
        return varied(servo, {name: getattr(servo, name) - back})
