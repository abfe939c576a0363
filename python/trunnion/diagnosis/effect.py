"""Effects: named groups of parameters that change readings, bound to the data they change.

An effect of the catalogue is built from arrays by one of four builders: :func:`linear` (fixed
columns), :func:`periodic` (a wave whose period is sought), :func:`gridded` (columns that depend on
nonlinear parameters), :func:`drift` (proportional to time). What an effect holds are arrays and
small frozen classes, so that it pickles.

A user's own effect is any object with ``id``, ``parameters`` and ``change(data, values)``;
:mod:`.own_effects` binds it to data and adds it to a catalogue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trunnion.base.rotation import wave_rows
from trunnion.base.rows import ROWS_AT_HAND, at_hand, where
from trunnion.base.statistics import in_columns
from trunnion.base.units import Flags, Floats, Integers, capital, unit_of
from trunnion.diagnosis.classes import Spread
from trunnion.machine.effects import EffectInfo, Motion, Owner, ParameterInfo, UserEffect
from trunnion.machine.stated import Stated
from trunnion.setup.names import iso_codes

EffectLike: TypeAlias = UserEffect
EffectValues: TypeAlias = Mapping[str, Mapping[str, float]]
NamedValues: TypeAlias = Mapping[str, float]

STEP = 1e-4  # of a nonlinear parameter, over which the derivative is differenced


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name:
        Name with its unit (``rate_um_h``).
    unit:
        How the unit is printed; by default read from the name.
    grid:
        Empty for a parameter on which the reading depends linearly. Otherwise the values from
        which the search starts (a slip's time, a time constant, a pitch): close enough together
        that the best one lies in the valley of the optimum.
    bounds:
        Smallest and largest possible value.
    affine:
        The columns of the linear parameters are affine in this one (the height of a pivot): two
        of its values give those at all others.
    """

    name: str
    unit: str = ""
    grid: tuple[float, ...] = ()
    bounds: tuple[float, float] = (-np.inf, np.inf)
    affine: bool = False

    def __post_init__(self) -> None:
        """Read the unit from the name."""
        if not self.unit:
            object.__setattr__(self, "unit", unit_of(self.name))

    @property
    def linear(self) -> bool:
        """Whether the reading is linear in this parameter."""
        return not self.grid

    def within_grid(self) -> Parameter:
        """Return the parameter within its grid, where it has one."""
        if self.linear:
            return self
        low, high = self.bounds
        return replace(self, bounds=(max(low, min(self.grid)), min(high, max(self.grid))))


class Values(dict[str, float]):
    """Parameter values by name (``values["k_um"]``), or by position (``values[0]``)."""

    def __missing__(self, key: object) -> float:
        """Value at this position."""
        if isinstance(key, int):
            return list(self.values())[key]
        raise KeyError(key)


ALL_AXES = (
    "axes that are all wrong by the same share, as those of a warm machine. A positioning run of "
    "one axis, diagnosed together with these readings, says which it is"
)
"""What the length of an instrument, an artefact or a workpiece looks like."""
UNIFORMLY_WARM = "a machine that is uniformly warm"
INSTRUMENT_DRIFTS = "a drift of the instrument"
TURNED_ONCE = (
    f"{INSTRUMENT_DRIFTS} in time: the positions were measured in their order; measure them once "
    "more, the other way"
)
"""The same in short, for the name of a cause."""


