"""What a diagnosis is made of: causes, alternatives, gain, and the readings with their residuals.

Records hold numbers, texts and arrays, never a model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from trunnion.base.report import (
    Result,
    Shown,
    Table,
    left_text,
    measured,
    number,
    plus_minus,
    significant,
)
from trunnion.base.saved import Columns
from trunnion.base.units import Flags, Floats, Integers, parameter_words, unit_of
from trunnion.diagnosis.model import Covariate, Model, Readings

Verdict: TypeAlias = Literal["consistent", "explained", "ambiguous", "unexplained"]

WITHOUT_DATA = (
    "got a diagnosis from JSON without its measured data (printed by --json, or by an older "
    "version), expected one with them, as `trunnion diagnose ... --output d.json` and "
    "Diagnosis.save write it: diagnose the data again"
)
"""What is said where a picture, a budget or a model needs the data, and JSON has none."""
MAX_SIZE = 1e6
"""Of a parameter (µm, arcsec, ppm, µm/h): more is no size, but one side of two that cancel."""
MAX_PARAMETERS = 7  # of a cause: of more the largest is stated
CERTAIN = 0.9  # probability from which a cause acts, whatever its size
MIN_P = 0.001  # smaller ones are called so
MAX_ROWS = 12  # of a table of readings
MAX_WORST = 3  # errors that are stated to be in doubt
MIN_DOUBT = 0.5  # of the uncertainty of such an error
RELATIVE = "relative to the noise"
NO_CAUSE = "no known cause"  # of a set without one: noise alone, or what the catalogue has not


def chance(p: float) -> str:
    """Say a p-value: "p = 0.042", "p < 0.001"."""
    return f"p < {MIN_P}" if p < MIN_P else f"p = {p:.2g}"


def percent(probability: float) -> str:
    """Say a probability: "88 %"; "> 99 %" and "< 1 %" where it rounds to certainty."""
    if probability > 0.995:
        return "> 99 %"
    return "< 1 %" if probability < 0.005 else f"{100 * probability:.0f} %"


def with_unit(text: str, unit: str) -> str:
    """Put a unit behind a number, if there is one."""
    return f"{text} {unit}" if unit else text


@dataclass(frozen=True, eq=False, repr=False)
class Cause(Result):
    """A named cause.

    Attributes
    ----------
    id:
        The effect.
    parameters, std_errors:
        By parameter name, in the unit of the name. A standard error of inf: not identifiable.
    p_value:
        Of the data without this cause, the others kept, times the number of candidates.
    aliases:
        Effects that could take its place.
    label:
        What people call it.
    probability:
        Of all sets of causes that hold it, over all sets that were looked at.
    instead:
        What else changes the readings alike, in words, so that size and probability are of the one
        or the other: "a machine that is uniformly warm". Empty: nothing.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> cause = d.causes[0]
    >>> cause.label
    'positioning of C, twice a turn'
    >>> round(cause.parameters["a2_arcsec"], 1)
    6.1
    """

    id: str
    parameters: Mapping[str, float]
    std_errors: Mapping[str, float]
    p_value: float
    aliases: tuple[str, ...] = ()
    label: str = ""
    probability: float = 1.0
    instead: str = ""

    def __getitem__(self, name: str) -> float:
        """Value of a parameter."""
        return self.parameters[name]

    def called(self) -> str:
        """Return label and id: ``drift of the Z axis (drift_z)``."""
        return labelled(self.id, self.label)

    @property
    def or_instead(self) -> str:
        """What stands behind its name where the measurement does not say whether it is the one."""
        does_not = ", which this measurement does not distinguish from it"
        return f"{self.or_other}{does_not}" if self.instead else ""

    @property
    def or_other(self) -> str:
        """The same in short, where it is said elsewhere that the measurement does not say."""
        return f", or {self.instead}" if self.instead else ""

    def sentences(self) -> tuple[str, ...]:
        """Say what it is and how large: ``drift of the Z axis (drift_z): 4.8 ± 0.3 µm/h``."""
        return (f"{self.called()}{self.or_instead}: {self.size()}",)

    @property
    def reserve(self) -> str:
        """What is said behind a probability where it is certain that it acts, but not how large.

        So it is where measurements contradict each other: either value, each of them certain.
        """
        pairs = [(self.parameters[k], self.std_errors[k]) for k in self.parameters]
        if self.probability <= CERTAIN or not pairs:
            return ""
        if not all(abs(value) < std < np.inf for value, std in pairs):
            return ""
        if len(pairs) > 1:
            return "; it acts, its parameters are determined in combination only"
        return "; it acts, its size is not determined"

    def size(self, coverage: float = 1.0) -> str:
        """Say the parameters with `coverage` standard errors; of many only the largest."""
        said = {
            name: value_in_words(value, coverage * self.std_errors[name], unit_of(name))
            for name, value in self.parameters.items()
        }
        known = [
            k
            for k, value in self.parameters.items()
            if np.isfinite(self.std_errors[k]) and abs(value) < MAX_SIZE
        ]
        said |= {k: number(np.inf) for k in said if k not in known}
        if len(said) == 1:
            return next(iter(said.values())) if known else "size not identifiable"
        named = {
            k: f"{parameter_words(k)} {'= ' if k in known else ''}{text}"
            for k, text in said.items()
        }
        count = f"{len(said)} parameters"
        if not known:
            return f"{count}, identifiable in combination only"
        if len(said) <= MAX_PARAMETERS:
            return ", ".join(named.values())
        if len({unit_of(name) for name in known}) > 1:
            return count
        return f"{count}, the largest {named[max(known, key=lambda k: abs(self.parameters[k]))]}"

    def tables(self) -> tuple[Table, ...]:
        """Parameters with their standard errors."""
        title = f"{self.called()}, {chance(self.p_value)}"
        return (parameter_table(title, self.parameters, self.std_errors),)


@dataclass(frozen=True, eq=False, repr=False)
class Gain(Result):
    """Residual rms of the plain and of the extended model, readings of one unit.

    Attributes
    ----------
    rms_before_um, rms_after_um:
        Of the fits, in `unit`.
    heldout_rms_before_um, heldout_rms_after_um:
        Cross-validated: each group of readings predicted from the others, in `unit`.
    unit:
        Unit of these readings: µm, or arcsec for the rotary axes of a log.
    others:
        The same for the readings in other units, where the data mix them.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> round(d.gain.rms_before_um, 2), round(d.gain.rms_after_um, 2)
    (0.87, 0.28)
    """

    rms_before_um: float
    rms_after_um: float
    heldout_rms_before_um: float
    heldout_rms_after_um: float
    unit: str = "µm"
    others: tuple[Gain, ...] = ()

    @classmethod
    def of(
        cls,
        before: Floats,
        after: Floats,
        heldout_before: Floats,
        heldout_after: Floats,
        units: tuple[str, ...],
        unit_index: Integers,
    ) -> Gain:
        """Return the gain from residuals, each (n,), the unit of each given by its index."""
        gains: list[Gain] = []
        for i, unit in enumerate(units):
            mine = unit_index == i
            if mine.any():
                a, b, c, d = (rms(r[mine]) for r in (before, after, heldout_before, heldout_after))
                gains.append(cls(a, b, c, d, unit))
        return replace(gains[0], others=tuple(gains[1:]))

    def by_unit(self) -> dict[str, Gain]:
        """Return the gain of the readings of each unit."""
        return {gain.unit: gain for gain in (self, *self.others)}

    def sentences(self) -> tuple[str, ...]:
        """Say what the causes gain on data that the fit has not used."""
        return (f"Cross-validated rms {self.fall()}.",)

    def fall(self) -> str:
        """Return ``falls from 0.97 to 0.304 µm``, unit by unit."""
        said = []
        for g in (self, *self.others):
            before, after = map(left_text, (g.heldout_rms_before_um, g.heldout_rms_after_um))
            verb = "falls" if g.heldout_rms_after_um < g.heldout_rms_before_um else "rises"
            text = f"stays at {after}" if after == before else f"{verb} from {before} to {after}"
            said.append(with_unit(text, g.unit))
        return ", ".join(said)

    def tables(self) -> tuple[Table, ...]:
        """Rms before and after, one row a unit."""
        rows = [
            (
                name if len(self.by_unit()) == 1 else f"{name}, {gain.unit}",
                significant(before),
                significant(after),
                gain.unit,
            )
            for gain in (self, *self.others)
            for name, before, after in (
                ("rms of the fit", gain.rms_before_um, gain.rms_after_um),
                (
                    "cross-validated rms",
                    gain.heldout_rms_before_um,
                    gain.heldout_rms_after_um,
                ),
            )
        ]
        return (Table.of("Residuals", ("", "plain model", "with causes", "unit"), rows),)


@dataclass(frozen=True, eq=False, repr=False)
class Alternative(Result):
    """A set of causes that explains the data about as well, and how well.

    Attributes
    ----------
    causes:
        Ids of the set.
    distance:
        Penalised -2 ln L above the best of all sets, which is the first as a rule.
    rms_um:
        Of the residuals, in `unit`.
    start:
        Values of nonlinear parameters (a slip's time) from which a fit of the set starts.
    probability:
        That these causes of the catalogue act and no others, over all sets that were looked at,
        the one without a cause included.
    unit:
        Of `rms_um`: that of the readings; "relative to the noise" where units are mixed, or the
        readings of several measurements, each of which is weighed by its own noise.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> [(sorted(a.causes), round(a.probability, 2)) for a in d.evidence[:2]]
    [(['c_positioning_2', 'drift_z'], 0.96), (['c_positioning_2', 'warmup_z'], 0.03)]
    """

    causes: frozenset[str]
    distance: float
    rms_um: float
    start: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    probability: float = 1.0
    unit: str = "µm"

    def sentences(self) -> tuple[str, ...]:
        """Say the set and its distance."""
        return (
            f"{' + '.join(sorted(self.causes))}: {percent(self.probability)}, "
            f"{self.distance:.1f} above the best in -2 ln L",
        )

    def tables(self) -> tuple[Table, ...]:
        """The set as one row."""
        return (alternatives_table([self]),)


@dataclass(frozen=True, eq=False, repr=False)
class Residuals(Result):
    """The readings of a diagnosis, what they depend on, and what the models leave of them.

    Attributes
    ----------
    rows:
        Data row (from 0) of each reading, (n,).
    values:
        Readings, (n,).
    before, after:
        Reading minus prediction of the plain and of the extended model, (n,).
    used:
        Indices of the readings that were used, (m,): the others are outliers.
    units, unit_index:
        The units of the readings, and the index of each reading's, (n,).
    covariates:
        Recorded quantities by which residuals are drawn.
    changes:
        What each named cause changes, (n,) each.
    """

    rows: Integers
    values: Floats
    before: Floats
    after: Floats
    used: Integers
    units: tuple[str, ...]
    unit_index: Integers
    covariates: tuple[Covariate, ...] = ()
    changes: Mapping[str, Floats] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        model: Model,
        before: Floats,
        after: Floats,
        used: Integers,
        nuisance: Floats,
        effects: Mapping[str, Mapping[str, float]],
    ) -> Residuals:
        """Return the record of a model and its residuals before and after.

        Parameters
        ----------
        nuisance, effects
            Values of the extended model, at which the causes' changes are taken.
        """
        units, unit_index = units_of(model.readings)
        whole = model.predict(nuisance, effects) if effects else after
        changes = {
            name: whole - model.predict(nuisance, {k: v for k, v in effects.items() if k != name})
            for name in effects
        }
        readings = model.readings
        return cls(
            np.asarray(readings.rows),
            np.asarray(readings.values),
            before,
            after,
            used,
            units,
            unit_index,
            tuple(model.covariates),
            changes,
        )

    @property
    def kept(self) -> Flags:
        """Whether each reading was used, (n,)."""
        mask = np.zeros(len(self.values), dtype=bool)
        mask[self.used] = True
        return mask

    @property
    def unit(self) -> str:
        """Unit of the readings; all of them where the data mix units."""
        return ", ".join(unit for unit in self.units if unit)

    def sentences(self) -> tuple[str, ...]:
        """Say how many there are and their rms."""
        count = len(self.values)
        out = count - len(self.used)
        parts = [
            with_unit(f"from {rms(self.before[mine]):.3g} to {rms(self.after[mine]):.3g}", unit)
            for i, unit in enumerate(self.units)
            if (mine := self.kept & (self.unit_index == i)).any()
        ]
        left = f", {out} left out" if out else ""
        return (f"{count} readings{left}: rms {', '.join(parts)}.",)

    def tables(self) -> tuple[Table, ...]:
        """The first readings; all of them are in `to_dataframe`."""
        return (self._table(slice(0, MAX_ROWS)),)

    def _table(self, some: slice) -> Table:
        columns = ("row", "reading", "before", "after", "used", "unit")
        rows = [
            (int(row), value, before, after, bool(kept), self.units[unit])
            for row, value, before, after, kept, unit in zip(
                self.rows[some],
                self.values[some].tolist(),
                self.before[some].tolist(),
                self.after[some].tolist(),
                self.kept[some],
                self.unit_index[some],
                strict=True,
            )
        ]
        return Table.of("Residuals", columns, rows)

    def to_columns(self) -> Columns:
        """Return one row a reading."""
        return self._table(slice(None)).to_columns()


def units_of(readings: Readings) -> tuple[tuple[str, ...], Integers]:
    """Return the units of readings, and the index of each reading's, (n,)."""
    if isinstance(readings.unit, str):
        return (readings.unit,), np.zeros(len(readings), dtype=np.intp)
    units = tuple(dict.fromkeys(readings.unit))
    index = {unit: i for i, unit in enumerate(units)}
    return units, np.array([index[unit] for unit in readings.unit], dtype=np.intp)


def rms(r: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(r * r)))


