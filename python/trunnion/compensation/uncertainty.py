"""How sure a compensation is: from the covariance of an identification to what it will leave.

Linearised: what is left at every point is the derivative of the error field with respect to the
errors of the machine (exact, at the estimate) times the error of the estimate. Largest value and
rms are not linear in it, so their distribution is found by drawing estimation errors, normal, or
Student's t where the covariance rests on residuals. For errors below 0.3 mm and 300 arcsec what the
linearisation neglects is below a part in a thousand of what is left.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import finite, whole
from trunnion.base.errors import InputError
from trunnion.base.report import Result, Table
from trunnion.base.units import Floats
from trunnion.compensation.control import ControlModel, ModelCompensation
from trunnion.compensation.machine import NOMINAL, Known, MachineErrors
from trunnion.compensation.workspace import Workspace, pose_grid
from trunnion.machine.budget import Budget, Method, drawn, measurand
from trunnion.machine.estimate import Estimate
from trunnion.setup import Setup

VOLUMETRIC = ("max_um", "rms_um")
TINY = 1e-300
MAX_DRAWS = 1_000_000
_BLOCK = 500


@dataclass(frozen=True, eq=False, repr=False)
class ResidualInterval(Result):
    """Predicted volumetric error after compensation by an uncertain estimate.

    Attributes
    ----------
    level
        Probability that each interval is meant to hold.
    max_um
        Central interval (low, high) for the largest error over box and poses.
    max_bound_um
        Bound that the largest error stays below with that probability.
    rms_um, rms_bound_um
        The same for the root mean square over the solid box and the poses.
    draws
        How many estimation errors were drawn.
    """

    level: float
    max_um: tuple[float, float]
    max_bound_um: float
    rms_um: tuple[float, float]
    rms_bound_um: float
    draws: int

    def sentences(self) -> Sequence[str]:
        """Bounds on the largest and on the rms error that is left."""
        return (
            "Bounds on the volumetric error after compensation, each with "
            f"{100 * self.level:g} % probability: largest {self.max_bound_um:.4g} µm, rms "
            f"{self.rms_bound_um:.4g} µm.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Intervals and bounds."""
        rows = (
            ("largest", *self.max_um, self.max_bound_um),
            ("rms", *self.rms_um, self.rms_bound_um),
        )
        title = f"Volumetric error left, µm, {100 * self.level:g} % of {self.draws} draws"
        return (Table.of(title, ("", "from", "to", "below"), rows),)


@checked
def residual_interval(
    setup: Setup,
    estimate: Known,
    x_mm: ArrayLike = (-150, 150),
    y_mm: ArrayLike = (-120, 120),
    z_mm: ArrayLike = (0, 150),
    a_deg: ArrayLike = 0,
    c_deg: ArrayLike = 0,
    *,
    b_deg: ArrayLike | None = None,
    compensation: ControlModel | None = None,
    covariance: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    degrees_of_freedom: float | None = None,
    level: float = 0.95,
    draws: int = 4000,
    seed: int = 0,
) -> ResidualInterval:
    """Predict what a compensation will leave, from the covariance of the estimate.

    Parameters
    ----------
    setup
        Machine.
    estimate
        Result of an identification, or location errors by name with `covariance` and `names`.
    x_mm, y_mm, z_mm, a_deg, b_deg, c_deg
        Box of the work and rotary positions, as for `volumetric_error`.
    compensation
        What the control reckons with; None: exact compensation by the linear axes, which leaves
        what the estimate is wrong by.
    covariance, names
        Of the estimate, µm and arcsec; those of the result unless given. Names beyond location
        errors and effects of the machine (placement, probe ...) take no part.
    degrees_of_freedom
        Of the variance that the covariance rests on; inf where it was known beforehand. Taken from
        the result unless given: its residuals' where the set-up states no repeatability.
    level
        Probability of the intervals.
    draws, seed
        Number of drawn estimation errors, and the seed they come from.

    Raises
    ------
    DataError
        A location error that is not identifiable: no bound can be given.
    InputError
        A covariance of another shape than `names`, not finite or not symmetric.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> found = tn.residual_interval(setup, tn.identify(touches, setup), draws=200)
    >>> len(found.tables())
    1
    """
    if not 0 < finite("level", level) < 1:
        raise InputError(f"level: got {level!r}, expected a number between 0 and 1")
    whole("draws", draws, 100, MAX_DRAWS)
    whole("seed", seed, 0)
    known = MachineErrors.of(setup, estimate)
    matrix, listed = _covariance(estimate, covariance, names)
    freedom = degrees_of_freedom
    if freedom is None:
        freedom = np.inf if covariance is not None else freedom_of(setup, estimate)
    if not freedom > 0:
        raise InputError(f"degrees_of_freedom: got {freedom!r}, expected above 0")
    index, numbers = taking_part(setup, known, listed)
    where = Workspace(x_mm, y_mm, z_mm, a_deg, c_deg, b_deg)
    control = ModelCompensation(known) if compensation is None else compensation
    field = _Field.of(setup, known, where, numbers, control)
    random = np.random.default_rng(seed)
    drawn = draw_changes(random, matrix[np.ix_(index, index)], freedom, draws)
    found = np.concatenate([field.values(block) for block in drawn])
    tail = 0.5 * (1.0 - level)

    def interval(values: Floats) -> tuple[tuple[float, float], float]:
        low, high, bound = np.quantile(values, [tail, 1.0 - tail, level])
        return (float(low), float(high)), float(bound)

    (max_um, max_bound), (rms_um, rms_bound) = interval(found[:, 0]), interval(found[:, 1])
    return ResidualInterval(level, max_um, max_bound, rms_um, rms_bound, draws)