@dataclass(frozen=True)
class Effect:
    """A candidate cause, bound to data: a named group of parameters that changes their readings.

    Attributes
    ----------
    id, parameters:
        Unique name, and the parameters in order.
    change:
        Change of each reading by these values, shape (n,), in the reading's own unit.
    jacobian:
        Derivative of ``change`` by each parameter, shape (n, k). None: the difference of
        ``change`` over one unit, which is exact for the linear parameters.
    label:
        What people call it: "drift of the Z axis". Without one they read the id.
    owner:
        What it belongs to. Effects of a workpiece or a placement are estimated anew on other data;
        all others are kept.
    motion:
        How the machine moves under this effect, or None: diagnosed but not compensated.
    needs:
        Columns of the data without which the effect is not looked for.
    least:
        Parameters at the smallest size that matters, or None. An effect that has them is looked
        for behind the named causes: a set that explains the data as well with the effect beside
        it, at this size or a few times it, is among the alternatives together with the effect.
    expected:
        Whether it costs nothing to name: what differs from a set-up that is known to be far off.
    rare:
        Whether it is named at a level of 1e-12: what a set-up seldom has wrong.
    level:
        Level at which it is named; 0: its share of the level of all candidates.
    looks_like:
        What changes the readings alike and is no candidate, in words.
    instead_of:
        Ids of candidates that are not supposed together with it: it is several of them by one size.
    near_any:
        Whether it is so many functions of time that it makes much of anything that goes with it:
        structure has no name by it, and a wander is sought beside all others.
    among:
        How many candidates it is one of, by which it has its share; 0: all of the model.
    sought:
        As how many candidates it counts: at how many places it was sought, of which its grid has
        the best, or how many times more seldom it is than others.
    stated:
        What is known of its one parameter beforehand: zero within a standard uncertainty. It costs
        a set of causes what it contradicts of that, and its estimate is made with it.
    spread:
        How its linear parameters are functions times classes of readings, where they are.
    of_one_kind:
        Of measurements of several kinds: whether those of one kind alone show it.
    """

    id: str
    parameters: tuple[Parameter, ...]
    change: Callable[[NamedValues], ArrayLike]
    jacobian: Callable[[NamedValues], ArrayLike] | None = None
    label: str = ""
    owner: Owner = Owner.MACHINE
    motion: Motion | None = None
    needs: tuple[str, ...] = ()
    least: NamedValues | None = None
    expected: bool = False
    rare: bool = False
    level: float = 0.0
    looks_like: str = ""
    instead_of: tuple[str, ...] = ()
    near_any: bool = False
    among: float = 0.0
    sought: float = 1.0
    stated: Stated | None = None
    spread: Spread | None = None
    of_one_kind: bool = False

    @property
    def ordinary(self) -> bool:
        """Whether it is one of the candidates that share their odds."""
        return not (self.expected or self.rare or self.level)

    @property
    def linear(self) -> bool:
        """Whether every parameter is linear."""
        return all(p.linear for p in self.parameters)

    def within_grids(self) -> Effect:
        """Return the effect with nonlinear parameters within their grids, as candidates have."""
        return replace(self, parameters=tuple(p.within_grid() for p in self.parameters))

    def values(self, numbers: Iterable[float]) -> Values:
        """Numbers, in the order of the parameters, as values by name."""
        return Values(zip((p.name for p in self.parameters), numbers, strict=True))

    @property
    def not_distinguished(self) -> str:
        """Say what it looks like, of one that looks like something else."""
        said = capital(self.label or self.id)
        return f"{said}: the readings do not distinguish it from {self.looks_like}."

    @property
    def instead(self) -> str:
        """What else its name may stand for, in short; empty: nothing."""
        return {ALL_AXES: UNIFORMLY_WARM, TURNED_ONCE: INSTRUMENT_DRIFTS}.get(self.looks_like, "")

    def info(self) -> EffectInfo:
        """Return the entry of a catalogue."""
        parameters = (
            ParameterInfo(p.name, p.unit, "linear" if p.linear else "searched")
            for p in self.parameters
        )
        label = self.label or self.id.replace("_", " ")
        return EffectInfo(
            self.id, label, self.owner, tuple(parameters), self.needs, iso_codes(self.id)
        )

    def columns(self, values: NamedValues) -> Floats:
        """Jacobian at ``values``, shape (n, k): as given, or by differences of ``change``."""
        if self.jacobian is not None:
            return np.asarray(self.jacobian(values), dtype=np.float64)
        numbers = [float(values[p.name]) for p in self.parameters]
        out = []
        for j, p in enumerate(self.parameters):
            step = 1.0 if p.linear else 1e-5 * max(abs(numbers[j]), 1e-3)
            up, down = list(numbers), list(numbers)
            up[j] += step
            down[j] -= step
            rise = np.asarray(self.change(self.values(up)), dtype=np.float64)
            out.append((rise - np.asarray(self.change(self.values(down)))) / (2 * step))
        return np.stack(out, axis=-1)

    def put_linear(self, values: NamedValues, out: Floats) -> None:
        """Put the columns of the linear parameters, one a row, into an array (k, n)."""
        if isinstance(self.jacobian, _Waves):
            self.jacobian.put(values, out)
            return
        shape = getattr(self.jacobian, "__self__", None)
        if isinstance(shape, _Gridded):
            out[:] = shape.columns(values).T
            return
        linear = [i for i, p in enumerate(self.parameters) if p.linear]
        np.take(self.columns(values).T, linear, axis=0, out=out, mode="clip")


