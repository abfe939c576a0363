"""Effects that are a formula: a function of one recorded quantity, in one direction.

Unexplained structure is one (:meth:`FormulaEffect.of_term`). It is plain data: it can be named,
written to a file, and be a candidate for other data of the same kind.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol, get_args

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import InputError
from trunnion.base.units import Floats, suffix_of
from trunnion.diagnosis.effect import Effect, NamedValues, Parameter, gridded, linear, periodic
from trunnion.diagnosis.formula_checks import (
    check_dependence,
    check_id,
    check_period,
    check_reading_unit,
    check_waves,
    wrong,
)
from trunnion.diagnosis.local_errors import BESIDE_PLACE, TIMES_WIDTH, Bell, beside, local
from trunnion.diagnosis.smooth import over_range
from trunnion.diagnosis.term import Term, ordinal
from trunnion.diagnosis.waves import shortest_on_grid
from trunnion.diagnosis.ways import ANGLE_UNIT, OnMachine, in_words, is_angle
from trunnion.machine.effects import Owner

Shape = Literal["harmonic", "polynomial", "wave", "alternating", "jump", "local", "class"]
SHAPES: tuple[str, ...] = get_args(Shape)
PERIODS = (0.8, 1.25)
"""Between which the period of a wave is sought, in multiples of the one it was found with."""
NEAR = 0.5
"""In widths of a local error, how far from where it was found its place is sought."""
WAVES_A_STEP = 0.25
"""Of the range, by which neighbouring periods of the search differ."""
SMOOTH = ("polynomial", "wave")
"""Shapes that have a value at the start of a measurement."""
PERIODIC = ("harmonic", "alternating")
"""Shapes whose mean over a turn or a period is known to be zero."""
SAME_STOP = 0.01
"""deg, within which an axis stands at the same position."""
LEGENDRE = ("x", "(3x² − 1)/2", "(5x³ − 3x)/2", "(35x⁴ − 30x² + 3)/8")


class Described(Protocol):
    """What a formula asks of a measurement: a model, or what describes data without one."""

    @property
    def covariates(self) -> Sequence[Any]:
        """Recorded quantities."""
        ...

    @property
    def components(self) -> Mapping[str, Floats]:
        """How a disturbance enters the readings, by direction."""
        ...


@dataclass(frozen=True)
class FormulaEffect:
    """An effect by its formula. ``effect.formula()`` says it in words, ``effect.code()`` in Python.

    Accepted wherever an effect of the user's own is.

    Attributes
    ----------
    id, label
        Name for programs and for people.
    data
        Class of the data whose readings it changes: "Touches".
    covariate, unit
        The quantity s that it depends on, as `Diagnosis.unexplained` calls it. "Y place" of touches
        is the column `y_mm`, the ball's centre at contact, rounded to 0.5 mm: what a plan may have
        asked for.
    component
        Direction in which it enters the readings ("X"), or the angle of a rotary axis ("angle of
        C"), of data with a set-up only; empty: all alike.
    shape
        "harmonic" and "wave": a cos + b sin; "alternating": a wave whose period is two steps of
        the places, from `low` on, of which these show one phase only; "polynomial": Legendre
        polynomials of s over its range; "jump": from `number` on; "local": a bell about `number`;
        "class": at one value of s.
    number
        Of the harmonic, degree of the polynomial, period of the wave (or of what alternates), place
        of the jump or of the local error, the one position of an axis that has an effect ("class").
    at
        Value of s that has an effect by itself ("class"), of s that is no position.
    low, high
        Range of s for which a polynomial was found.
    turn
        Length of a turn of s ("harmonic", and "local" if not 0).
    reading_unit
        Of the change: that of the readings, arcsec of an angle.
    owner
        What it belongs to ("time" where it depends on time or order).
    searched
        Whether the period of a wave, or place and width of a local error, are parameters.
    from_start
        Whether the functions are less their value at `low`: errors of the machine are those at the
        start, as beside the drifts of the catalogue.
    width
        Of a local error, between the values of s where it is half as large.
    shortest
        Period below which that of a wave is not sought: two steps of a grid of places, which show
        a shorter wave as a longer one.

    Examples
    --------
    >>> import trunnion as tn
    >>> wave = tn.FormulaEffect(
    ...     "rail_wave", "Touches", covariate="Y place", unit="mm", component="X",
    ...     shape="wave", number=31.0, low=-50.0, high=50.0,
    ... )
    >>> print(wave.formula())
    change in X (µm) = a cos(2π s/p) + b sin(2π s/p), s = Y place (mm), p the period
    """

    id: str
    data: str
    covariate: str
    shape: Shape
    number: float = 0.0
    component: str = ""
    unit: str = ""
    at: str = ""
    low: float = 0.0
    high: float = 1.0
    turn: float = 360.0
    reading_unit: str = "µm"
    label: str = ""
    owner: Owner = Owner.MACHINE
    searched: bool = True
    from_start: bool = False
    width: float = 1.0
    shortest: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a formula that is none."""
        check_id(self.id)
        if self.shape not in SHAPES:
            raise InputError(f"shape: got {self.shape!r}, expected one of {', '.join(SHAPES)}")
        whole = {"harmonic": 360, "polynomial": len(LEGENDRE)}.get(self.shape)
        if whole is not None and self.number not in range(1, whole + 1):
            expected = f"a whole number from 1 to {whole} for a {self.shape}"
            raise InputError(f"number: got {self.number:g}, expected {expected}")
        if self.shape in ("wave", "alternating") and not 0 < self.number < np.inf:
            expected = "the period, a finite number above 0"
            raise InputError(f"number: got {self.number:g}, expected {expected}")
        if not 0 <= self.shortest < np.inf:
            raise InputError(f"shortest: got {self.shortest:g}, expected a period, or 0 for none")
        if not (np.isfinite(self.number) and -np.inf < self.low < self.high < np.inf):
            raise InputError(f"low, high: got {self.low:g}, {self.high:g}, expected low below high")
        if self.shape == "wave" and self.searched:
            check_waves(self.number, self.low, self.high)
        if not 0 < self.turn < np.inf and not (self.shape == "local" and self.turn == 0):
            raise InputError(f"turn: got {self.turn:g}, expected a length above 0")
        if not 0 < self.width < np.inf:
            raise InputError(f"width: got {self.width:g}, expected a width above 0")
        if self.from_start and self.shape not in SMOOTH:
            expected = f"a start for {' and '.join(SMOOTH)} only"
            raise InputError(f"from_start: got true for a {self.shape}, expected {expected}")

    @classmethod
    def of_term(cls, term: Term, model: Any) -> FormulaEffect:
        """Return the effect that a term of unexplained structure is in a model's data."""
        v = next(v for v in model.covariates if v.name == term.covariate)
        enters = model.components.get(term.component)
        acting = np.ones(len(v.values), dtype=bool) if enters is None else np.asarray(enters) != 0
        acting = acting if v.known is None else acting & v.known
        unit = model.readings.unit
        of_reading = unit if isinstance(unit, str) else str(np.asarray(unit)[acting][0])
        of_reading = ANGLE_UNIT if is_angle(term.component) else of_reading
        scale = term.kind != "class"
        values = np.asarray(v.values, dtype=float) if scale else np.zeros(1)
        where = f"_in_{term.component}" if term.component else ""
        stop = not (scale or v.classes)  # one of an axis
        number, width = 0.0, 1.0
        if term.kind == "local":
            number, width = term.place_and_width
        elif scale or stop:
            number = float(str(term.number))
        return cls(
            id=re.sub(r"\W+", "_", f"{term.kind}_of_{term.covariate}{where}".lower()),
            data=type(model.data).__name__,
            covariate=term.covariate,
            shape=term.kind,  # type: ignore[arg-type]
            number=number,
            width=width,
            component=term.component,
            unit=term.unit,
            at="" if scale or stop else str(term.number),
            low=float(values.min()) if scale else 0.0,
            high=float(values.max()) if scale else 1.0,
            turn=float(v.period or (0.0 if term.kind == "local" else 360.0)),
            reading_unit=of_reading,
            label=f"unexplained, {term.sentence()}",
            owner=Owner.TIME if v.sequence else Owner.MACHINE,
            shortest=shortest_on_grid(v, np.unique(values)) if term.kind == "wave" else 0.0,
        )

    @property
    def alternating(self) -> FormulaEffect | None:
        """A wave as one that alternates from place to place; None: its period is a longer one."""
        if self.shape != "wave" or self.shortest < PERIODS[0] * self.number:
            return None
        return replace(self, shape="alternating", number=self.shortest)

    @property
    def from_start_if_in_time(self) -> FormulaEffect:
        """It, from the start on if it is a smooth function of time: as a cause it needs a zero."""
        return replace(self, from_start=self.owner is Owner.TIME and self.shape in SMOOTH)

    def of_one(self, names: Sequence[str], data: Sequence[Any]) -> FormulaEffect:
        """Return it as an effect on data of the kind of that of several that it depends on.

        names: Of the measurements, which joined covariates end in ("time of touches").
        """
        what, _, name = self.covariate.rpartition(" of ")
        return replace(self, covariate=what, data=type(data[names.index(name)]).__name__)

    @checked
    def named(self, id: str, label: str = "") -> FormulaEffect:  # noqa: A002
        """Return it under a name of its own.

        Raises
        ------
        InputError
            The id is no identifier (letters, digits, underscores).
        """
        return replace(self, id=id, label=label or id.replace("_", " "))

    def at_values(self, values: NamedValues) -> tuple[FormulaEffect, dict[str, float]]:
        """Return it with what is searched held at values, and the others: it is linear then."""
        names = [p.name for p in self._searched]
        rest = {k: float(v) for k, v in values.items() if k not in names}
        if not names:
            return self, rest
        at = [float(values.get(name, x)) for name, x in zip(names, self.start, strict=False)]
        number, width = (*at, *self.start[len(at) :])
        return replace(self, number=number, width=width, searched=False), rest

    @property
    def start(self) -> tuple[float, float]:
        """Values of what is searched that it was found with."""
        return self.number, self.width

    # --- as an effect

    @property
    def parameters(self) -> tuple[str | Parameter, ...]:
        """Names with their units; what is searched with the values that are tried."""
        end = f"_{self._suffix}"
        match self.shape:
            case "polynomial":
                return tuple(f"c{k}{end}" for k in range(1, int(self.number) + 1))
            case "jump" | "class":
                return (f"{'step' if self.shape == 'jump' else 'offset'}{end}",)
            case "local":
                return (f"height{end}", *self._searched)
            case "alternating":
                return (f"a{end}",)
        return (f"a{end}", f"b{end}", *self._searched)

    @property
    def _is_stop(self) -> bool:
        """Whether a class is one position of an axis."""
        return self.shape == "class" and bool(self.unit)

    @property
    def _suffix(self) -> str:
        """End of the names of amplitudes."""
        return suffix_of(self.reading_unit) or "reading"

    @property
    def _searched(self) -> tuple[Parameter, ...]:
        """Parameters that are not linear."""
        if not self.searched or self.shape not in ("wave", "local"):
            return ()
        return (self._period(),) if self.shape == "wave" else self._place_and_width()

    def _in_its_unit(self, name: str) -> str:
        u = suffix_of(self.unit)
        return f"{name}_{u}" if u else name

    def _place_and_width(self) -> tuple[Parameter, ...]:
        reach = self.width * NEAR
        return tuple(
            Parameter(self._in_its_unit(name), self.unit, tuple(map(float, tried)), bounds)
            for name, tried, bounds in (
                (
                    "place",
                    self.number + self.width * BESIDE_PLACE,
                    (self.number - reach, self.number + reach),
                ),
                ("width", self.width * np.array(TIMES_WIDTH), (self.width / 2, 2 * self.width)),
            )
        )

    def _period(self) -> Parameter:
        low, high = (max(self.number * share, self.shortest) for share in PERIODS)
        step = 1.0 + WAVES_A_STEP * self.number / max(self.high - self.low, self.number)
        below = int(np.log(1 / PERIODS[0]) / np.log(step))
        above = int(np.log(PERIODS[1]) / np.log(step))
        grid = (float(self.number * step**k) for k in range(-below, above + 1))
        tried = tuple(dict.fromkeys(max(p, low) for p in grid))
        return Parameter(self._in_its_unit("period"), self.unit, tried, (low, high))

    def bound(
        self, data: Any, described: Described | None = None, *, sought: bool = False
    ) -> Effect:
        """Return it bound to data; ``described``: their model; ``sought``: as a candidate.

        Raises
        ------
        InputError
            Data of another class, without the quantity, or with it in another unit; readings in
            another unit; a wave of a period that is sought and shorter than two steps of s.
        """
        if type(data).__name__ != self.data:
            got = f"an effect of {self.data} for measured {type(data).__name__}"
            raise wrong(self, "data", f"data: got {got}, expected measured {self.data}")
        if described is None:
            described = importlib.import_module("trunnion.models.kinds").described(data)
        check_dependence(self, described)
        place = next(v for v in described.covariates if v.name == self.covariate)
        if self.unit not in ("", place.unit):
            expected = f"{place.unit!r}, the unit of" if place.unit else "none of"
            got = f"unit: got {self.unit!r}, expected {expected} {self.covariate}"
            raise wrong(self, "unit", got)
        s, weight = np.asarray(place.values), self.weights(described)
        of = ANGLE_UNIT if is_angle(self.component) else described
        check_reading_unit(self, of, weight != 0)
        if sought and self.shape == "wave" and self.searched:
            longest = max(self.number * PERIODS[1], self.shortest)
            check_period(self, longest, place.unit, s[weight != 0])
        more: dict[str, Any] = {"label": self.label, "owner": self.owner}
        if self.shape == "local" and self.searched:
            named = tuple(p if isinstance(p, str) else p.name for p in self.parameters)
            bell = Bell(s.astype(float), weight, self.turn, named)
            return gridded(self.id, self.parameters, bell.columns, slopes=bell.slopes, **more)
        if self._searched:
            parts = [(s.astype(float), weight)]
            if self.from_start:
                parts.append((np.full(len(s), self.low), -weight))
            return periodic(self.id, self._searched[0], parts, unit=self._suffix, **more)
        return linear(self.id, self.parameters, weight[:, None] * self.columns_at(s), **more)

    def weights(self, described: Described) -> Floats:
        """How it enters each reading of data that have its quantity, shape (n,)."""
        place = next(v for v in described.covariates if v.name == self.covariate)
        enters = described.components.get(self.component)
        weight = np.ones(len(place.values)) if enters is None else np.asarray(enters, dtype=float)
        return weight if place.known is None else weight * place.known

    def columns_at(self, s: Any) -> Floats:
        """Functions of the quantity, one column a linear parameter."""
        columns = self._functions(s)
        return columns - self._functions(np.full(1, self.low)) if self.from_start else columns

    def _functions(self, s: Any) -> Floats:
        """Functions of the quantity, wherever their zero is."""
        match self.shape:
            case "class":
                own = beside(s, self.number, self.turn) if self._is_stop else s.astype(str)
                same = np.abs(own) < SAME_STOP if self._is_stop else own == self.at
                return np.asarray(same, dtype=np.float64)[:, None]
            case "jump":
                return np.asarray(s >= self.number, dtype=np.float64)[:, None]
            case "polynomial":
                x = over_range(s, self.low, self.high)
                return np.asarray(np.polynomial.legendre.legvander(x, int(self.number))[:, 1:])
            case "local":
                return local(s, self.number, self.width, self.turn or None)[:, None]
            case "alternating":
                angle = 2 * np.pi * (s - self.low) / self.number
                return np.asarray(np.cos(angle))[:, None]
        rate = self.number / self.turn if self.shape == "harmonic" else 1 / self.number
        angle = 2 * np.pi * rate * s
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def change(self, data: Any, values: NamedValues) -> Floats:
        """Change of each reading, shape (n,), in `reading_unit`."""
        return np.asarray(self.bound(data).change(values), dtype=np.float64)

    def jacobian(self, data: Any, values: NamedValues) -> Floats:
        """Derivative of the change by each parameter, shape (n, k)."""
        return self.bound(data).columns(values)

    def on_machine(self, machine: Any) -> Any:
        """Return what changes readings on a machine: an angle by how they change as an axis turns.

        machine: Its `turning()` gives that change by 1 arcsec, by the axis' letter.
        """
        return OnMachine(self, machine.turning()) if is_angle(self.component) else self

    # --- in words and as code

    def formula(self) -> str:
        """Say the formula in words: ``change in X (µm) = a cos(2π s/p) + ..., s = ...``."""
        s = f"s = {self.covariate}{self.unit and f' ({self.unit})'}"
        match self.shape:
            case "harmonic":
                k = int(self.number)
                angle = f"{'' if k == 1 else k}s"
                turn = "" if self.unit == "deg" else f", a turn being {self.turn:g}"
                text = f"a cos({angle}) + b sin({angle}), {s} ({ordinal(k)} harmonic{turn})"
            case "wave":
                p = "p the period" if self.searched else f"p = {self.number:g} {self.unit}".rstrip()
                text = f"a cos(2π s/p) + b sin(2π s/p), {s}, {p}"
            case "alternating":
                sign = "+" if self.low < 0 else "−"
                place = f"(s {sign} {abs(self.low):g})" if self.low else "s"
                text = f"a cos(2π {place}/p), {s}, p = {self.number:g} {self.unit}".rstrip()
            case "polynomial":
                terms = " + ".join(f"c{k + 1} {LEGENDRE[k]}" for k in range(int(self.number)))
                middle, half = (self.high + self.low) / 2, (self.high - self.low) / 2
                text = f"{terms}, x = (s − {middle:g})/{half:g}, {s}"
            case "jump":
                text = f"step from s = {self.number:g} on, {s}"
            case "local":
                searched = "" if self.searched else f" = {self.number:g}"
                wide = "" if self.searched else f" = {self.width:g}"
                text = f"height 2^(−(2(s − p)/w)²), {s}, p{searched} the place, w{wide} the width"
            case _:
                unit = self.unit and f" {self.unit}"
                stop = f"{self.number:g}{unit}" if self._is_stop else self.at
                text = f"offset where {self.covariate} is {stop}"
        where = in_words(self.component, " in ").replace(", as an", " of the")
        text += f", less its value at s = {self.low:g}" if self.from_start else ""
        return f"change{where}{f' ({self.reading_unit})' if self.reading_unit else ''} = {text}"

    def code(self) -> str:
        """Return the formula as the source of a Python function of s, direction and values."""
        names = [p if isinstance(p, str) else p.name for p in self.parameters]
        at = [f'values["{name}"]' for name in names]
        match self.shape:
            case "polynomial":
                x = f"x = (s - {(self.high + self.low) / 2!r}) / {(self.high - self.low) / 2!r}"
                body = f"np.polynomial.legendre.legval(x, [0.0, {', '.join(at)}])"
            case "alternating":
                x = f"angle = 2 * np.pi * (s - {self.low!r}) / {self.number!r}"
                body = f"{at[0]} * np.cos(angle)"
            case "jump":
                x, body = "", f"{at[0]} * (s >= {self.number!r})"
            case "local":
                place, width = at[1:] or [repr(self.number), repr(self.width)]
                x = f"off = s - {place}"
                if self.turn:
                    half = self.turn / 2
                    x = f"off = np.mod(s - {place} + {half!r}, {self.turn!r}) - {half!r}"
                body = f"{at[0]} * np.exp2(-((2 * off / {width}) ** 2))"
            case "class":
                x, body = "", f"{at[0]} * (s.astype(str) == {self.at!r})"
                if self._is_stop:
                    half = self.turn / 2
                    x = f"off = np.mod(s - {self.number!r} + {half!r}, {self.turn!r}) - {half!r}"
                    body = f"{at[0]} * (np.abs(off) < {SAME_STOP!r})"
            case _:
                period = f"{self.turn / self.number!r}" if self.shape == "harmonic" else at[-1]
                period = repr(self.number) if self.shape == "wave" and not self.searched else period
                x = f"angle = 2 * np.pi * s / {period}"
                body = f"{at[0]} * np.cos(angle) + {at[1]} * np.sin(angle)"
        unit = self.unit and f" ({self.unit})"
        along = f"share of a displacement along {self.component}" if self.component else "1"
        if is_angle(self.component):
            along = f"change of a reading by 1 arcsec of the {self.component}"
        lines = [
            "import numpy as np",
            "",
            "",
            "def change(s, enters, values):",
            f'    """Change of each reading{self.reading_unit and f", {self.reading_unit}"}.',
            "",
            f"    s: {self.covariate}{unit}, shape (n,); enters: {along}, shape (n,).",
            '    """',
            *(self._steps_from_start(x, body) if self.from_start else self._steps(x, body)),
        ]
        return "\n".join(lines) + "\n"

    @staticmethod
    def _steps(x: str, body: str) -> list[str]:
        return [*([f"    {x}"] if x else []), f"    return enters * ({body})"]

    def _steps_from_start(self, x: str, body: str) -> list[str]:
        """Lines of code with a function of its own, of which the start is taken off."""
        return [
            "    def at(s):",
            f"        {x}",
            f"        return {body}",
            "",
            f"    return enters * (at(s) - at({self.low!r}))",
        ]
