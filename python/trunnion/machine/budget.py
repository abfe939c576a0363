"""Uncertainty budgets by the GUM: what contributes to the uncertainty of a quantity, and how much.

An estimate is linear in its inputs (readings, a ball radius, a calibrated length) about where it
is: :class:`Source` holds how each moves the estimate's parameters. A quantity that follows from
these (a location error, a volumetric error) has the gradient g: a source contributes
``std · |gᵀ rates|``, contributions add in squares (JCGM 100:2008, 5.1.2), degrees of freedom by
Welch and Satterthwaite (G.4). The Monte Carlo method (JCGM 101:2008) draws the inputs from their
own distributions: Student's t where the variance was estimated, rectangular for a resolution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from trunnion.base.checks import choose, whole
from trunnion.base.conformity import Conformity
from trunnion.base.report import Cell, Result, Shown, Table, measured, significant
from trunnion.base.units import Floats, unit_of

COVERAGE_FACTOR = 2.0
COVERAGE = 0.9545
"""Of a normal law within two standard deviations."""
BLOCK = 500_000
MAX_DRAWS = 1_000_000
"""Numbers that are drawn at a time."""
MIN_SHOWN = 1e-4
"""Share of the variance; smaller contributions count but are not listed."""
MANY = 100.0  # degrees of freedom from which they are whole
NEVER_ENDING = 1e6  # beyond, Student's t is the normal distribution to all digits
EMPTY = "No error or cause with a standard uncertainty was found: there is no budget."
READINGS = "readings"
RESOLUTION = "resolution of the readings"
MODEL = "model selection"
SHAPE = "shape of processes in time"
SHARED = (READINGS, RESOLUTION, MODEL, SHAPE)
"""Sources that rest on the same readings."""

Method = Literal["linear", "monte-carlo"]
Shape = Literal["normal", "rectangular"]


@dataclass(frozen=True, eq=False)
class Source:
    """Inputs of one kind, of one standard uncertainty, independent of each other.

    Attributes
    ----------
    name
        What people call it: "readings", "artefact length".
    std, unit
        Standard uncertainty of one input.
    rates
        Change of each parameter of the estimate per unit of each input, shape (p, m).
    degrees_of_freedom
        Of ``std``; inf where it was stated.
    shape
        Law of the input; one whose degrees of freedom are finite is Student's t.
    """

    name: str
    std: float
    unit: str
    rates: Floats
    degrees_of_freedom: float = np.inf
    shape: Shape = "normal"

    def covariance(self) -> Floats:
        """Return what it adds to the covariance of the parameters, shape (p, p)."""
        return np.asarray(self.std**2 * self.rates @ self.rates.T)

    def drawn(self, random: np.random.Generator, count: int) -> Floats:
        """Draw changes of the parameters, shape (count, p)."""
        size = (count, self.rates.shape[1])
        if self.shape == "rectangular":
            inputs = random.uniform(-np.sqrt(3), np.sqrt(3), size)
        else:
            inputs = random.standard_normal(size)
            if np.isfinite(self.degrees_of_freedom):
                nu = max(self.degrees_of_freedom, 1.0)
                inputs /= np.sqrt(random.chisquare(nu, count) / nu)[:, None]
        return np.asarray(self.std * inputs @ self.rates.T)


@dataclass(frozen=True, eq=False)
class Input:
    """What readings depend on and what is known only within a standard uncertainty (type B).

    Attributes
    ----------
    name, std, unit, shape
        As of :class:`Source`.
    columns
        Change of each reading per unit of each input, shape (n, m).
    keys
        What each input is one of, (m,): the same key of the same name is the same input in another
        measurement. By default their numbers.
    """

    name: str
    std: float
    unit: str
    columns: Floats
    shape: Shape = "normal"
    keys: tuple[float, ...] = ()

    def source(self, rates: Floats) -> Source:
        """Return the source that it is of an estimate with these rates (p, m)."""
        return Source(self.name, self.std, self.unit, rates, shape=self.shape)


def root(covariance: Floats) -> Floats:
    """R with R Rᵀ = covariance, columns of nothing left out; of each the largest is positive."""
    values, vectors = np.linalg.eigh(covariance)
    some = values > 1e-14 * max(float(values.max(initial=0.0)), 0.0)
    found = vectors[:, some] * np.sqrt(values[some])
    if not found.size:
        return np.asarray(found)
    # The sign of an eigenvector hangs on rounding.
    largest = np.take_along_axis(found, np.abs(found).argmax(axis=0)[None], axis=0)
    return np.asarray(found * np.sign(largest))


def of_readings(
    covariance: Floats, sigma: float, unit: str, rounding: float, degrees_of_freedom: float
) -> tuple[Source, ...]:
    """Sources of a covariance (p, p) that rests on readings with noise ``sigma``.

    ``rounding``: the part of the noise that is the resolution of the readings.
    """
    if sigma <= 0 or not len(covariance):
        return ()
    rates = root(covariance / sigma**2)
    scatter = float(np.sqrt(max(sigma**2 - rounding**2, 0.0)))
    freedom = float(degrees_of_freedom)
    found = [Source(READINGS, scatter, unit, rates, freedom)]
    if rounding > 0:
        freedom = freedom if scatter > 0 else np.inf
        size = min(rounding, sigma)
        found.append(Source(RESOLUTION, size, unit, rates, freedom, shape="rectangular"))
    return tuple(found)


@dataclass(frozen=True)
class Line:
    """One source in the budget of one quantity.

    Attributes
    ----------
    source
        What people call it.
    std, unit
        Standard uncertainty of one input.
    sensitivity
        Change of the quantity per unit of the input (of inputs of one kind, the root of the sum of
        squares).
    contribution
        Standard uncertainty of the quantity that is due to it, in the quantity's unit.
    degrees_of_freedom
        Of the input's uncertainty.
    """

    source: str
    std: float
    unit: str
    sensitivity: float
    contribution: float
    degrees_of_freedom: float


@dataclass(frozen=True)
class Measurand:
    """A quantity with its budget.

    Attributes
    ----------
    name, value, unit
        As the estimate has it; None where it is not identifiable.
    lines
        Contributions in descending order.
    std
        Combined standard uncertainty; inf: not identifiable.
    interval
        Shortest interval that holds 95.45 % of the drawn values; None: none were drawn.
    """

    name: str
    value: float
    unit: str
    lines: tuple[Line, ...]
    std: float
    interval: tuple[float, float] | None = None

    @property
    def degrees_of_freedom(self) -> float:
        """Effective degrees of freedom by Welch and Satterthwaite.

        What rests on the same readings is not independent: their noise, its part that is
        resolution, and the doubt between models enter together.
        """
        parts = [(x.contribution**2, x.degrees_of_freedom) for x in self.lines]
        shared = [part for part, x in zip(parts, self.lines, strict=True) if x.source in SHARED]
        others = [part for part, x in zip(parts, self.lines, strict=True) if x.source not in SHARED]
        together = sum(square for square, _ in shared)
        freedom = min((nu for square, nu in shared if square > 0), default=np.inf)
        fourth = sum(square**2 / max(nu, 1.0) for square, nu in [*others, (together, freedom)])
        squares = sum(square for square, _ in parts)
        return squares**2 / fourth if fourth > 0 else np.inf


@dataclass(frozen=True, eq=False, repr=False)
class Budget(Result):
    """Uncertainty budgets of some quantities: ``budget["EX0C"]`` is one.

    Attributes
    ----------
    measurands
        The quantities.
    coverage_factor
        k of the expanded uncertainty U = k u.
    method
        "linear": the law of propagation of uncertainty; "monte-carlo": by draws of the inputs.
    tolerances
        Largest size allowed, by name, of those that have a tolerance.
    draws, seed
        Of the Monte Carlo method; 0 draws: linear.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> budget = tn.identify(touches, setup).budget()
    >>> round(budget.expanded["EX0C"], 2)  # U, k = 2, µm
    0.17
    """

    measurands: tuple[Measurand, ...]
    coverage_factor: float = COVERAGE_FACTOR
    method: Method = "linear"
    tolerances: Mapping[str, float] = field(default_factory=dict)
    draws: int = 0
    seed: int = 0

    def __getitem__(self, name: str) -> Measurand:
        """Budget of a quantity."""
        known = {m.name: m for m in self.measurands}
        return known[choose("measurand", name, known)]

    @property
    def expanded(self) -> dict[str, float]:
        """Expanded uncertainty U = k u by name."""
        return {m.name: self.coverage_factor * m.std for m in self.measurands}

    @property
    def conformity(self) -> Conformity | None:
        """The tolerances by ISO 14253-1; None where there is none."""
        if not self.tolerances:
            return None
        values = {m.name: m.value for m in self.measurands}
        return Conformity.of(values, {m.name: m.std for m in self.measurands}, self.tolerances)

    def derived(self) -> Mapping[str, Any]:
        """Expanded uncertainties."""
        return {"expanded": self.expanded}

    def title(self) -> str:
        """Name the result."""
        return "Uncertainty budget"

    def sentences(self) -> Sequence[str]:
        """Where the uncertainty comes from, and whether tolerances are kept."""
        if not self.measurands:
            return (EMPTY,)
        conformity = self.conformity
        how = (
            "GUM, law of propagation" if self.method == "linear" else f"{self.draws} draws, GUM S1"
        )
        lines = [
            f"Expanded uncertainties U = k u with k = {self.coverage_factor:g} ({how}).",
            *(f"{m.name} is not identifiable." for m in self.measurands if not np.isfinite(m.std)),
        ]
        return [*lines, *(conformity.sentences() if conformity else ())]

    def tables(self) -> tuple[Table, ...]:
        """All quantities; conformity where there are tolerances; one table a quantity."""
        if not self.measurands:
            return ()
        conformity = self.conformity
        tables = [self._overview(), *(conformity.tables() if conformity else ())]
        return (*tables, *(_table(m) for m in self.measurands if m.lines))

    def _overview(self) -> Table:
        rows: list[tuple[Cell, ...]] = []
        for m in self.measurands:
            value, expanded = measured(m.value, self.coverage_factor * m.std)
            most = m.lines[0].source if m.lines and m.lines[0].contribution > 0 else ""
            nu = freedom(m.degrees_of_freedom)
            interval = () if m.interval is None else map(significant, m.interval)
            cells = (value, measured(m.value, m.std)[1], expanded, m.unit, nu, most, *interval)
            rows.append((m.name, *cells))
        heads = ["", "value", "u", f"U (k = {self.coverage_factor:g})", "unit", "ν", "most due to"]
        if self.method == "monte-carlo":
            heads += ["95.45 % from", "to"]
        return Table.of("Uncertainty budget", heads, rows)


def freedom(value: float) -> Shown:
    """Return degrees of freedom as people print them."""
    text = "∞" if value > NEVER_ENDING else f"{value:.0f}" if value >= MANY else f"{value:.3g}"
    return Shown(value, text)


def _table(m: Measurand) -> Table:
    square = max(sum(line.contribution**2 for line in m.lines), 1e-300)
    rows = [
        (
            line.source,
            significant(line.std),
            line.unit,
            significant(line.sensitivity),
            significant(line.contribution),
            f"{100 * line.contribution**2 / square:.0f} %",
            freedom(line.degrees_of_freedom),
        )
        for line in m.lines
        if line.contribution**2 >= MIN_SHOWN * square
    ]
    heads = ("source", "u of one", "unit", "sensitivity", f"u ({m.unit})", "share", "ν")
    return Table.of(f"Budget of {m.name}", heads, rows)


def measurand(
    name: str,
    value: float,
    gradient: Floats,
    sources: Sequence[Source],
    *,
    identifiable: bool = True,
) -> Measurand:
    """Return the budget of a quantity with this gradient (p,) by the estimate's parameters."""
    lines = []
    for source in sources:
        rate = float(np.linalg.norm(gradient @ source.rates))
        lines.append(
            Line(
                source.name,
                float(source.std),
                source.unit,
                rate,
                float(source.std * rate),
                float(source.degrees_of_freedom),
            )
        )
    lines.sort(key=lambda line: -line.contribution)
    std = float(np.sqrt(sum(line.contribution**2 for line in lines))) if identifiable else np.inf
    return Measurand(name, float(value), unit_of(name), tuple(lines), std)