# --- builders


def linear(
    id_: str, parameters: Sequence[str | Parameter], columns: Floats, label: str = "", **more: Any
) -> Effect:
    """Make an effect that is linear in all its parameters.

    Parameters
    ----------
    id_, label
        Name for programs and for people.
    parameters
        k names with units.
    columns
        Change of each reading per unit of each parameter, shape (n, k), or (n,) for a single one.
    **more
        Further attributes of :class:`Effect`: ``owner``, ``motion``, ``needs``.
    """
    full = parameters_of(parameters)
    made = in_columns(np.reshape(columns, (-1, len(full))))
    fixed = _Fixed(tuple(p.name for p in full), made)
    return Effect(id_, full, fixed.change, fixed.jacobian, label, **more)


def drift(
    id_: str, rate: str, hours: Floats, enters: Floats, label: str = "", **more: Any
) -> Effect:
    """Make an effect in proportion to time.

    ``hours``: time of each reading, shape (n,); ``enters``: change of each reading per unit of
    displacement, shape (n,). Otherwise as :func:`linear`.
    """
    return linear(id_, [rate], enters * hours, label, **more)


def periodic(
    id_: str,
    period: Parameter,
    parts: Sequence[tuple[Floats, Floats]],
    label: str = "",
    *,
    unit: str = "um",
    **more: Any,
) -> Effect:
    """Make ``a cos(2π s / period) + b sin(2π s / period)``, the period sought on its grid.

    Parameters
    ----------
    parts
        Position s of each reading in the unit of the period, and change of the reading per unit
        of the wave, both (n,); several are added.
    unit
        Of a and b, as names spell it.
    """
    parameters = (Parameter(f"a_{unit}"), Parameter(f"b_{unit}"), period)
    waves = _Waves.of(parameters, parts)
    return Effect(id_, parameters, waves.change, waves, label, **more)


def gridded(
    id_: str,
    parameters: Sequence[str | Parameter],
    columns: Callable[[NamedValues], Floats],
    label: str = "",
    *,
    slopes: Callable[[NamedValues], Floats] | None = None,
    **more: Any,
) -> Effect:
    """Make an effect linear in some parameters, whose columns depend on the others.

    Parameters
    ----------
    columns
        Change of each reading per unit of each linear parameter, shape (n, k), at the values of
        the nonlinear ones. An object that pickles, not a lambda.
    slopes
        Derivative of the change by each nonlinear parameter, shape (n, m). By default differenced
        over 1e-4 of the parameter (relative error 1e-8 of the curvature).
    """
    full = parameters_of(parameters)
    shape = _Gridded(full, columns, slopes)
    return Effect(id_, full, shape.change, shape.jacobian, label, **more)


def wave(place: Floats, period: float, a: float, b: float) -> Floats:
    """Columns of ``a cos(2π s / p) + b sin(2π s / p)`` by a, b and p, shape (n, 3)."""
    out = np.zeros((3, len(place)))
    rows = wave_rows(place, period, a, b)
    out[: len(rows)] = rows
    return out.T


def from_then_on(moment: float, when: Floats, group: NDArray[Any]) -> Flags:
    """Readings from a moment on, in the set-up of the first of them, (n,).

    when, group: Time and number of the set-up of each, (n,).
    """
    after = when >= moment
    if after.any():
        after &= group == group[after][np.argmin(when[after])]
    return np.asarray(after)