def freedom_of(setup: Setup, estimate: Known) -> float:
    """Degrees of freedom of an estimate's variance; inf where the set-up states it."""
    if setup.probe.repeatability_um == 0 and isinstance(estimate, Estimate):
        return estimate.degrees_of_freedom
    return np.inf


def draw_changes(
    random: np.random.Generator, covariance: Floats, freedom: float, draws: int
) -> Iterator[Floats]:
    """Errors of an estimate, drawn in blocks of rows: normal, or Student's t."""
    root = _root(covariance)
    for first in range(0, draws, _BLOCK):
        count = min(_BLOCK, draws - first)
        drawn = random.standard_normal((count, len(root))) @ root.T
        if np.isfinite(freedom):
            drawn /= np.sqrt(random.chisquare(freedom, count) / freedom)[:, None]
        yield drawn


def taking_part(
    setup: Setup, known: MachineErrors, listed: Sequence[str]
) -> tuple[list[int], list[int]]:
    """Places of names that move the tool on the work, and their numbers in the core's model."""
    parameters = [name for name, _ in known.core(setup).parameters]
    index = [i for i, name in enumerate(listed) if name in parameters]
    return index, [parameters.index(listed[i]) for i in index]


@checked
def volumetric_budget(
    setup: Setup,
    estimate: Estimate,
    x_mm: ArrayLike = (-150, 150),
    y_mm: ArrayLike = (-120, 120),
    z_mm: ArrayLike = (0, 150),
    a_deg: ArrayLike = 0,
    c_deg: ArrayLike = 0,
    *,
    b_deg: ArrayLike | None = None,
    tolerance_um: float | None = None,
    method: Method = "linear",
    draws: int = 20_000,
    seed: int = 0,
) -> Budget:
    """Uncertainty budget of the volumetric error of a machine as it was measured, by the GUM.

    Parameters
    ----------
    setup
        Machine.
    estimate
        Result of an identification, or the model of a diagnosis.
    x_mm, y_mm, z_mm, a_deg, b_deg, c_deg
        Box of the work and rotary positions, as for `volumetric_error`.
    tolerance_um
        Largest volumetric error allowed: conformity by ISO 14253-1 is stated.
    method
        "linear", or "monte-carlo": inputs are drawn, and the largest error is sought again for each
        draw. The length of an error has a bias where it is not larger than its uncertainty: the
        linear method does not show it.
    draws, seed
        Of the Monte Carlo method.

    Returns
    -------
    Budget
        Of ``max_um``, the largest length of the error vector over box and poses, and ``rms_um``,
        over the solid box and the poses.

    Raises
    ------
    DataError
        A location error that is not identifiable: no uncertainty can be given.
    InputError
        An estimate with an effect outside the catalogue that moves the tool.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> fit = tn.identify(touches, setup)
    >>> budget = tn.volumetric_budget(setup, fit, a_deg=(-90, 0, 90), c_deg=(0, 90))
    >>> len(budget.measurands)
    2
    """
    known = MachineErrors.of(setup, estimate)
    known.refuse_own("the field of errors is that of the machine's model")
    order = estimate.names or tuple(estimate.std_errors)
    index, numbers = taking_part(setup, known, order)
    where = Workspace(x_mm, y_mm, z_mm, a_deg, c_deg, b_deg)
    field = _Field.of(setup, known, where, numbers)
    sources = tuple(replace(s, rates=s.rates[index]) for s in estimate.uncertainty_sources())
    values, gradients = field.values(np.zeros((1, len(index))))[0], field.gradients()
    made = tuple(
        measurand(name, value, gradient, sources)
        for name, value, gradient in zip(VOLUMETRIC, values, gradients, strict=True)
    )
    limits = {} if tolerance_um is None else {VOLUMETRIC[0]: tolerance_um}
    budget = Budget(made, tolerances=limits)
    if method == "linear" or not sources:
        return budget
    return drawn(budget, sources, field.values, draws, seed)


