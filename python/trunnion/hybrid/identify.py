"""Identification of the hybrid machine's errors from ball-bar readings.

Least squares on the exact model; lengths and derivatives are the core's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from trunnion.base.arguments import checked
from trunnion.base.checks import positive
from trunnion.base.errors import DataError, InputError
from trunnion.base.report import Table
from trunnion.base.units import Floats, Integers
from trunnion.data.ballbar import Ballbar
from trunnion.hybrid.mechanism import Mechanism
from trunnion.hybrid.parameters import PAPER_ERRORS, error_names
from trunnion.hybrid.readings import (
    MIN_READINGS,
    check_near,
    gradient_with_centres,
    joints_of,
    setup_index,
    start_centres,
)
from trunnion.hybrid.spectrum import Spectrum
from trunnion.machine.estimate import Estimate, named_combination

#: A combination is estimated only if its standard error is less than this, µm or arcsec.
MAX_STD_ERROR_UM = 1000.0
#: Share of the largest component of a combination from which a parameter is named in it.
NAMED_SHARE = 0.1


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class BallbarIdentification(Estimate):
    """Errors of the hybrid machine estimated from ball-bar readings: an :class:`Estimate`.

    Of combinations that are not identifiable, the smallest change from the nominal machine is
    taken; the covariance is that of the part that is.

    Attributes
    ----------
    centres_mm
        Ball centre of each set-up.
    residuals_um
        Measured minus modelled length, (n,).
    rank
        Combinations of errors that were determined.
    converged
        Whether the last step was within rounding.
    mechanism
        The machine with the estimated errors.
    """

    centres_mm: dict[str, tuple[float, float, float]]
    residuals_um: Floats
    rank: int
    converged: bool
    mechanism: Mechanism

    @property
    def rms_um(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals_um**2)))

    def sentences(self) -> list[str]:
        """What is worth saying beside the table."""
        lines = [
            f"{len(self.residuals_um)} readings, {self.degrees_of_freedom:g} degrees of freedom, "
            f"residuals {self.rms_um:.4f} µm rms, one reading {self.sigma_um:.4f} µm (1 σ); "
            f"{self.rank} of {len(self.errors)} combinations determined."
        ]
        if not self.converged:
            lines.append("Did NOT converge: do not use these numbers.")
        return [*lines, *super().sentences()]

    def tables(self) -> tuple[Table, ...]:
        """Estimates with standard errors, and the ball centres."""
        centres = [(label, *centre) for label, centre in self.centres_mm.items()]
        return (
            *super().tables(),
            Table.of("Ball centres, mm", ("set-up", "x", "y", "z"), centres),
        )


@checked
def identify_ballbar(
    data: Ballbar,
    mechanism: Mechanism,
    *,
    parameters: Sequence[str] = PAPER_ERRORS,
    sigma_um: float | None = None,
    tolerance: float | None = None,
    threads: int | None = 1,
) -> BallbarIdentification:
    """Estimate errors and ball centres from ball-bar readings: least squares on the exact model.

    Parameters
    ----------
    data
        Readings with commanded joints.
    mechanism
        The nominal machine; errors that it has are where the search starts, and estimates are
        totals that include them.
    parameters
        Errors to estimate.
    sigma_um
        Noise of one reading if known; else from the residuals.
    tolerance
        What is known beforehand: each error is within this (1 σ, µm or arcsec) of the machine's
        own. It must come with `sigma_um`, which weighs readings against it. Then every error has
        an estimate. None: the readings alone decide.
    threads
        For the forward solutions.

    Raises
    ------
    DataError
        Fewer readings than unknowns, no joints, or lengths more than 5 mm from what the joints
        allow.
    InputError
        `tolerance` without `sigma_um`, or values not above 0.
    """
    if tolerance is not None and sigma_um is None:
        raise InputError("tolerance: got no sigma_um with it, expected the noise of a reading")
    for what, value in (("tolerance", tolerance), ("sigma_um", sigma_um)):
        if value is not None:
            positive(what, value)
    weight = 0.0 if tolerance is None or sigma_um is None else sigma_um / tolerance
    problem = _Problem.of(data, mechanism, parameters, weight, threads)
    start = Spectrum.of(problem.jacobian(problem.start), problem.count).down_to(
        (sigma_um or 1.0) / MAX_STD_ERROR_UM
    )
    x, converged = _search(problem, start)
    return _result(problem, start, x, converged=converged, sigma_um=sigma_um)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Residuals and their derivative.

    Unknowns x: `count` errors (µm, arcsec), then three coordinates (µm) of each ball centre, from
    `centres_mm`. Residuals: one a reading (µm), then one an error, its `weight`-ed distance from
    the machine's own.
    """

    lengths_mm: Floats
    joints: Floats
    index: Integers
    labels: tuple[str, ...]
    names: tuple[str, ...]
    mechanism: Mechanism
    centres_mm: Floats
    weight: float
    threads: int | None

    @classmethod
    def of(
        cls,
        data: Ballbar,
        mechanism: Mechanism,
        parameters: Sequence[str],
        weight: float,
        threads: int | None,
    ) -> _Problem:
        """Check the readings, and place the ball centres for the start."""
        names = error_names(parameters)
        joints = joints_of(data)
        index, labels = setup_index(data)
        unknowns = len(names) + 3 * len(labels)
        if weight == 0.0 and len(data) <= unknowns:
            raise DataError(
                f"ball-bar: got {len(data)} readings, expected more than {unknowns} unknowns"
            )
        tips = mechanism.forward(joints, threads=threads).tip_mm
        centres = start_centres(tips, data.length_mm, index)
        placed = np.bincount(index)[index] > MIN_READINGS
        if placed.any():
            near = np.linalg.norm(tips - centres[index], axis=1)
            check_near(np.where(placed, data.length_mm, near), near)
        return cls(
            data.length_mm, joints, index, labels, names, mechanism, centres, weight, threads
        )

    @property
    def count(self) -> int:
        """Number of errors."""
        return len(self.names)

    @property
    def start(self) -> Floats:
        """The machine's own errors, centres as placed."""
        own = [self.mechanism.errors.get(name, 0.0) for name in self.names]
        return np.concatenate([own, np.zeros(3 * len(self.labels))])

    def machine(self, x: Floats) -> Mechanism:
        """The machine with the errors at x."""
        others = {k: v for k, v in self.mechanism.errors.items() if k not in self.names}
        errors = dict(zip(self.names, map(float, x[: self.count]), strict=True))
        return self.mechanism.with_errors(others | errors)

    def centres_at(self, x: Floats) -> Floats:
        """Ball centres at x, mm, (setups, 3)."""
        return self.centres_mm + x[self.count :].reshape(-1, 3) * 1e-3

    def residuals(self, x: Floats) -> Floats:
        """Modelled minus measured length, µm, then what holds the errors, (n + count,)."""
        centres = self.centres_at(x)[self.index]
        length, _, _ = self.machine(x).ballbar(self.joints, centres, (), threads=self.threads)
        held = self.weight * (x - self.start)[: self.count]
        return np.concatenate([(length - self.lengths_mm) * 1e3, held])

    def jacobian(self, x: Floats) -> Floats:
        """Derivative of `residuals`, (n + count, unknowns)."""
        centres = self.centres_at(x)[self.index]
        _, direction, gradient = self.machine(x).ballbar(
            self.joints, centres, self.names, threads=self.threads
        )
        held = np.zeros((self.count, len(x)))
        held[:, : self.count] = self.weight * np.eye(self.count)
        return np.vstack([gradient_with_centres(gradient, direction, self.index), held])


