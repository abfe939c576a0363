"""Levels along a line or on a grid, on the diagnosis engine.

Readings are row by row: along, then across, where both were read, in µm/m. The plain model is the
inclination of the surface as a whole, along and across. The surface enters a reading with the sense
of the instrument, s = ±1, its zero and its drift without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trunnion.base.errors import DataError, InputError
from trunnion.base.rows import repeats
from trunnion.base.smooth import Modes
from trunnion.base.units import Flags, Floats
from trunnion.data.levels import COMPONENTS, Levels
from trunnion.data.slopes import SAME_STEP
from trunnion.data.times import elapsed_s
from trunnion.diagnosis.effect import Effect, EffectLike, EffectValues, Parameter, gridded, linear
from trunnion.diagnosis.in_turn import ReadInTurn
from trunnion.diagnosis.model import FINEST_NOISE, Covariate, Model, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.own_effects import with_own
from trunnion.diagnosis.records import value_in_words
from trunnion.machine.effects import Owner
from trunnion.machine.estimate import Estimate
from trunnion.models.breaks import break_of, moment_between, passes_of, shift_from

MAX_KINKS = 200  # places that are tried for a kink
MIN_PLACES = 4
FOLDS = 5
SHARE_ONCE, SHARE_AGAIN = 0.2, 1.0  # smooth modes to places, read once or more often
SAME_PLACE = 1e-9  # feet
MAX_DEGREE = 4
PLACES_PER_DEGREE = 4
MIN_APART = 0.05  # of the variance of time, beside the place, from which a drift is looked for
SHIFT = "zero_shift"
SHAPE = "the smooth shape beside it"
SURFACE = "levels say how a surface is, not how an axis moves"
IDS = ("instrument_zero", "drift", SHIFT, "twist", "bow", "kink", "kink_x", "kink_y", "field")
NOT_TURNED = (
    "The instrument was not turned by 180 degrees: its zero and the inclination of the surface are "
    "not distinguished."
)
DRIFT_UM_M_H = 10.0  # 1 sigma, of a level that no reading says anything of
SECONDS = 30.0  # from one reading to the next, where no time was recorded
NO_DRIFT = (
    "Places were read in their order, once or there and back with the instrument turned: a drift "
    "of the instrument would look like a twist and a bow, and is not looked for. Bow and twist are "
    f"uncertain by one of {DRIFT_UM_M_H:g} µm/m per hour (1 σ). Read the places twice in the same "
    "order to tell."
)


@dataclass(frozen=True, eq=False)
class _Frame:
    """What is the same on all data of one surface: centre and half length (mm), smooth modes."""

    centre: Floats
    half: Floats
    smooth: Modes | _Polynomials | None

    @classmethod
    def of(cls, data: Levels) -> _Frame:
        places = data.stations[0]
        low, high = places.min(axis=0), places.max(axis=0)
        if np.any(high <= low):
            raise DataError(
                f"places: got {len(places)} on one line of a grid, expected both directions, or "
                "position_mm"
            )
        frame = cls((low + high) / 2, (high - low) / 2, None)
        u = frame.scaled(places)
        slopes = np.stack([data.slopes(c).values for c in data.components], axis=1)
        again = int(np.bincount(data.stations[1]).min()) > 1
        smooth = Modes.of(u, slopes, SHARE_AGAIN if again else SHARE_ONCE) or _Polynomials.of(u)
        return cls(frame.centre, frame.half, smooth)

    def scaled(self, places: Floats) -> Floats:
        """Places from -1 to 1."""
        return (places - self.centre) / self.half


@dataclass(frozen=True)
class _Polynomials:
    """Products of Legendre polynomials from the second degree on, of few places."""

    powers: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, places: Floats) -> _Polynomials | None:
        most = min(MAX_DEGREE, len(places) // PLACES_PER_DEGREE)
        if places.shape[1] == 1:
            powers: list[tuple[int, ...]] = [(k,) for k in range(2, most + 1)]
        else:
            most = min(most, min(len(np.unique(c)) for c in places.T) - 1)
            powers = [(i, j) for i in range(most + 1) for j in range(most + 1 - i) if i + j > 1]
        return cls(tuple(powers)) if powers else None

    @property
    def count(self) -> int:
        """How many."""
        return len(self.powers)

    def at(self, places: Floats) -> Floats:
        """Values at places (n, d), (n, count)."""
        top = max(max(p) for p in self.powers)
        each = [np.polynomial.legendre.legvander(c, top) for c in places.T]
        columns = [
            np.prod([e[:, k] for e, k in zip(each, p, strict=True)], axis=0) for p in self.powers
        ]
        return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Readings of the data: place (N, d), sense, component, row of each."""

    data: Levels
    place: Floats
    sense: Floats
    component: Floats
    row: Any

    @classmethod
    def of(cls, data: Levels) -> _Rows:
        count, n = len(data.components), len(data)
        which = [COMPONENTS.index(c) for c in data.components]
        return cls(
            data,
            np.repeat(data.places_mm, count, axis=0),
            np.repeat(data.sense, count),
            np.tile(np.asarray(which, dtype=np.float64), n),
            np.repeat(np.arange(n), count),
        )

    def has(self, component: str) -> Flags:
        """Whether each reading is of this component."""
        return np.asarray(self.component == COMPONENTS.index(component))

    def each(self, values: Floats | float = 1.0) -> Floats:
        """Columns (N, c): values (N,) in the readings of each component."""
        return np.stack([np.where(self.has(c), values, 0.0) for c in self.data.components], axis=1)


