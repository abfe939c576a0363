"""Positioning of an axis (ISO 230-2) on the diagnosis engine.

The plain model is an offset of the instrument. A deviation is measured less target position, in µm
or arcsec; u runs from -1 to 1 over the targets, t in hours, k numbers the cycles from 0, d is the
direction of approach.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.errors import DataError, InputError
from trunnion.base.units import Flags, Floats, Integers
from trunnion.data.approach import refuse_other_approach
from trunnion.data.positioning import Positioning
from trunnion.data.times import elapsed_s
from trunnion.diagnosis.effect import (
    Effect,
    EffectLike,
    EffectValues,
    Parameter,
    Values,
    drift,
    linear,
    periodic,
)
from trunnion.diagnosis.in_turn import ReadInTurn
from trunnion.diagnosis.model import FINEST_NOISE, Covariate, Model, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.own_effects import with_own
from trunnion.machine.effects import Owner
from trunnion.machine.estimate import Estimate
from trunnion.models.breaks import zero_shift
from trunnion.models.positioning_breaks import (
    OF_CYCLES,
    after_break,
    apart,
    of_cycles,
    scale_change,
)
from trunnion.models.warming import warmup

LINEAR, ROTARY = ("x", "y", "z"), ("a", "b", "c")
OF_LINEAR = {
    "scale": ("scale", 1.0),
    "reversal": ("backlash", -1.0),
    "reversal_slope": ("backlash_slope", -1.0),
}
"""What any other measurement calls the errors of a linear axis, before its letter; their sign."""
OF_ROTARY = {
    "reversal": ("backlash", -1.0),
    "harmonic_1": ("positioning", 1.0),
    "harmonic_2": ("positioning_2", 1.0),
}
"""What touches and tests of a rotary axis call its errors, after its letter; their sign."""
MIN_WAVE_TARGETS = 9  # a wave of three parameters beside a scale and a reversal
MIN_PERIODS = 3
MIN_TURN_DEG = 300.0  # below it harmonics of the turn look like one another
MAX_HARMONIC = 6
MIN_TARGETS_OF_A_HARMONIC = 4
MAX_NODES = 50  # of a curve; a screw or a scale bends over a larger stretch
MIN_BOTH_SIDES = 2  # targets reached in either direction that show a reversal
MIN_REPEATS = 2  # what is not repeated is no repeatable curve
PITCHES_PER_OCTAVE = 24
SAME_COUNTER_UM = 0.5
APPROACH = ((1.0, "forward ↑"), (-1.0, "backward ↓"))
ONE_AXIS = "positioning of one axis: write a compensation table of it"


def not_shared(data: Any, others: Sequence[Any]) -> tuple[str, ...]:
    """Say what a run does not share with other measurements, as its axis is not known there."""
    if not isinstance(data, Positioning):
        return ()
    axis = _axis(data)
    alike = all(isinstance(one, Positioning) and _axis(one) == axis for one in others)
    if axis in (ROTARY if data.rotary else LINEAR) or alike:
        return ()
    got = "there is no column axis" if data.axis is None else f"axis is {str(data.axis[0])!r}"
    what, letters = "scale and reversal", "X, Y or Z"
    if data.rotary:
        what, letters = "reversal and errors once and twice per turn", "A, B or C"
    return (
        f"{got}: {what} of this run are not shared with other measurements, as they are where axis "
        f"says {letters}.",
    )


def supposed_alike(data: Sequence[Any]) -> tuple[str, ...]:
    """Say of runs that are compared as dates that nothing says which axis they are of."""
    runs = [one for one in data if isinstance(one, Positioning)]
    if len(runs) < 2 or any(run.axis is not None for run in runs):
        return ()
    return (
        "positioning: there is no column axis: the runs are taken for those of one axis, one after "
        "the other; axis says which each is of.",
    )


def _axis(data: Positioning) -> str | None:
    """Letter of the axis, small; None: it is not stated."""
    return None if data.axis is None else str(data.axis[0]).strip().lower()


class PositioningModel(ReadInTurn):
    """Deviations of one axis, as the diagnosis engine asks for them.

    Parameters
    ----------
    data
        Measured stops.
    effects
        Further candidates: a user's own effects, or ids.

    Raises
    ------
    DataError
        Fewer than three targets.
    """

    def __init__(self, data: Positioning, effects: Sequence[EffectLike | str] = ()) -> None:
        self._seen_elsewhere = False
        targets, index = data.stops
        if len(targets) < 3:
            raise DataError(f"targets: got {len(targets)}, expected at least 3")
        n = len(data)
        self._given = tuple(effects)
        unit = "arcsec" if data.rotary else "um"
        after = after_break(data)
        stops = data.direction * 1e6 + index
        super().__init__(
            data=data,
            readings=Readings(
                data.deviation,
                np.arange(n),
                data.unit,
                recorded=(data.measured * (3600.0 if data.rotary else 1e3), data.deviation),
                least=FINEST_NOISE,
            ),
            nuisance=[Nuisance(f"offset_{unit}", data.unit, Owner.INSTRUMENT)],
            design=np.ones((n, 1)),
            effects=with_own(_catalogue(data, unit, after), effects, data, known=IDS),
            covariates=_covariates(data),
            groups=_folds(data, after),
            replicates=np.unique(stops, return_inverse=True)[1],
        )
        self.cycles = np.asarray(data.cycle, dtype=np.intp)

    def bind(self, data: Any) -> Model:
        """Return the same model on other stops."""
        if not isinstance(data, Positioning):
            raise InputError(f"other data: got {type(data).__name__}, expected Positioning")
        return PositioningModel(data, self._given)

    def differing(self, other: Model) -> frozenset[str]:
        """Return what has one parameter a target, where the targets are others."""
        same = np.array_equal(self.data.stops[0], other.data.stops[0])
        return frozenset() if same else frozenset(("reversal_of_position", "curve"))

    def beside(self, others: Sequence[Model]) -> Model:
        """Return the same model; where another kind sees the axis turn it is not one instrument."""
        name = f"{_axis(self.data)}_positioning"
        kinds = (one for one in others if not isinstance(one, PositioningModel))
        if not self.data.rotary or all(e.id != name for one in kinds for e in one.effects):
            return self
        new = copy(self)
        new._seen_elsewhere = True
        return new

    def shared(self, effect: Effect) -> tuple[str, float] | None:
        """Scale and reversal are errors of the axis in any measurement; others of its stops.

        A backlash makes an approach in + stop short: the reversal is its opposite. Of a rotary axis
        an error once and twice a turn is its positioning; its scale has another unit elsewhere.
        """
        axis = _axis(self.data)
        if effect.id in OF_TIME:
            return None
        if axis in LINEAR and effect.id in OF_LINEAR:
            name, sign = OF_LINEAR[effect.id]
            return f"{name}_{axis}", sign
        if axis in ROTARY and effect.id in OF_ROTARY:
            name, sign = OF_ROTARY[effect.id]
            return f"{axis}_{name}", sign
        return (effect.id if axis is None else f"{effect.id}_of_{axis}", 1.0)

    def left_by_targets(self, effects: EffectValues) -> float:
        """Standard uncertainty (ppm) of the scale, if it were measured at other targets.

        What a repeatable curve has of its own at each target may be a wave that is shorter than two
        of their steps: a line through other targets has another slope.
        """
        if "curve" not in effects:
            return 0.0
        targets, index = self.data.stops
        at = np.zeros(len(targets))
        at[index] = self.effect("curve").change(Values(effects["curve"]))
        size = (targets - targets.mean()) * (3600.0 if self.data.rotary else 1e3)
        return 1e6 * float(np.sqrt(_unlike_neighbours(targets, at) / np.sum(size**2)))

    def extended(
        self,
        nuisance: Floats,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedPositioning:
        """Return offset and effects."""
        return ExtendedPositioning(
            offset=float(nuisance[0]),
            **self.estimated(effects, uncertainty, ONE_AXIS),
        )

    @property
    def reservation(self) -> str | None:
        """Say it where the instrument looks like the axis' own counter."""
        largest = float(np.ptp(self.readings.values))
        if self.data.rotary or largest > SAME_COUNTER_UM:
            return None
        return (
            f"Too good: the deviations stay within {largest:.2g} µm over "
            f"{np.ptp(self.data.target):.4g} mm; reference and axis look like the same counter. "
            "Then the data say nothing of the machine, nor does what follows."
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Say what stops without a repeat, or one instrument on a turning axis, do not tell."""
        data, out = self.data, list(self.data.notes)
        if (few := _too_few_both_sides(data)) is not None:
            out.append(
                f"{few} reached from both sides: curve and reversal are not distinguished. The "
                "same targets approached forward and backward would distinguish them."
            )
        if len(data) == len(data.stops[0]) and np.ptp(self.readings.values):
            out.append(
                "No target is measured twice: errors of single targets count as noise here. A "
                "second cycle, or the way back, would distinguish them."
            )
        one = data.rotary and not data.instruments and not self._seen_elsewhere
        if one and np.ptp(self.readings.values):
            out.append(
                "One instrument on a turning axis: whether the axis or the instrument has the "
                "error, the data do not say. Another instrument on the same stops would."
            )
        return tuple(out)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedPositioning(Estimate):
    """What a diagnosis of stops says of the axis.

    Attributes
    ----------
    offset
        Of the instrument, µm or arcsec.
    """

    offset: float


BETWEEN = ("scale_change", "zero_shift", *OF_CYCLES)
OF_TIME = ("cycle_drift", "drift", "warmup", "screw_warmup", *BETWEEN, "expansion")
IDS = (
    "scale",
    "reversal",
    "reversal_slope",
    "reversal_of_position",
    "periodic",
    *(f"harmonic_{n}" for n in range(1, MAX_HARMONIC + 1)),
    "cycle_drift",
    "drift",
    "warmup",
    "screw_warmup",
    *BETWEEN,
    "expansion",
    "curve",
)


def _covariates(data: Positioning) -> tuple[Covariate, ...]:
    """Quantities along which stops may be off; along the time they may wander as no cause does."""
    where = Covariate("target position", data.target, "deg" if data.rotary else "mm")
    sense = Covariate(
        "direction of approach", np.asarray(data.direction), classes=True, words=APPROACH
    )
    out = [where, sense]
    row = np.arange(len(data))
    if data.time_s is not None:
        time = np.asarray(data.time_s)
        out.append(Covariate("time", time, "s", sequence=True))
    out.append(Covariate("order of measurement", row, sequence=True))
    if data.temperature_c is not None:
        out.append(Covariate("temperature", np.asarray(data.temperature_c), "°C"))
    return tuple(out)


def _folds(data: Positioning, after: Flags) -> Integers:
    """What is predicted together: a pass from the others; of one cycle each stop.

    A pass, as what a cycle has of its own is seen in its other one. after: Stops after a break,
    which are predicted from such, and so are those before it.
    """
    cycle, sense = np.asarray(data.cycle), np.asarray(data.direction) > 0
    out = np.arange(len(data))
    for part in (after, ~after):
        if len(np.unique(cycle[part])) > 1:
            number = np.unique(2 * cycle[part] + sense[part], return_inverse=True)[1]
            out[part] = np.flatnonzero(part)[np.unique(number, return_index=True)[1]][number]
    return np.asarray(np.unique(out, return_inverse=True)[1], dtype=np.intp)


def _catalogue(data: Positioning, unit: str, after: Flags) -> list[Effect]:
    """Effects for which the stops have what it takes; of those after a break a zero that shifts."""
    d = np.asarray(data.direction, dtype=np.float64)
    targets, index = data.stops
    large = data.target * (3600.0 if data.rotary else 1e3)  # in the unit of deviations
    size = large - large.mean()
    out = [linear("scale", ["ppm"], 1e-6 * size, "scale error of the axis")]
    suffix = "deg" if data.rotary else "mm"
    both = _both_sides(data)
    if len(both) >= MIN_BOTH_SIDES:
        out.append(
            linear("reversal", [f"b_{unit}"], d / 2, "reversal of the axis, forward less backward")
        )
    if len(both) > 2:
        # Friction winds up a screw that is held at one end; without times a steady drift looks so.
        if not data.rotary and _seconds(data) is not None:
            label, grows = "reversal that grows along the axis", d / 2 * 1e-6 * size
            out.append(linear("reversal_slope", ["rate_um_m"], grows, label))
        beside = _beside(_hats(targets, both)[index], np.ones((len(both), 1)))[:, 1:]
        label = "reversal that depends on position"
        columns, names = d[:, None] / 2 * beside, _places(both[1:], suffix, unit)
        out.append(linear("reversal_of_position", names, columns, label))
    if len(targets) >= MIN_WAVE_TARGETS:
        out.append(_periodic(data, targets, unit))
    if data.rotary and np.ptp(targets) >= MIN_TURN_DEG:
        out += _harmonics(data, min(MAX_HARMONIC, len(targets) // MIN_TARGETS_OF_A_HARMONIC))
    if len(np.unique(data.cycle)) > 1:
        cycles = np.asarray(data.cycle, dtype=np.float64) - float(np.min(data.cycle))
        out.append(
            linear("cycle_drift", [f"rate_{unit}_cycle"], cycles, "drift from cycle to cycle")
        )
    lasts = not np.any(after)  # else a screw has cooled in between
    out += _of_time(data, unit, lasts)
    if lasts:
        out += of_cycles(data, unit, None if data.rotary else data.target)
    else:
        out.append(zero_shift("", after.astype(float)[:, None], f"d_{unit}"))
    if data.temperature_c is not None and np.ptp(data.temperature_c) > 0:
        out.append(_expansion(data, 1e-6 * size))
    if len(targets) > 3 and len(data) >= MIN_REPEATS * len(targets):
        nodes = _nodes(targets)
        each = _hats(targets, nodes)[index]
        line = np.stack([np.ones(len(nodes)), nodes - nodes.mean()], axis=1)
        beside = _beside(each, line)[:, 1:-1]
        label = "repeatable curve of deviations without a name"
        out.append(linear("curve", _places(nodes[1:-1], suffix, unit), beside, label))
    return apart(out)


def _nodes(targets: Floats) -> Floats:
    """Targets where a curve has a value of its own: all; of more than `MAX_NODES` some."""
    count = min(len(targets), MAX_NODES)
    return targets[np.round(np.linspace(0, len(targets) - 1, count)).astype(np.intp)]


def _hats(targets: Floats, nodes: Floats) -> Floats:
    """How much each target takes of each node, with straight lines between nodes."""
    return np.stack([np.interp(targets, nodes, row) for row in np.eye(len(nodes))], axis=1)


def _both_sides(data: Positioning) -> Floats:
    """Nodes about which the axis stopped in both directions: there alone is a reversal seen."""
    targets, index = data.stops
    nodes = _nodes(targets)
    nearest = _hats(targets, nodes).argmax(axis=1)[index]
    seen = [np.isin(np.arange(len(nodes)), nearest[data.direction == s]) for s in (1, -1)]
    return np.asarray(nodes[seen[0] & seen[1]])


def _too_few_both_sides(data: Positioning) -> str | None:
    """Say how few targets show a reversal; None: enough, or there is one direction only."""
    count = len(_both_sides(data))
    if count >= MIN_BOTH_SIDES or len(np.unique(data.direction)) < 2:
        return None
    return f"One of {len(data.stops[0])} targets was" if count else "No target was"


def _places(nodes: Floats, suffix: str, unit: str) -> list[str]:
    """Names of values at nodes."""
    return [f"at_{x:.9g}_{suffix}_{unit}" for x in nodes]


def _beside(each: Floats, taken: Floats) -> Floats:
    """Columns of the nodes (n, m) less what k columns of the nodes (m, k) hold of them.

    Of the m columns k depend on the others. Without the first the parameters are what a target has
    more than the first; without the first and the last, deviations from the line through these.
    """
    q = np.linalg.qr(taken)[0]
    return np.asarray(each - (each @ q) @ q.T)


def _unlike_neighbours(targets: Floats, values: Floats) -> float:
    """Variance of what values at targets have of their own, beside a line between neighbours."""
    before, after = np.diff(targets)[:-1], np.diff(targets)[1:]
    share = after / (before + after)
    beside = values[1:-1] - share * values[:-2] - (1.0 - share) * values[2:]
    return float(np.mean(beside**2 / (1.0 + share**2 + (1.0 - share) ** 2)))


def _periodic(data: Positioning, targets: Floats, unit: str) -> Effect:
    """A wave over the targets; a longer one than a third of their range is a curve.

    A wave is seen in the targets of one direction: from the other it may be a reversal.
    """
    index = data.stops[1]
    each = [targets[np.unique(index[data.direction == s])] for s in np.unique(data.direction)]
    low = 2.0 * float(np.median(np.concatenate([np.diff(some) for some in each])))
    high = max(float(np.ptp(targets)) / MIN_PERIODS, 1.01 * low)
    count = max(2, int(PITCHES_PER_OCTAVE * np.log2(high / low)) + 1)
    name = "pitch_deg" if data.rotary else "pitch_mm"
    pitch = Parameter(name, "deg" if data.rotary else "mm", tuple(np.geomspace(low, high, count)))
    parts = [(data.target, np.ones(len(data)))]
    return periodic("periodic", pitch, parts, "periodic error of the axis", unit=unit)


def _harmonics(data: Positioning, count: int) -> list[Effect]:
    """Waves that close after one turn: eccentricity of a scale, faults of a resolver."""
    turn = np.radians(data.target)
    often = {1: "once", 2: "twice"}
    return [
        linear(
            f"harmonic_{n}",
            [f"a{n}_arcsec", f"b{n}_arcsec"],
            np.stack([np.cos(n * turn), np.sin(n * turn)], axis=1),
            f"error {often.get(n, f'{n} times')} a turn, of the axis or of its instrument",
        )
        for n in range(1, count + 1)
    ]


def _expansion(data: Positioning, per_ppm: Floats) -> Effect:
    """Growth with the temperature; of a linear axis from its fixed bearing, which is anywhere.

    per_ppm: Change of each reading by a scale of 1 ppm about the middle of the stops.
    """
    warmer = np.asarray(data.temperature_c) - float(np.asarray(data.temperature_c)[0])
    columns, sizes = [per_ppm * warmer], [Parameter("ppm_k")]
    if not data.rotary:
        columns.append(warmer)
        sizes.append(Parameter("shift_um_k"))
    return linear("expansion", sizes, np.stack(columns, axis=1), "thermal expansion of the axis")


def _seconds(data: Positioning) -> Floats | None:
    """Time since the first stop; None: the stops have no times of their own."""
    if data.time_s is None or np.ptp(data.time_s) <= 0:
        return None
    return elapsed_s(data.time_s)


def _of_time(data: Positioning, unit: str, lasts: bool) -> list[Effect]:
    seconds = _seconds(data)
    if seconds is None:
        return []
    ones, size = np.ones(len(data)), f"amplitude_{unit}"
    out = [
        drift("drift", f"rate_{unit}_h", seconds / 3600.0, ones, "drift with time"),
        warmup("warmup", size, seconds / 60.0, ones, "warm-up of the axis"),
    ]
    if not data.rotary:
        # A screw grows from its fixed bearing, which is anywhere: the middle of the targets moves.
        from_middle = 1e-3 * (data.target - data.target.mean())
        enters, label = np.stack([from_middle, ones], axis=1), "warm-up of the screw, which grows"
        out.append(warmup("screw_warmup", ["ppm", size], seconds / 60.0, enters, label))
        if lasts:
            out.append(scale_change(data.target, seconds / 60.0))
    return out


def build(
    data: Positioning, _: Any = None, effects: Sequence[EffectLike | str] = ()
) -> PositioningModel:
    """Build the model of stops; it needs no set-up."""
    data.check_units()
    refuse_other_approach(data)
    return PositioningModel(data, effects)
