"""What a measurement says of a machine: one type for every kind of data and every consumer."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from trunnion.base.errors import FileFormatError, UnknownNameError
from trunnion.base.units import Floats
from trunnion.machine.effects import Motion, effect_id

__all__ = ["Estimate", "read_estimate"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """Errors of a machine with their uncertainty, and what the data do not identify.

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
        Order of the rows of `covariance`.
    covariance
        Of what can be identified, (p, p), in products of the parameters' units; None: unknown.
    sigma_um
        Standard deviation of one reading.
    degrees_of_freedom
        Of the variance that the covariance rests on; inf where it was known beforehand.
    motions
        Id → how an effect that is not in the catalogue of the machine moves the tool.
    not_compensable
        Id → why an effect says nothing that a compensation could use.
    """

    errors: dict[str, float] = field(default_factory=dict)
    placement: dict[str, float] | None = None
    effects: dict[Any, dict[str, float]] = field(default_factory=dict)
    std_errors: dict[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    covariance: Floats | None = None
    sigma_um: float = 0.0
    degrees_of_freedom: float = np.inf
    motions: Mapping[str, Motion] = field(default_factory=dict, repr=False)
    not_compensable: Mapping[str, str] = field(default_factory=dict)

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
        if name not in values:
            raise UnknownNameError(f"parameter: got {name!r}, expected one of {', '.join(values)}")
        return values[name]

    def __contains__(self, name: object) -> bool:
        """Whether there is a parameter of this name."""
        return name in self.values

    def __iter__(self) -> Iterator[str]:
        """Names of all parameters."""
        return iter(self.values)


def read_estimate(path: str | PathLike[str]) -> Estimate:
    """Read an estimate: the dictionary of a result, or names and values alone.

    Raises
    ------
    FileFormatError
        If the file is not JSON, or holds neither.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: got bytes that are not UTF-8 at {error.start}") from None
    except json.JSONDecodeError as error:
        raise FileFormatError(
            f"{path}:{error.lineno}:{error.colno}: got no JSON ({error.msg}), expected an estimate"
        ) from None
    expected = 'a table of errors {"EX0C": 15.0, ...} or the JSON of a result with "errors"'
    if not isinstance(content, dict):
        raise FileFormatError(f"{path}:1:1: got {type(content).__name__}, expected {expected}")
    # What `trunnion estimate --json` writes: results by method, the most general one first.
    for method in ("least-squares", "separating"):
        if isinstance(content.get(method), dict):
            content = content[method]
    if "errors" not in content:
        return Estimate(errors=_numbers(path, "errors", content))
    effects = content.get("effects") or {}
    if not isinstance(effects, dict):
        raise FileFormatError(f"{path}: effects: got {effects!r}, expected id → parameter → value")
    std_errors, covariance = content.get("std_errors") or {}, content.get("covariance")
    return Estimate(
        errors=_numbers(path, "errors", content["errors"]),
        effects={name: _numbers(path, f"effects.{name}", v) for name, v in effects.items()},
        std_errors={name: float(value) for name, value in std_errors.items()},
        names=tuple(content.get("names", ())),
        covariance=None if covariance is None else np.asarray(covariance, dtype=float),
        degrees_of_freedom=float(content.get("degrees_of_freedom", float("inf"))),
    )


def _numbers(path: str | PathLike[str], what: str, values: object) -> dict[str, float]:
    if not isinstance(values, dict):
        raise FileFormatError(f"{path}: {what}: got {values!r}, expected names with numbers")
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise FileFormatError(f"{path}: {what}.{name}: got {value!r}, expected a finite number")
    return {name: float(value) for name, value in values.items()}