def parameters_of(names: Sequence[str | Parameter]) -> tuple[Parameter, ...]:
    """Names as parameters that are linear; parameters as they are."""
    return tuple(p if isinstance(p, Parameter) else Parameter(p) for p in names)


@dataclass(frozen=True, eq=False)
class _Fixed:
    """Columns that do not depend on the values."""

    names: tuple[str, ...]
    columns: Floats

    def change(self, values: NamedValues) -> Floats:
        return np.asarray(self.columns @ np.array([values[name] for name in self.names]))

    def jacobian(self, _: NamedValues) -> Floats:
        return self.columns


@dataclass(frozen=True, eq=False)
class _Waves:
    """A wave over positions, entering ``count`` readings with weights; parts: which, s, weights.

    Called it is its Jacobian, of which it puts rows by a and b, or these and the period, into an
    array.
    """

    names: tuple[str, ...]
    count: int
    parts: tuple[tuple[slice | Integers, Floats, Floats], ...]

    @classmethod
    def of(cls, named: Iterable[Parameter], parts: Sequence[tuple[Floats, Floats]]) -> _Waves:
        """Keep of many readings those along each part's axis."""
        some = [_acting(w) for _, w in parts]
        # Without gaps in memory: columns of a table are read again at every period.
        place = [np.ascontiguousarray(s[k]) for k, (s, _) in zip(some, parts, strict=True)]
        enters = [np.ascontiguousarray(w[k]) for k, (_, w) in zip(some, parts, strict=True)]
        kept = tuple(zip(some, place, enters, strict=True))
        return cls(tuple(p.name for p in named), len(parts[0][0]), kept)

    def change(self, values: NamedValues) -> Floats:
        rows = np.empty((2, self.count))
        self.put(values, rows)
        return np.asarray(rows.T @ [values[name] for name in self.names[:2]])

    def __call__(self, values: NamedValues) -> Floats:
        out = np.zeros((3, self.count))
        self.put(values, out)
        return out.T

    def put(self, values: NamedValues, out: Floats) -> None:
        a, b, period = (values[name] for name in self.names)
        room = np.empty((3, min(self.count, ROWS_AT_HAND)))
        for number, (own, place, enters) in enumerate(self.parts):
            if number == 0 and len(place) < self.count:
                out[:] = 0.0
            waves = out[:, own]
            for some in at_hand(len(place)):
                s = place[some]
                rows = wave_rows(s, period, a, b, room[:, : len(s)])[: len(out)]
                if number == 0:
                    np.multiply(rows, enters[some], out=waves[: len(rows), some])
                    continue
                rows *= enters[some]
                waves[: len(rows), some] += rows
            if not isinstance(own, slice):
                out[:, own] = waves


def _acting(enters: Floats) -> slice | Integers:
    """Rows that a wave enters; all where most of them are no slice: to pick them costs more."""
    rows = where(enters != 0)
    return slice(None) if not isinstance(rows, slice) and 2 * len(rows) > len(enters) else rows


@dataclass(frozen=True, eq=False)
class _Gridded:
    """Columns of the linear parameters at values of the others."""

    parameters: tuple[Parameter, ...]
    columns: Callable[[NamedValues], Floats]
    slopes: Callable[[NamedValues], Floats] | None

    def change(self, values: NamedValues) -> Floats:
        return self.columns(values) @ [values[p.name] for p in self.parameters if p.linear]

    def jacobian(self, values: NamedValues) -> Floats:
        own = self.columns(values)
        out = np.zeros((len(own), len(self.parameters)))
        flat = np.array([p.linear for p in self.parameters])
        out[:, flat] = own
        there = any(values[p.name] for p in self.parameters if p.linear)
        if there and self.slopes is not None:
            out[:, ~flat] = self.slopes(values)
        elif there:
            for j in np.flatnonzero(~flat):
                name = self.parameters[j].name
                step = STEP * abs(values[name])
                up = self.change({**values, name: values[name] + step})
                down = self.change({**values, name: values[name] - step})
                out[:, j] = (up - down) / (2 * step)
        return out