class LevelsModel(ReadInTurn):
    """Readings of a level, as the diagnosis engine asks for them.

    data: Measured angles. effects: further candidates, a user's own effects, or ids. frame: that of
        other data of the same surface (``bind``).

    Of a surface and a level several errors act as a rule; beside a smooth shape the readings hardly
    say which, and what is assumed beforehand counts.

    Raises DataError: fewer than four places.
    """

    together = True
    supposed_of: ClassVar[Mapping[str, Sequence[str]]] = {SHAPE: ("field",)}

    def __init__(
        self,
        data: Levels,
        effects: Sequence[EffectLike | str] = (),
        frame: _Frame | None = None,
    ) -> None:
        if len(data.stations[0]) < MIN_PLACES and frame is None:
            count = len(data.stations[0])
            raise DataError(f"places: got {count}, expected at least {MIN_PLACES}")
        self._given = tuple(effects)
        self._frame = _Frame.of(data) if frame is None else frame
        rows = _Rows.of(data)
        values = np.stack([data.columns[f"{c}_um_m"] for c in data.components], axis=1).reshape(-1)
        count = len(data.components)
        super().__init__(
            data=data,
            readings=Readings(values.astype(np.float64), rows.row, "µm/m", least=FINEST_NOISE),
            nuisance=[Nuisance(f"tilt_{c}_um_m", "µm/m") for c in data.components],
            design=rows.each(rows.sense),
            effects=with_own(_catalogue(rows, self._frame), effects, data, known=IDS),
            covariates=_covariates(rows),
            components={c: rows.has(c).astype(float) for c in data.components},
            groups=np.repeat(data.stations[1] % FOLDS, count),
            replicates=repeats([data.stations[1], data.sense], count),
        )

    def bind(self, data: Any) -> Model:
        """Return the same model on other readings."""
        if not isinstance(data, Levels) or data.grid != self.data.grid:
            raise InputError(
                f"other data: got {type(data).__name__}, expected Levels of the same kind of places"
            )
        return LevelsModel(data, self._given, self._frame)

    def extended(
        self,
        nuisance: Floats,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedLevels:
        """Return inclination and effects."""
        names = (x.name for x in self.nuisance)
        return ExtendedLevels(
            inclination_um_m=dict(zip(names, map(float, nuisance), strict=True)),
            **self.estimated(effects, uncertainty, SURFACE),
        )

    def supposed(self, effects: EffectValues) -> Mapping[str, Floats]:
        """A drift that bow and twist look like, and what is straight in the slopes of a shape."""
        out = dict[str, Floats]()
        if "field" in effects:
            out[SHAPE] = _straight_part(self.data, self._frame, effects["field"])
        if _elapsed(self.data) is None:
            rows = _Rows.of(self.data)
            out["a drift of the level"] = rows.each(DRIFT_UM_M_H * _hours(self.data)[rows.row])
        return out

    @property
    def remarks(self) -> tuple[str, ...]:
        """Say the twist as a whole, and what one orientation or one pass do not tell."""
        data = self.data
        out = [] if data.reversed else [NOT_TURNED]
        if not data.grid and "across" in data.components and len(data.stations[0]) > 2:
            found = data.twist()
            size = value_in_words(
                found.twist_um_m_m, found.std_errors["twist_um_m_m"], "µm/m per m"
            )
            out.append(
                f"By a straight line through the whole roll the twist is {size}; beside a kink or "
                "a smooth shape the cause twist is what these leave."
            )
        if _elapsed(data) is None:
            out.append(NO_DRIFT)
        return tuple(out)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedLevels(Estimate):
    """What a diagnosis of levels says of the surface and the instrument.

    Attributes
    ----------
    inclination_um_m
        Of the surface as a whole, along and across; with the instrument's zero in it where this is
        no effect.
    """

    inclination_um_m: dict[str, float]


def _elapsed(data: Levels) -> tuple[str, Floats] | None:
    """Name of a rate and time of each row in its unit: hours, or 0 to 1 over the rows.

    None where the time runs with the place: once along a line, or there, and back with the
    instrument turned. A drift is the same as a twist and a bow then.
    """
    unit, time = "um_m", np.linspace(0.0, 1.0, len(data))
    if data.time_s is not None:
        unit, time = "um_m_h", elapsed_s(data.time_s) / 3600.0
    return (unit, time) if _apart(data, time) else None


def _apart(data: Levels, column: Floats) -> bool:
    """Whether a zero, an inclination, a twist and a bow make another than a column (n,)."""
    s = data.sense[:, None]
    shape = np.hstack([np.ones_like(s), s, s * data.places_mm])
    off = column - shape @ np.linalg.lstsq(shape, column, rcond=None)[0]
    return bool(off @ off > MIN_APART * len(column) * float(np.var(column)))


def _hours(data: Levels) -> Floats:
    """Time of each row since the first, h; about, where none was recorded."""
    seconds = SECONDS * np.arange(len(data)) if data.time_s is None else data.time_s
    return elapsed_s(seconds) / 3600.0


def _covariates(rows: _Rows) -> tuple[Covariate, ...]:
    data = rows.data
    names = ("x", "y") if data.grid else ("position",)
    out = [Covariate(name, rows.place[:, i], "mm") for i, name in enumerate(names)]
    if len(data.components) > 1:
        out.append(
            Covariate("component", np.array(COMPONENTS)[rows.component.astype(int)], classes=True)
        )
    if data.turn_deg is not None:
        out.append(Covariate("turn of the instrument", rows.sense.astype(int), classes=True))
    back = len(data.stations[0]) < len(data)
    if data.time_s is not None:
        time = np.asarray(data.time_s)[rows.row]
        out.append(Covariate("time", time, "s", sequence=True, comes_back=back))
    order = rows.row.astype(float)
    out.append(Covariate("order of measurement", order, sequence=True, comes_back=back))
    return tuple(out)


def _catalogue(rows: _Rows, frame: _Frame) -> list[Effect]:
    """Effects for which the readings have what it takes."""
    data = rows.data
    each = [f"{c}_um_m" for c in data.components]
    out = [
        linear("instrument_zero", each, rows.each(), "zero of the level", owner=Owner.INSTRUMENT)
    ]
    elapsed = _elapsed(data)
    if elapsed is not None:
        unit, time = elapsed
        names = [f"{c}_{unit}" for c in data.components]
        columns = rows.each(time[rows.row])
        out.append(linear("drift", names, columns, "drift of the level", owner=Owner.TIME))
    out += _zero_shift(rows)
    out += _of_shape(rows, frame)
    out += _kinks(rows)
    if frame.smooth is not None:
        modes = frame.smooth.at(frame.scaled(rows.place))
        columns = np.concatenate(
            [modes * rows.each(rows.sense)[:, [i]] for i in range(len(data.components))], axis=1
        )
        names = [f"{c}{k + 1}_um_m" for c in data.components for k in range(frame.smooth.count)]
        label = "smooth shape of the surface without a name"
        out.append(linear("field", names, columns, label))
    return out


def _zero_shift(rows: _Rows) -> list[Effect]:
    """Another zero from a break on, or from a pass on, as far as it differs from a zero of all.

    Two passes between which the level was turned do not show it: there it is a zero of the level
    and an inclination.
    """
    data = rows.data
    name = "row" if data.time_s is None else "t0_s"
    when = np.arange(float(len(data))) if data.time_s is None else np.asarray(data.time_s)
    order = np.argsort(when, kind="stable")
    first = passes_of(data.stations[1][order])
    moments = list(moment_between(when, order, first))
    if data.time_s is not None and (t0_s := break_of(when)) is not None:
        moments.append(t0_s)
    shown = [float(t) for t in np.unique(moments) if _apart(data, when > t)]
    if not shown:
        return []
    names = [f"d_{c}_um_m" for c in data.components]
    label = "zero of the level, set again between passes or in a break"
    return [shift_from(SHIFT, names, rows.each(), when[rows.row], shown, name, label)]


def _of_shape(rows: _Rows, frame: _Frame) -> list[Effect]:
    """Twist and bow: heights k x y, and h (1 - u²) along each direction."""
    data, out = rows.data, []
    metres = 1e-3 * (rows.place - frame.centre)
    along, across = rows.has("along"), rows.has("across")
    if data.grid:
        lever = np.where(along, metres[:, 1], metres[:, 0])
    else:
        lever = np.where(across, metres[:, 0], 0.0)
    if data.grid or "across" in data.components:
        out.append(linear("twist", ["k_um_m_m"], rows.sense * lever, "twist of the surface"))
    steep = -2.0 * rows.sense[:, None] * frame.scaled(rows.place) / (1e-3 * frame.half)
    if data.grid:
        directions = [c for c in COMPONENTS if c in data.components]
        columns = [np.where(rows.has(c), steep[:, COMPONENTS.index(c)], 0.0) for c in directions]
        names = [f"h{'xy'[COMPONENTS.index(c)]}_um" for c in directions]
        out.append(linear("bow", names, np.stack(columns, axis=1), "bow of the surface"))
    elif "along" in data.components:
        out.append(linear("bow", ["h_um"], np.where(along, steep[:, 0], 0.0), "bow of the line"))
    return out


def _kinks(rows: _Rows) -> list[Effect]:
    """A step of the slope: of a line in both components, of a grid along x or along y.

    A level that is moved by the distance of its feet stands astride it at one place, and reads a
    part of it there.
    """
    data, out = rows.data, []
    for axis in range(rows.place.shape[1]):
        if data.grid and COMPONENTS[axis] not in data.components:
            continue
        places = np.unique(rows.place[:, axis])
        between = (places[1:] + places[:-1]) / 2
        if len(between) < 5:
            continue
        feet = _chained(places)
        inner = np.sort(np.append(between[1:-1], places[2:-2])) if feet else between[1:-1]
        some = np.unique(np.linspace(0, len(inner) - 1, min(len(inner), MAX_KINKS)).round())
        at = Parameter("at_mm", grid=tuple(map(float, inner[some.astype(np.intp)])))
        if data.grid:
            id_, names = f"kink_{'xy'[axis]}", ["angle_um_m"]
            enters = np.where(rows.has(COMPONENTS[axis]), rows.sense, 0.0)[:, None]
            label = f"kink of the surface along {'XY'[axis]}"
        else:
            id_, names = "kink", [f"{c}_um_m" for c in data.components]
            enters, label = rows.each(rows.sense), "kink of the line"
        shape = _Step(rows.place[:, axis], enters, feet)
        out.append(gridded(id_, [*names, at], shape.columns, label, slopes=shape.slopes))
    return out


def _straight_part(data: Levels, frame: _Frame, field: Mapping[str, float]) -> Floats:
    """Straight parts of the slopes of a smooth shape, along each direction, (N, k), of 1 sigma.

    The modes have none: bow and twist make it. A hollow has one all the same, about as large as its
    smoothest modes: as the largest mean square of the first so many of them.
    """
    if frame.smooth is None:
        return np.zeros((len(data) * len(data.components), 0))
    stations = frame.scaled(data.stations[0])
    modes = np.mean(np.square(frame.smooth.at(stations)), axis=0)
    squares = np.square(np.reshape([*field.values()], (len(data.components), -1))) * modes
    means = np.cumsum(squares, axis=1) / np.arange(1, 1 + squares.shape[1])
    sizes = np.sqrt(means[:, 1:].max(axis=1, initial=0.0))
    rows = _Rows.of(data)
    straight = frame.scaled(rows.place) / np.std(stations, axis=0)
    each = [rows.each(rows.sense * column) * sizes for column in straight.T]
    return np.concatenate(each, axis=1)


@dataclass(frozen=True, eq=False)
class _Step:
    """Columns from a place on: at once between readings, or over the distance of the feet (mm)."""

    place: Floats
    enters: Floats
    feet: float

    def columns(self, values: Mapping[str, float]) -> Floats:
        """Columns of the step, (N, k)."""
        beyond = self.place - values["at_mm"]
        share = np.clip(beyond / self.feet + 0.5, 0.0, 1.0) if self.feet else beyond >= 0
        return np.asarray(share[:, None] * self.enters)

    def slopes(self, values: Mapping[str, float]) -> Floats:
        """Derivative by the place, (N, 1), of all columns together."""
        if not self.feet:
            return np.zeros((len(self.place), 1))
        beyond = np.abs(self.place - values["at_mm"]) / self.feet - 0.5
        astride = np.where(np.abs(beyond) < SAME_PLACE, 0.5, beyond < 0) / self.feet
        sizes = [v for name, v in values.items() if name != "at_mm"]
        return np.asarray(-(astride * (self.enters @ sizes))[:, None])


def _chained(places: Floats) -> float:
    """Distance of the feet of a level that stands where its neighbours do; 0: it does not."""
    steps = np.diff(places)
    feet = float(np.median(steps))
    return feet if np.all(np.abs(steps - feet) <= SAME_STEP * feet) else 0.0


def build(data: Levels, _: Any = None, effects: Sequence[EffectLike | str] = ()) -> LevelsModel:
    """Build the model of levels; it needs no set-up."""
    return LevelsModel(data, effects)
