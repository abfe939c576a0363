"""Results of an estimation: what was found, how well, and what could not be seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import special

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, within
from trunnion.base.report import Cell, Result, Table
from trunnion.base.units import Floats, Integers, unit_of
from trunnion.machine.estimate import Estimate

# The paper's Table 2 prints these differences under these names.
DIFFERENCES = (("EB0C", "EB0A"), ("EY0C", "EY0A"), ("EX0C", "EX0B"), ("EA0C", "EA0B"))


DOUBT = 1e-4
"""Tail probability of the residuals below which the model is doubted."""
NO_PROBE_UM = 5.0
"""Residuals larger than this are not a touch probe's scatter, µm."""


@dataclass(frozen=True)
class LackOfFit:
    """Scatter about the model against scatter of repeated touches (pure error).

    Attributes
    ----------
    f, p_value
        F statistic and its tail probability: small when the model leaves more than repeats scatter.
    pure_error_um
        Standard deviation of a reading by the repeats alone.
    degrees_of_freedom
        Of lack of fit and of pure error.
    """

    f: float
    p_value: float
    pure_error_um: float
    degrees_of_freedom: tuple[int, int]


def lack_of_fit(
    residuals_um: Floats, repeats: Integers, parameters: int, least_um: float = 0.0
) -> LackOfFit | None:
    """Lack of fit where touches repeat; None where there are no repeats.

    Parameters
    ----------
    residuals_um
        Residuals, (n,).
    repeats
        Number of the group of equal touches of each row, (n,).
    parameters
        How many parameters were determined.
    least_um
        Least standard deviation of a reading: repeats on a grid of ticks agree too well.
    """
    _, index = np.unique(repeats, return_inverse=True)
    groups = int(index.max(initial=-1)) + 1
    pure = len(residuals_um) - groups
    lack = groups - parameters
    if pure <= 0 or lack <= 0:
        return None
    counts = np.bincount(index)
    means = np.bincount(index, weights=residuals_um) / counts
    within = float(np.sum((residuals_um - means[index]) ** 2))
    within = max(within, pure * least_um**2)
    between = float(np.sum(counts * means**2))
    if within == 0:
        return None
    f = (between / lack) / (within / pure)
    return LackOfFit(
        f=f,
        p_value=float(special.fdtrc(lack, pure, f)),
        pure_error_um=float(np.sqrt(within / pure)),
        degrees_of_freedom=(lack, pure),
    )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class IdentificationResult(Estimate):
    """Location errors, placement and effects estimated from touches: an :class:`Estimate`.

    `degrees_of_freedom` are readings and priors less parameters that could be determined.

    Attributes
    ----------
    method
        How: "least squares", "separating closed forms", "casadi gauss-newton", ...
    residuals_um
        Recorded minus modelled coordinate along the approach, (n,).
    converged
        Whether the last step was within rounding.
    at_bound
        Parameters that stand at a bound or at the end of their search.
    weights
        Weight of each reading, (n,): below 1 where a robust loss lowered it, 0 of a row that
        repeats another; None: 1 each.
    lack_of_fit
        Where touches repeat.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> fit = tn.identify(touches, setup)
    >>> fit.converged, len(fit.residuals_um)
    (True, 72)
    >>> round(fit.placement["dx_um"], 1)
    50.1
    """

    method: str
    residuals_um: Floats
    converged: bool
    at_bound: tuple[str, ...] = ()
    weights: Floats | None = None
    lack_of_fit: LackOfFit | None = None
    notes: tuple[str, ...] = ()

    def title(self) -> str:
        """Name the result."""
        return "Location errors"

    @property
    def rms_um(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self._own_residuals_um**2)))

    @property
    def _own_residuals_um(self) -> Floats:
        """Residuals of the rows that are readings of their own."""
        if self.weights is None:
            return self.residuals_um
        own: Floats = self.residuals_um[self.weights > 0]
        return own

    @property
    def correlations(self) -> Floats:
        """Correlation matrix of the estimates, (p, p); zero for what is not identifiable."""
        spread = np.sqrt(np.diag(self.covariance))
        scale: Floats = np.where(spread > 0, 1.0 / np.where(spread > 0, spread, 1.0), 0.0)
        correlations: Floats = self.covariance * np.outer(scale, scale)
        return correlations

    @checked
    def interval(self, name: str, coverage: float = 0.95) -> tuple[float, float]:
        """Confidence interval of a parameter, by Student's t."""
        choose("name", name, self.std_errors)
        within("coverage", coverage, 1e-9, 1 - 1e-9)
        half = self.std_errors[name] * float(
            special.stdtrit(max(self.degrees_of_freedom, 1), 0.5 + coverage / 2)
        )
        value = self.values[name]
        return value - half, value + half

    def tables(self) -> tuple[Table, ...]:
        """Estimates with standard errors; the differences that the paper prints come last."""
        (plain,) = super().tables()
        pairs = [pair for pair in DIFFERENCES if set(pair) <= set(self.errors)]
        rows = [*plain.rows, *(self._difference(*pair) for pair in pairs)]
        return (Table.of(f"Estimates ({self.method})", plain.columns, rows),)

    def _difference(self, first: str, second: str) -> tuple[Cell, ...]:
        value: float | None = self.errors[first] - self.errors[second]
        error = None
        if {first, second} <= set(self.names):
            at = [self.names.index(first), self.names.index(second)]
            own = self.covariance[np.ix_(at, at)]
            error = float(np.sqrt(own[0, 0] + own[1, 1] - 2 * own[0, 1]))
            if not (np.isfinite(self.std_errors[first]) and np.isfinite(self.std_errors[second])):
                value, error = None, float("inf")
        return (f"{first}−{second}", value, error, unit_of(first))

    def sentences(self) -> list[str]:
        """What is worth saying beside the table."""
        count = len(self._own_residuals_um)
        lines = [
            f"{count} touches, {self.degrees_of_freedom:g} degrees of freedom, "
            f"residuals {self.rms_um:.4f} µm rms, one reading {self.sigma_um:.4f} µm (1 σ)."
        ]
        if not self.converged:
            lines.append("Did NOT converge: do not use these numbers.")
        lines.extend(self._doubts())
        lines.extend(Estimate.sentences(self))
        lines.extend(f"{name} stands at the end of its range." for name in self.at_bound)
        if self.lack_of_fit is not None:
            fit = self.lack_of_fit
            lines.append(
                f"Lack of fit against repeated touches ({fit.pure_error_um:.4f} µm): "
                f"F{fit.degrees_of_freedom} = {fit.f:.2f}, p = {fit.p_value:.3g}."
            )
        lines.extend(self.notes)
        return lines

    def _doubts(self) -> list[str]:
        """What the size of the residuals says about the model."""
        freedom = max(self.degrees_of_freedom, 1)
        squares = float(np.sum(self._own_residuals_um**2))
        if self.sigma_um > 0 and special.chdtrc(freedom, squares / self.sigma_um**2) < DOUBT:
            return [
                f"Residuals are {np.sqrt(squares / freedom) / self.sigma_um:.1f} times what the "
                "set-up says of the probe: the model leaves something out, and the standard errors "
                "are too small (tn.diagnose looks for the cause)."
            ]
        if self.rms_um > NO_PROBE_UM:
            return [
                f"Residuals of {self.rms_um:.1f} µm are more than a touch probe scatters: check "
                "the signs of the axes (sense), the artefact's dimensions and the ball's radius, "
                "or let tn.diagnose look for the cause."
            ]
        return []

    def derived(self) -> Mapping[str, Any]:
        """What is worth saying beside the numbers."""
        return {**super().derived(), "doubts": self._doubts()}


