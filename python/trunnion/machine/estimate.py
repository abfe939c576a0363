"""What a measurement says of a machine: one type for every kind of data and every consumer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, numbers
from trunnion.base.errors import FileFormatError, InputError
from trunnion.base.report import Result, Table, rough
from trunnion.base.saved import Gridded
from trunnion.base.stored import fitting, plain, read_json
from trunnion.base.units import Floats, unit_of
from trunnion.data.frame import ControlFrame
from trunnion.machine.budget import (
    COVERAGE_FACTOR,
    READINGS,
    Budget,
    Method,
    Source,
    drawn,
    measurand,
    root,
)
from trunnion.machine.effects import Moving, Owner, effect_id
from trunnion.machine.geometry import Geometry
from trunnion.machine.linear_axes import FieldMotion, LinearMotion, motion_from_dict

SECOND_ORDER = 1e-3
"""Components below this share of a combination are second-order and not named."""

ASSUMED_SIZE = {"arcsec": 5.0, "µm": 5.0, "µm/h": 5.0, "ppm": 10.0}
"""Of an effect that is not identifiable, by the unit of its parameter: 1 of any other."""
ALIKE = 0.9
"""Of the largest shift in standard errors, from which on another error is named beside it."""
MIN_BIAS = 0.5
"""Standard errors of a location error; a smaller shift of it is not mentioned."""
ROUNDING = 1e-9
"""µm, arcsec: data without noise have standard errors of 0."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an estimate.

    Attributes
    ----------
    name
        ``EX0C``, ``dx_um``, ``drift_z.rate_um_h``.
    value
        In `unit`.
    std_error
        Standard uncertainty; inf where the data do not identify it, None where it is not stated.
    owner
        What it belongs to.
    """

    name: str
    value: float
    std_error: float | None
    unit: str
    owner: Owner

    @property
    def identifiable(self) -> bool:
        """Whether the data say anything of it."""
        return self.std_error is None or bool(np.isfinite(self.std_error))


class Combinations(tuple[str, ...]):
    """Sentences that name the combinations of parameters which the data do not identify.

    ``"EY0A" in estimate.not_identifiable`` asks whether a parameter takes part in one.
    """

    __slots__ = ()

    def __contains__(self, what: object) -> bool:
        """Whether it is one of the sentences, or a parameter named in one."""
        if not isinstance(what, str):
            return False
        return any(what == text or what in text.rstrip(".").split() for text in self)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Estimate(Result):
    """Errors of a machine with their uncertainty, and what the data do not identify.

    The result of an identification, a closed form or a ball-bar identification is one, as is the
    model of a diagnosis and what :func:`read_estimate` reads; compensation, simulation and
    uncertainty take one. ``estimate["EX0C"]`` is a value.

    Attributes
    ----------
    errors
        Location errors by ISO 230-7 name, µm and arcsec; totals that include what was known
        beforehand.
    placement
        `dx_um` ... `rc_arcsec`; None where the method does not find it.
    effects
        Id (or the user's own effect) → parameter → value.
    std_errors
        Standard uncertainty by name (an effect's as "id.parameter"); inf for what the data do not
        identify.
    names
        Order of the rows of `covariance`; none where it is unknown.
    covariance
        Of what can be identified, (p, p), in products of the parameters' units.
    sigma_um
        Standard deviation of one reading.
    degrees_of_freedom
        Of the variance that the covariance rests on; inf where it was known beforehand.
    combinations
        What the data do not identify: parameter → component, for each combination that changes no
        reading, in the parameters' units.
    owners
        Effect's id → whose it is; of the machine where nothing is said.
    motions
        Id → how an effect that is not in the catalogue of the machine moves the tool.
    not_compensable
        Id → why an effect says nothing that a compensation could use.
    sources
        What the uncertainty comes from, each with its influence on the parameters in the order of
        `names`: readings, and what the set-up states of probe and artefact.
    tolerances
        Of location errors, as the set-up states them, µm and arcsec.
    geometry
        The axes that the location errors refer to: with a set-up that has others, they are
        refused. None: not stated.
    control_frame
        Work offset, tool length and corrections of the control that measured; what does not fit
        the set-up is not compensated. None: not stated.

    Examples
    --------
    >>> import trunnion as tn
    >>> known = tn.Estimate(errors={"EX0C": 15.0}, std_errors={"EX0C": 0.2})
    >>> known["EX0C"]
    15.0
    >>> known.to_dataframe()["estimate"].tolist()
    [15.0]
    """

    errors: dict[str, float] = field(default_factory=dict)
    placement: dict[str, float] | None = None
    effects: dict[Any, dict[str, float]] = field(default_factory=dict)
    std_errors: dict[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    sigma_um: float = 0.0
    degrees_of_freedom: float = np.inf
    combinations: tuple[dict[str, float], ...] = ()
    owners: dict[str, Owner] = field(default_factory=dict)
    motions: dict[str, Any] = field(default_factory=dict)
    not_compensable: dict[str, str] = field(default_factory=dict)
    sources: tuple[Source, ...] = ()
    tolerances: dict[str, float] = field(default_factory=dict)
    geometry: Geometry | None = None
    control_frame: ControlFrame | None = None

    def __post_init__(self) -> None:
        """Keep the shape of a covariance of nothing."""
        if not self.names:
            object.__setattr__(self, "covariance", np.zeros((0, 0)))

    def gridded(self) -> Gridded | None:
        """Return values, standard uncertainties and covariance by name, where it is known."""
        if not self.names:
            return None
        names, values = list(self.names), self.values
        found: dict[str, list[Any]] = {
            "estimate": [values.get(name, np.nan) for name in names],
            "std_error": [self.std_errors.get(name, np.nan) for name in names],
            "unit": [unit_of(name) for name in names],
        }
        arrays: dict[str, tuple[tuple[str, ...], NDArray[Any]]] = {
            name: (("parameter",), np.array(held)) for name, held in found.items()
        }
        arrays["covariance"] = (("parameter", "parameter_2"), self.covariance)
        return Gridded(dict.fromkeys(("parameter", "parameter_2"), names), arrays, {})

    # --- by name

    @property
    def values(self) -> dict[str, float]:
        """All values in one flat dict, by the names of `std_errors`."""
        flat = dict(self.errors)
        flat.update(self.placement or {})
        for effect, parameters in self.effects.items():
            flat.update({f"{effect_id(effect)}.{name}": v for name, v in parameters.items()})
        return flat

    def __getitem__(self, name: str) -> float:
        """Value of a parameter: ``fit["EX0C"]``, ``fit["drift_z.rate_um_h"]``."""
        values = self.values
        return values[choose("parameter", name, values)]

    def __contains__(self, name: object) -> bool:
        """Whether there is a parameter of this name."""
        return name in self.values

    def __iter__(self) -> Iterator[str]:
        """Names of all parameters."""
        return iter(self.values)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter with its uncertainty, unit and owner."""
        return tuple(
            Parameter(name, value, self.std_errors.get(name), unit_of(name), self._owner(name))
            for name, value in self.values.items()
        )

    def _owner(self, name: str) -> Owner:
        if name in self.errors:
            return Owner.MACHINE
        effect, dot, _ = name.partition(".")
        return self.owners.get(effect, Owner.MACHINE) if dot else Owner.PLACEMENT

    @property
    def not_identifiable(self) -> Combinations:
        """Sentences that name what the data do not identify, one a combination."""
        return Combinations(map(in_words, self.combinations))

    # --- uncertainty

    @checked
    def budget(
        self,
        names: Sequence[str] | None = None,
        *,
        tolerances: Mapping[str, float] | None = None,
        method: Method = "linear",
        draws: int = 20_000,
        seed: int = 0,
    ) -> Budget:
        """Uncertainty budget of parameters by the GUM.

        `std_errors` hold what the readings say; the budget adds what the set-up states of the
        calibration of probe and artefact and of temperature.

        Parameters
        ----------
        names
            Parameters; None: the location errors, or all parameters where there is none.
        tolerances
            Largest size allowed, by name; None: those of the set-up.
        method
            "linear" (JCGM 100:2008), or "monte-carlo" (JCGM 101:2008): inputs drawn from their own
            distributions, with the shortest interval of 95.45 %.
        draws, seed
            Of the Monte Carlo method.

        Raises
        ------
        UnknownNameError
            A name that is no parameter with a standard error, or a tolerance of none of these.
        InputError
            Fewer than 100 draws.
        """
        known = [n for n in self.std_errors if n in self.values]  # what is always fitted has none
        listed = [n for n in (self.errors or known) if n in known]
        wanted = listed if names is None else list(names)
        for name in wanted:
            choose("parameter", name, known)
        for name in tolerances or {}:
            choose("tolerance", name, wanted)
        order, sources = self._order(), self.uncertainty_sources()
        made = [
            measurand(
                name,
                self.values[name],
                np.array([float(name == other) for other in order]),
                sources,
                identifiable=bool(np.isfinite(self.std_errors[name])),
            )
            for name in wanted
        ]
        given = self.tolerances if tolerances is None else tolerances
        limits = {k: v for k, v in given.items() if tolerances is not None or k in wanted}
        budget = Budget(tuple(made), COVERAGE_FACTOR, "linear", limits)
        if method == "linear" or not sources:
            return budget
        at = [order.index(name) for name in wanted]
        values = np.array([self.values[name] for name in wanted])
        return drawn(budget, sources, lambda change: values + change[:, at], draws, seed)

    def _order(self) -> tuple[str, ...]:
        return self.names or tuple(self.std_errors)

    def uncertainty_sources(self) -> tuple[Source, ...]:
        """Return `sources`; where none are stated, one of the covariance or standard errors."""
        if self.sources:
            return self.sources
        std = np.array([self.std_errors.get(name, 0.0) for name in self._order()])
        matrix = self.covariance if self.names else np.diag(np.where(np.isfinite(std), std, 0) ** 2)
        rates = root(matrix)
        return (Source(READINGS, 1.0, "", rates, self.degrees_of_freedom),) if rates.size else ()

    # --- reports

    def tables(self) -> tuple[Table, ...]:
        """Estimates with standard errors."""
        rows = [
            (p.name, p.value if p.identifiable else None, p.std_error, p.unit)
            for p in self.parameters
        ]
        return (Table.of("Estimates", ("", "estimate", "std. error", "unit"), rows),)

    def sentences(self) -> list[str]:
        """What the data do not identify, and what no compensation follows."""
        return [
            *self.not_identifiable,
            *(f"{name} is not compensated: {why}." for name, why in self.not_compensable.items()),
        ]

    def headline(self) -> str:
        """Return how many parameters there are, and how many are not identifiable."""
        count = sum(not p.identifiable for p in self.parameters)
        return f"{len(self.values)} parameters, {count or 'none'} not identifiable"

    def derived(self) -> Mapping[str, Any]:
        """What is not identifiable, in words."""
        return {"not_identifiable": list(self.not_identifiable)}

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain values; what a user's own effect does is code and is left out."""
        stored = {k: v for k, v in self.motions.items() if isinstance(v, STORED)}
        code = {e.id for e in self.effects if isinstance(e, Moving)}
        code |= set(self.motions) - set(stored)
        why = "its motion is code of the user's own, which is not stored"
        return {
            **super().to_dict(),
            "effects": {effect_id(effect): dict(v) for effect, v in self.effects.items()},
            "motions": plain(stored),
            "not_compensable": self.not_compensable | dict.fromkeys(sorted(code), why),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the estimate that `to_dict` described."""
        if not isinstance(values, Mapping) or not isinstance(values.get("motions", {}), Mapping):
            return super().from_dict(values)
        found = super().from_dict({**values, "motions": {}})
        with fitting("motions"):
            motions = {k: motion_from_dict(v) for k, v in values.get("motions", {}).items()}
        return replace(found, motions=motions)


STORED = (LinearMotion, FieldMotion)


def named_combination(
    names: Sequence[str], direction: Floats, least: float = SECOND_ORDER
) -> dict[str, float]:
    """Parameters of a direction (p,) that changes no reading, with their components, largest 1.

    Those below the share `least` of the largest are left out.
    """
    pairs = zip(names, (direction / np.abs(direction).max()).tolist(), strict=True)
    return {name: component for name, component in pairs if abs(component) > least}


def in_words(combination: Mapping[str, float]) -> str:
    """A combination that changes no reading, as a sentence."""
    if len(combination) == 1:
        return f"Not identifiable: {next(iter(combination))}."
    return f"Not identifiable: {combined(combination)}."


def combined(combination: Mapping[str, float]) -> str:
    """Members of a combination with their components."""
    said = ((k, rough(v, 4, signed=True)) for k, v in combination.items())
    parts = (f"{k} ({size} {unit_of(k)})".replace(" )", ")") for k, size in said)
    return " together with ".join(parts)


def bias_in_words(
    combinations: Iterable[Mapping[str, float]], units: Mapping[str, str], std: Mapping[str, float]
) -> str:
    """Say what an effect that no reading shows would do to the location error it shifts most.

    Parameters
    ----------
    combinations
        What changes no reading: parameter → component.
    units
        Parameter of the effect ("id.name") → its unit.
    std
        Standard errors of the location errors; those that have none are left out.

    Returns
    -------
    str
        ``5 arcsec of it would shift EB0A by -5 arcsec``, of an :data:`ASSUMED_SIZE`; empty where
        no error shifts by :data:`MIN_BIAS`.
    """
    worst, text = MIN_BIAS, ""
    sizes = {k: ASSUMED_SIZE.get(unit, 1.0) for k, unit in units.items()}
    for row in combinations:
        most = max(abs(row[k]) / sizes[k] for k in sizes)
        if most == 0:
            continue
        # the first of those that are equal but for rounding
        largest = next(k for k in sizes if abs(row[k]) / sizes[k] > (1 - SECOND_ORDER) * most)
        step = {k: v * sizes[largest] / row[largest] for k, v in row.items()}
        known = {k: max(v, ROUNDING) for k, v in std.items() if np.isfinite(v)}
        ratio = {k: abs(step[k]) / least for k, least in known.items()}
        if max(ratio.values(), default=0.0) > (1 + SECOND_ORDER) * worst:
            worst = max(ratio.values())
            own = [k for k in sizes if abs(step[k]) > SECOND_ORDER * sizes[k]]
            named = {k: k.rsplit(".", 1)[-1] if len(sizes) > 1 else "it" for k in own}
            parts = " with ".join(f"{step[k]:.3g} {units[k]} of {named[k]}" for k in own)
            moved = shifts_in_words({k: -step[k] for k in ratio}, ratio, 3)
            text = f"{parts} would shift {moved}"
    return text


def shifts_in_words(shifts: Mapping[str, float], ratio: Mapping[str, float], digits: int) -> str:
    """Say the shift of the errors that an effect moves most: of all that it moves alike.

    ratio: Of each its shift in standard errors, without sign.
    """
    alike = [name for name in ratio if ratio[name] >= ALIKE * max(ratio.values())]
    return " and ".join(
        f"{name} by {f'{shifts[name]:+.{digits}g} {unit_of(name)}'.rstrip()}" for name in alike
    )


@checked
def read_estimate(path: str | PathLike[str]) -> Estimate:
    """Read an estimate: the dictionary of a result or a diagnosis, or names and values alone.

    Raises
    ------
    FileFormatError
        If the file is not JSON, or holds neither.

    Examples
    --------
    >>> import trunnion as tn
    >>> _ = tn.Estimate(errors={"EX0C": 15.0}).to_json("estimate.json")
    >>> tn.read_estimate("estimate.json")["EX0C"]
    15.0
    """
    try:
        content, _ = read_json(Path(path))
    except FileFormatError as error:
        made = "trunnion estimate TOUCHES SETUP -o estimate.json"
        raise FileFormatError(f"{error} of an estimate, as {made} writes it") from None
    expected = 'a table of errors {"EX0C": 15.0, ...} or the JSON of a result with "errors"'
    if not isinstance(content, dict):
        raise FileFormatError(f"{path}:1:1: got {type(content).__name__}, expected {expected}")
    # What `trunnion estimate --json` writes: results by method, the most general one first.
    for method in ("least-squares", "separating"):
        if isinstance(content.get(method), dict):
            content = content[method]
    # What `trunnion diagnose --json` writes: the model that it comes to.
    if isinstance(content.get("model"), dict):
        content = content["model"]
    if "errors" not in content:
        return Estimate(errors=_numbers(path, "errors", content))
    effects = content.get("effects") or {}
    if not isinstance(effects, dict):
        raise FileFormatError(f"{path}: effects: got {effects!r}, expected id → parameter → value")
    known = {k: v for k, v in content.items() if k in {item.name for item in fields(Estimate)}}
    try:
        return Estimate.from_dict(
            {
                **known,
                "errors": _numbers(path, "errors", content["errors"]),
                "effects": {k: _numbers(path, f"effects.{k}", v) for k, v in effects.items()},
            }
        )
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error


def _numbers(path: str | PathLike[str], what: str, values: object) -> dict[str, float]:
    try:
        return numbers(what, values)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error
