"""Whether a value keeps its tolerance, with its uncertainty: the decision rule of ISO 14253-1.

Conformity is proved where the value keeps the tolerance by a guard band g = k u, non-conformity
where it exceeds it by as much; between the two nothing is proved. k is that of the chance of a
wrong decision by a normal law: at the standard's default of 95 %, 1.645 where one limit can be
exceeded. Where u is not small against the width of the tolerance both can, and k of conformity
solves

    Φ((U - x) / u) - Φ((L - x) / u) = 95 %  at  x = U - k u,

up to 1.960 in the middle of a tolerance U - L = 2 · 1.960 u. In a narrower one nothing conforms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import inf, isfinite

from scipy.special import ndtr, ndtri

from trunnion.base.checks import choose, numbers
from trunnion.base.errors import InputError
from trunnion.base.report import Cell, Result, Table, measured, significant
from trunnion.base.units import unit_of

PROBABILITY = 0.95


class Decision(StrEnum):
    """What is proved of a tolerance."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"


def guard_factor(probability: float, width: float = float("inf")) -> float:
    """Return k of the guard band, by the probability of conformity that is asked for.

    width: Of the tolerance, in standard uncertainties; inf: it has one limit.
    """
    if not 0.5 <= probability < 1:
        raise InputError(f"probability: got {probability:g}, expected 0.5 to below 1")
    one_limit, both_limits = float(ndtri(probability)), float(ndtri((1 + probability) / 2))
    if width <= 2 * both_limits:
        return both_limits

    def lacking(k: float) -> float:
        return float(ndtr(k) - ndtr(k - width)) - probability

    # What the far limit takes may be less than rounding.
    if lacking(one_limit) >= 0:
        return one_limit
    from scipy.optimize import brentq  # takes 0.1 s to load

    return float(brentq(lacking, one_limit, width / 2))


def guard_band(std: float, width: float, probability: float = PROBABILITY) -> float:
    """Return the guard band inside a tolerance of this width; 0 without uncertainty."""
    return guard_factor(probability, width / std) * std if std > 0 else 0.0


def decide(
    value: float,
    std: float,
    *,
    upper: float = float("inf"),
    lower: float = float("-inf"),
    probability: float = PROBABILITY,
) -> Decision:
    """Decide by ISO 14253-1 of a value with standard uncertainty and its limits.

    An uncertainty that is not known (inf) proves nothing.

    Raises InputError: an uncertainty that is negative or no number, or no value that has one.
    """
    _check(value, std)
    guard = guard_band(std, upper - lower, probability)
    if lower + guard <= value <= upper - guard:
        return Decision.PASS
    # Beyond one limit the other is farther still.
    beyond = guard_factor(probability) * std
    if value >= upper + beyond or value <= lower - beyond:
        return Decision.FAIL
    return Decision.UNDECIDED


def _check(value: float, std: float, where: str = "") -> None:
    """Refuse what no decision rests on: comparisons with it would decide."""
    if not std >= 0:
        raise InputError(
            f"{where}standard uncertainty: got {std:g}, expected 0 or above (inf: not known)"
        )
    if not isfinite(value) and std < inf:
        raise InputError(f"{where}value: got {value:g}, expected a finite number")


@dataclass(frozen=True)
class Judged:
    """One quantity against its tolerance.

    Attributes
    ----------
    name
        As the result calls it.
    value, std_error
        Size of the quantity, and its standard uncertainty.
    tolerance, guard
        Largest size allowed (the limits are ± the tolerance), and the guard band inside it.
    decision
        "pass", "fail" or "undecided".
    label
        What people call it.
    signed
        The quantity with its sign; None: not known, of JSON of an older version.
    """

    name: str
    value: float
    std_error: float
    tolerance: float
    guard: float
    decision: Decision
    label: str = ""
    signed: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Conformity(Result):
    """Quantities against their tolerances, by ISO 14253-1.

    Attributes
    ----------
    judged
        One a tolerance.
    probability
        Of conformity, at least, where "pass" is said; of non-conformity where "fail" is.

    Examples
    --------
    >>> import trunnion as tn
    >>> axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    >>> axis.iso230_2().conformity(accuracy_um=40.0).decision.value
    'pass'
    """

    judged: tuple[Judged, ...]
    probability: float

    @classmethod
    def of(
        cls,
        values: Mapping[str, float],
        std_errors: Mapping[str, float],
        tolerances: Mapping[str, float],
        *,
        more: float = 0.0,
        probability: float = PROBABILITY,
        labels: Mapping[str, str] | None = None,
    ) -> Conformity:
        """Of sizes (without sign) by name; ``more``: standard uncertainty beside the given one.

        Raises InputError: no tolerance, one that is not above 0, or of an unknown quantity; an
            uncertainty that is negative or no number, or no value that has one.
        """
        if not tolerances:
            raise InputError(f"tolerance: got none, expected one of {', '.join(values)}")
        if not 0 <= more < float("inf"):
            raise InputError(f"standard uncertainty: got {more:g}, expected 0 or above")
        out = []
        for name, tolerance in numbers("tolerance", tolerances).items():
            choose("quantity", name, values)
            if not tolerance > 0:
                raise InputError(f"{name}: got {tolerance:g}, expected a tolerance above 0")
            _check(values[name], std_errors[name], f"{name}: ")
            size, std = abs(values[name]), float((std_errors[name] ** 2 + more**2) ** 0.5)
            guard = guard_band(std, 2 * tolerance, probability)
            decision = decide(size, std, upper=tolerance, lower=-tolerance, probability=probability)
            label, signed = (labels or {}).get(name, ""), float(values[name])
            out.append(Judged(name, size, std, float(tolerance), guard, decision, label, signed))
        return cls(tuple(out), probability)

    @property
    def decision(self) -> Decision:
        """Pass where everything passes, fail where anything fails."""
        found = {j.decision for j in self.judged}
        if Decision.FAIL in found:
            return Decision.FAIL
        return Decision.UNDECIDED if Decision.UNDECIDED in found else Decision.PASS

    def derived(self) -> Mapping[str, str]:
        """The decision over all tolerances."""
        return {"decision": str(self.decision)}

    def headline(self) -> str:
        """The decision."""
        return str(self.decision)

    def sentences(self) -> Sequence[str]:
        """The decision, and of what it is not proved."""
        said = {
            Decision.PASS: "Pass: conformity is proved",
            Decision.FAIL: "Fail: non-conformity is proved",
            Decision.UNDECIDED: "Undecided: the uncertainty is too large to prove either",
        }[self.decision]
        return (f"{said} (ISO 14253-1, {100 * self.probability:.3g} %).",)

    def tables(self) -> tuple[Table, ...]:
        """One quantity a row."""
        rows: list[tuple[Cell, ...]] = [
            (
                j.label or j.name,
                *measured(j.value if j.signed is None else j.signed, j.std_error),
                significant(j.guard),
                significant(j.tolerance, 4),
                unit_of(j.name),
                str(j.decision),
            )
            for j in self.judged
        ]
        heads = ("", "value", "standard uncertainty", "guard band", "tolerance", "unit", "decision")
        return (Table.of("Conformity", heads, rows),)