@dataclass(frozen=True, eq=False, repr=False)
class PerPosition(Result):
    """The paper's estimates at every position before they are averaged.

    Attributes
    ----------
    c
        One dict a position of C (A = 0): `c_deg` and EA, EB_C, EC (arcsec), EX, EY_C, EZ (µm) by
        equations (3) to (8).
    a
        One dict a position of A (C = 0): `a_deg` and EB_A (arcsec), EY_A (µm) by (9), (10).
    """

    c: tuple[dict[str, float], ...]
    a: tuple[dict[str, float], ...]

    def headline(self) -> str:
        """How many positions there are."""
        return f"estimates at {len(self.c)} positions of C and {len(self.a)} of A"

    def tables(self) -> tuple[Table, Table]:
        """One table for C, one for A."""

        def table(title: str, rows: tuple[dict[str, float], ...]) -> Table:
            columns = list(rows[0]) if rows else []
            cells = [[row[column] for column in columns] for row in rows]
            return Table.of(title, columns, cells)

        return (
            table("Equations (3) to (8), µm and arcsec, per position of C", self.c),
            table("Equations (9), (10), µm and arcsec, per position of A", self.a),
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ClosedFormResult(IdentificationResult):
    """Result of a closed form.

    Attributes
    ----------
    per_position
        The paper's estimates at every A and C before averaging (also with the separating forms).
    checks_um
        The two combinations of readings that the separating forms leave over, κ and ζ, each with
        the standard deviation it should have; empty for the printed forms.
    sees
        What the method can see and what it cannot, as a sentence.
    slips
        Corrections made to the printed equations, each with its reason; empty for the others.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> found = tn.closed_form(touches, setup, method="separating")
    >>> round(found["EB0C"], 2), round(found.std_errors["EB0C"], 2)
    (25.16, 0.69)
    """

    per_position: PerPosition = field(default_factory=lambda: PerPosition((), ()))
    checks_um: dict[str, tuple[float, float]] = field(default_factory=dict)
    sees: str = ""
    slips: tuple[str, ...] = ()

    def sentences(self) -> list[str]:
        """What is worth saying beside the table."""
        lines = [self.sees]
        for name, (value, sigma) in self.checks_um.items():
            lines.append(
                f"Check {name} = {value:+.4f} µm, expected 0 ± {sigma:.4f} µm."
                if np.isfinite(sigma)
                else f"Check {name} = {value:+.4f} µm."
            )
        return [*super().sentences(), *lines]