def drawn(
    budget: Budget,
    sources: Sequence[Source],
    of: Callable[[Floats], Floats],
    draws: int,
    seed: int,
) -> Budget:
    """Return a budget with standard uncertainties and intervals by the Monte Carlo method.

    ``of``: the quantities (count, q) at drawn changes of the estimate's parameters (count, p).
    """
    whole("draws", draws, 100, MAX_DRAWS)
    whole("seed", seed, 0)
    random = np.random.default_rng(seed)
    width = max((max(s.rates.shape) for s in sources), default=1)
    values = []
    for first in range(0, draws, max(1, BLOCK // width)):
        count = min(max(1, BLOCK // width), draws - first)
        changes = sum(
            (s.drawn(random, count) for s in sources), np.zeros((count, sources[0].rates.shape[0]))
        )
        values.append(of(changes))
    found = np.concatenate(values)
    made = [
        replace(m, std=float(np.std(x, ddof=1)), interval=_shortest(x)) if np.isfinite(m.std) else m
        for m, x in zip(budget.measurands, found.T, strict=True)
    ]
    return replace(budget, measurands=tuple(made), method="monte-carlo", draws=draws, seed=seed)


def _shortest(values: Floats) -> tuple[float, float]:
    """Shortest interval that holds the share `COVERAGE` of the values (JCGM 101:2008, 7.7)."""
    ordered = np.sort(values)
    inside = min(int(np.ceil(COVERAGE * len(ordered))), len(ordered) - 1)
    first = int(np.argmin(ordered[inside:] - ordered[: len(ordered) - inside]))
    return float(ordered[first]), float(ordered[first + inside])