@dataclass(frozen=True)
class _Points:
    """Vectors of the error in the corners of the box, and what their mean square is made of.

    The mean square over the solid box is that of the value in its middle and of the gains times the
    standard deviations of the coordinates: shapes (..., poses, corners, 3), (..., poses, 3, 4).
    """

    at_corners: Floats
    moments: Floats

    @classmethod
    def of(cls, fields: Floats, ends: Sequence[Floats]) -> _Points:
        """Of affine fields (..., poses, 3, 4)."""
        corners = np.stack(np.meshgrid(*ends, [1.0], indexing="ij"), axis=-1).reshape(-1, 4)
        middle = np.array([*(e.mean() for e in ends), 1.0])
        spread = np.array([np.ptp(e) / np.sqrt(12.0) for e in ends])
        at_corners = np.einsum("...ij,kj->...ki", fields, corners)
        moments = [fields @ middle[:, None], fields[..., :3] * spread]
        return cls(at_corners, np.concatenate(moments, axis=-1))


@dataclass(frozen=True)
class _Field:
    """The error over a box and poses, and its derivatives by p parameters of the machine."""

    value: _Points
    rates: _Points

    @classmethod
    def of(
        cls,
        setup: Setup,
        known: MachineErrors,
        where: Workspace,
        used: Sequence[int],
        compensation: ControlModel | None = None,
    ) -> _Field:
        """Of a machine; ``compensation``: None: the control reckons with the nominal one."""
        core = known.core(setup)
        poses = pose_grid(setup, where.rotary(setup)[0])
        control = ModelCompensation(NOMINAL) if compensation is None else compensation
        assumed, zeros = control.control_model(setup)
        value = core.fields(assumed, zeros, poses)[0].reshape(len(poses), 3, 4)
        rates = core.truth_rates(assumed, zeros, poses).reshape(len(poses), -1, 3, 4)[:, used]
        ends = where.ends()
        return cls(_Points.of(value, ends), _Points.of(rates.swapaxes(0, 1), ends))

    def values(self, changes: Floats) -> Floats:
        """Largest and rms error, µm, at changes of the parameters (count, p): (count, 2)."""
        out = np.empty((len(changes), 2))
        for first in range(0, len(changes), _BLOCK):
            block = slice(first, first + _BLOCK)
            there = np.tensordot(changes[block], self.rates.at_corners, axes=1)
            there += self.value.at_corners
            out[block, 0] = np.sqrt(np.einsum("dmki,dmki->dmk", there, there).max(axis=(1, 2)))
            parts = np.tensordot(changes[block], self.rates.moments, axes=1) + self.value.moments
            out[block, 1] = np.sqrt(np.einsum("dmij,dmij->d", parts, parts) / parts.shape[1])
        return out

    def gradients(self) -> tuple[Floats, Floats]:
        """Derivatives of the largest and of the rms error by each parameter, (p,) each."""
        lengths = np.linalg.norm(self.value.at_corners, axis=-1)
        pose, corner = np.unravel_index(int(np.argmax(lengths)), lengths.shape)
        worst, size = self.value.at_corners[pose, corner], max(float(lengths.max()), TINY)
        rms = np.sqrt(np.sum(self.value.moments**2) / len(self.value.moments))
        mean = np.einsum("pmij,mij->p", self.rates.moments, self.value.moments)
        return (
            self.rates.at_corners[:, pose, corner] @ worst / size,
            mean / max(rms * len(self.value.moments), TINY),
        )


def _covariance(
    estimate: Known, covariance: ArrayLike | None, names: Sequence[str] | None
) -> tuple[Floats, list[str]]:
    given, listed = covariance, names
    if isinstance(estimate, Estimate):
        given = estimate.covariance if given is None and estimate.names else given
        listed = estimate.names if listed is None and estimate.names else listed
    if given is None or listed is None:
        raise InputError("covariance: got none, expected a result that has one, or it and names")
    matrix = np.asarray(given, dtype=float)
    if matrix.shape != (len(listed), len(listed)) or not np.all(np.isfinite(matrix)):
        raise InputError(
            f"covariance: got shape {matrix.shape}, expected finite ({len(listed)}, {len(listed)})"
        )
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-12):
        raise InputError("covariance: got a matrix that is not symmetric, expected a symmetric one")
    return matrix, list(listed)


def _root(matrix: Floats) -> Floats:
    """R with R Rᵀ = matrix; a covariance may be singular where parameters depend on one another."""
    values, vectors = np.linalg.eigh(matrix)
    root: Floats = vectors * np.sqrt(np.clip(values, 0.0, None))
    return root