def parameter_table(
    title: str, values: Mapping[str, float], std_errors: Mapping[str, float]
) -> Table:
    """Return parameters with their standard errors, one a row."""
    rows = [(n, *measured(value, std_errors[n]), unit_of(n)) for n, value in values.items()]
    return Table.of(title, ("parameter", "value", "standard error", "unit"), rows)


def labelled(id_: str, label: str) -> str:
    """Return a label with its id behind it; the id alone, in words, where there is no label.

    Of one of several measurements the id says which: the label need not.
    """
    own = label.removesuffix(f" ({id_.partition(':')[0]})") if ":" in id_ else label
    return f"{own} ({id_})" if label else id_.replace("_", " ")


def together(causes: Sequence[str]) -> str:
    """Say the causes of one set, sizes and all, as what acts together: "A, and B, together"."""
    return causes[0] if len(causes) == 1 else ", and ".join(causes) + ", together" * bool(causes)


def value_in_words(value: float, std: float | None, unit: str = "") -> str:
    """Say a value to the two leading digits of its standard error: ``4.82 ± 0.31 µm/h``."""
    said = plus_minus(value, std)
    return said if std is not None and not np.isfinite(std) else with_unit(said, unit)


def alternatives_table(
    alternatives: Sequence[Alternative], labels: Mapping[str, str] | None = None
) -> Table:
    """Return sets of causes with their distance from the best; labels where they are known."""
    known = labels or {}
    rows = [
        (
            " + ".join(known.get(i) or i for i in sorted(a.causes)) or NO_CAUSE,
            Shown(a.probability, percent(a.probability)),
            round(a.distance, 1) + 0.0,
            significant(a.rms_um),
        )
        for a in alternatives
    ]
    unit = alternatives[0].unit
    rms = with_unit("rms", unit and f"({unit})")
    columns = ("causes", "probability", "−2 ln L above the best", rms)
    return Table.of("Sets of causes", columns, rows, digits=1)