def _search(problem: _Problem, start: Spectrum) -> tuple[Floats, bool]:
    """Least squares along what the readings determine, and whether it converged.

    Each identifiable combination is scaled to one noise; the others stay where they are.
    """
    count, rank = problem.count, start.rank
    centres = 3 * len(problem.labels)
    origin = problem.start
    way = np.zeros((len(origin), rank + centres))
    way[:count, :rank] = start.directions[:rank].T / start.values[:rank]
    way[count:, rank:] = np.eye(centres)

    def residuals(z: Floats) -> Floats:
        return problem.residuals(origin + way @ z)

    def jacobian(z: Floats) -> Floats:
        return np.asarray(problem.jacobian(origin + way @ z) @ way)

    found = optimize.least_squares(
        residuals,
        np.zeros(way.shape[1]),
        jac=jacobian,
        x_scale="jac",
        method="lm",
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-12,
    )
    return origin + way @ np.asarray(found.x), bool(found.success)


def _result(
    problem: _Problem, start: Spectrum, x: Floats, *, converged: bool, sigma_um: float | None
) -> BallbarIdentification:
    """Estimates and their uncertainty at the end of the search."""
    names, count = problem.names, problem.count
    determined = start.directions[: start.rank]
    full = problem.jacobian(x)
    spectrum = Spectrum.of(
        np.hstack([full[:, :count] @ determined.T, full[:, count:]]), start.rank
    ).in_terms_of(start)
    readings = len(problem.lengths_mm)
    residuals = -problem.residuals(x)[:readings]
    free = 0 if problem.weight else start.rank
    freedom = readings - 3 * len(problem.labels) - free
    sigma = sigma_um or float(np.sqrt(residuals @ residuals / max(freedom, 1)))
    centres = problem.centres_at(x).tolist()
    return BallbarIdentification(
        errors=dict(zip(names, map(float, x[:count]), strict=True)),
        std_errors=dict(zip(names, map(float, spectrum.std_errors(sigma)), strict=True)),
        names=names,
        covariance=spectrum.covariance(sigma),
        centres_mm={k: (c[0], c[1], c[2]) for k, c in zip(problem.labels, centres, strict=True)},
        residuals_um=residuals,
        sigma_um=sigma,
        degrees_of_freedom=float(freedom),
        rank=spectrum.rank,
        combinations=tuple(
            named_combination(names, vector, NAMED_SHARE)
            for vector in start.directions[start.rank :]
        ),
        converged=converged,
        mechanism=problem.machine(x),
    )
