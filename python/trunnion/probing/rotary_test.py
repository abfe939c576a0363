"""R-test and ball-bar tests of rotary axes: a ball on the table that the tool follows.

What the readings are is in `trunnion.probing.rotary_readings`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import array, point, positive, whole
from trunnion.base.errors import InputError
from trunnion.base.report import Table, plus_minus
from trunnion.base.statistics import LinearFit, linear_fit
from trunnion.base.units import Floats
from trunnion.data.meant import meant_named
from trunnion.data.rotary_test import READINGS, RotaryTest
from trunnion.machine.budget import of_readings
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import Estimate, named_combination
from trunnion.machine.geometry import made_with
from trunnion.probing.rotary_acting import Acting
from trunnion.probing.rotary_readings import Relation, RotaryReadings, RotaryTestSettings, commanded
from trunnion.setup import Setup

MAX_STEPS = 20


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class RotaryTestIdentification(Estimate):
    """Location errors from an R-test or a ball-bar test of rotary axes: an :class:`Estimate`.

    Attributes
    ----------
    offsets_um
        How far each ball ("ball", or "ball_" and its label) and, where it is unknown, the tool's
        point ("tool_offset") are from their places.
    offsets_std_um
        Their standard errors; inf for what is not identifiable.
    residuals_um
        Measured minus modelled readings: (n, 3) of an R-test, (n, 1) of a ball-bar.
    converged
        Whether the last step was within rounding.
    bar_length_um
        How much longer a ball-bar that is not calibrated reads than it is, and the standard error
        of that; None where the length is known.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("none"))
    >>> turns = {"A": [0, 0, 0, 0, 60, -60, 60, -60], "C": [0, 90, 180, 270, 0, 0, 90, 90]}
    >>> plan = tn.plan_rotary_test(setup, (100, 0, 50), turns)
    >>> made = tn.simulate_rotary_test(plan, setup, (100, 0, 50), {"EY0C": 7.0})
    >>> found = tn.identify_rotary_test(made, setup, (100, 0, 50))
    >>> found.residuals_um.shape, found.converged
    ((8, 3), True)
    """

    offsets_um: dict[str, tuple[float, float, float]]
    offsets_std_um: dict[str, tuple[float, float, float]]
    residuals_um: Floats
    converged: bool
    bar_length_um: tuple[float, float] | None = None

    @property
    def rms_um(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals_um**2)))

    def sentences(self) -> list[str]:
        """What is worth saying beside the table."""
        lines = [
            f"{self.residuals_um.size} readings, {self.degrees_of_freedom:g} degrees of freedom, "
            f"residuals {self.rms_um:.4g} µm rms, one reading {self.sigma_um:.4g} µm (1 σ)."
        ]
        if self.bar_length_um is not None:
            longer, std = self.bar_length_um
            lines.append(f"The ball-bar reads {plus_minus(longer, 2 * std)} µm (k = 2) longer.")
        if not self.converged:
            lines.append("Did NOT converge: do not use these numbers.")
        return [*lines, *super().sentences()]

    def tables(self) -> tuple[Table, ...]:
        """Estimates with standard errors, and the places of balls and tool."""
        places = [(k, *xyz, *self.offsets_std_um[k]) for k, xyz in self.offsets_um.items()]
        columns = ("of", "x", "y", "z", "std. x", "std. y", "std. z")
        return (*super().tables(), Table.of("Offsets from the stated places, µm", columns, places))


@checked
def plan_rotary_test(
    setup: Setup,
    ball_mm: ArrayLike,
    positions_deg: Mapping[str, ArrayLike],
    *,
    bar_mm: ArrayLike = (0.0, 0.0, 0.0),
    frame: Literal["machine", "work"] = "machine",
) -> RotaryTest:
    """Plan the moves that keep the tool at a ball on the table while rotary axes turn.

    Parameters
    ----------
    setup
        The machine; the linear axes follow by its kinematics without errors.
    ball_mm
        Centre of the ball on the table, (3,), mm: at rest where all axes are at zero.
    positions_deg
        Positions of the rotary axes by letter, control's sign, (n,) each or one number for all.
    bar_mm
        For a ball-bar, from the ball to the tool's point, (3,) or (n, 3), mm; an R-test has none.
    frame
        In which the bar points: the machine's, or turning with the work.

    Returns
    -------
    RotaryTest
        Commanded positions, without readings.

    Raises
    ------
    InputError, DataError
        No finite numbers, other shapes, rotary axes that the machine lacks.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("none"))
    >>> plan = tn.plan_rotary_test(setup, (100, 0, 50), {"A": 0.0, "C": [0, 90]})
    >>> (plan.position_mm.round(6) + 0.0).tolist()
    [[100.0, 0.0, 50.0], [0.0, 100.0, 50.0]]
    """
    chain = Chain(setup)
    turned = chain.to_machine(positions_deg)
    ball = np.broadcast_to(point("ball_mm", ball_mm), (len(turned), 3))
    bar = array("bar_mm", bar_mm, 3, rows=1 if np.ndim(bar_mm) < 2 else len(turned))
    bar = np.broadcast_to(bar, (len(turned), 3))
    points = ball + bar if frame == "work" else ball
    linear = chain.machine({}).linear_axes_for(np.ascontiguousarray(points), turned)
    linear = np.asarray(linear).reshape(-1, 3) + (bar if frame == "machine" else 0.0)
    angles = {f"{letter.lower()}_deg": v for letter, v in chain.to_control(turned).items()}
    x, y, z = linear.T
    return RotaryTest(**angles, x_mm=x, y_mm=y, z_mm=z)


@checked
def simulate_rotary_test(
    plan: RotaryTest,
    setup: Setup,
    ball_mm: ArrayLike,
    errors: Mapping[str, float] | None = None,
    *,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    bar: bool = False,
    tool_offset_um: ArrayLike = (0.0, 0.0, 0.0),
    noise_um: float = 0.0,
    seed: int | None = None,
) -> RotaryTest:
    """Return the readings of an R-test, or of a ball-bar, on a machine with location errors.

    Parameters
    ----------
    plan, setup
        Commanded positions, and the machine.
    ball_mm
        Where the ball is on the table, (3,), mm.
    errors
        Location errors, µm and arcsec; those of the set-up where not given.
    effects
        Id to parameter to value: effects of the machine as on touches, its backlash
        (``backlash_x``, ``c_backlash``, by the order of the readings), and with `time_s` in the
        plan ``drift_x`` and ``warmup_x`` (and y, z) between tool and ball; of the instrument
        ``tool_offset``, ``sensor_turn`` and ``sensor_gain``.
    bar
        Whether a ball-bar reads lengths; else an R-test reads displacements.
    tool_offset_um
        From where the control has the tool's point to where it is, machine frame, (3,).
    noise_um, seed
        Standard deviation of a reading, and what it is drawn by.

    Raises
    ------
    InputError, UnknownNameError
        Noise without a seed, an error or an effect that the machine lacks, a drift without times.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("none"))
    >>> plan = tn.plan_rotary_test(setup, (100, 0, 50), {"A": 0.0, "C": [0, 90]})
    >>> made = tn.simulate_rotary_test(plan, setup, (100, 0, 50), {"EX0C": 12.0})
    >>> (made.dx_um.round(6) + 0.0).tolist()
    [12.0, 12.0]
    """
    if noise_um and seed is None:
        raise InputError(
            "seed: got none, expected a whole number: there is no noise without a seed"
        )
    chain = Chain(setup)
    offset = np.array(point("tool_offset_um", tool_offset_um))
    balls = np.broadcast_to(point("ball_mm", ball_mm), (len(plan), 3))
    acting = Acting.of(chain, plan, effects or {})
    axes = commanded(chain, plan) - acting.behind
    there = Relation.of(chain, axes, chain.named_errors(errors), acting.machine)
    apart = (there.apart_um(balls) - offset - acting.moved_um) @ acting.sensors.T
    rng = np.random.default_rng(None if seed is None else whole("seed", seed, 0))
    noise = rng.normal(0.0, 1.0, apart.shape) * noise_um
    if bar:
        lengths = 1e-3 * (np.linalg.norm(apart, axis=1) + noise[:, 0])
        return plan.with_columns(length_mm=lengths)
    return plan.with_columns(**dict(zip(READINGS, (apart + noise).T, strict=True)))


@checked
def identify_rotary_test(
    data: RotaryTest,
    setup: Setup,
    ball_mm: ArrayLike | Mapping[str | int, ArrayLike] | None = None,
    *,
    sigma_um: float | None = None,
    tool_is_known: bool | None = None,
) -> RotaryTestIdentification:
    """Estimate location errors and the place of each ball from an R-test or a ball-bar test.

    Least squares on the exact kinematics.

    Parameters
    ----------
    data
        Commanded positions with readings.
    setup
        The machine; known errors are where the search starts, estimates are totals. Its table
        ``[rotary_test]`` says what is not given here, and whether the bar's length is known.
    ball_mm
        About where the ball was on the table, (3,), mm; with several places by their label.
        Estimates say how far from it. Unless given or in the set-up it is where the readings of an
        R-test have it on average.
    sigma_um
        Noise of one reading if known; else that of the set-up, else from the residuals.
    tool_is_known
        Whether the tool's point is on the axis of the spindle and its length known to within the
        noise. If not, its offset is unknown as well, and what is not distinguished from it is
        stated.

    Raises
    ------
    DataError
        No readings, fewer than unknowns, or readings more than 5 mm from the modelled ones.
    InputError
        A noise that is not above 0; no place of a ball, where a ball-bar needs one.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("none"))
    >>> plan = tn.plan_rotary_test(setup, (100, 0, 50), {"A": [0, 0, 0, 0, 60, -60, 60, -60],
    ...                                                  "C": [0, 90, 180, 270, 0, 0, 90, 90]})
    >>> made = tn.simulate_rotary_test(plan, setup, (100, 0, 50), {"EX0C": 12.0})
    >>> round(tn.identify_rotary_test(made, setup)["EX0C"], 4)
    12.0
    """

    def solve(data: RotaryTest, setup: Setup) -> RotaryTestIdentification:
        return _solve(
            RotaryReadings.of(data, setup, ball_mm, tool_is_known=tool_is_known), sigma_um
        )

    with meant_named(data, setup, lambda other, known: solve(other, known).rms_um):
        return solve(data, setup)


def _solve(problem: RotaryReadings, sigma_um: float | None) -> RotaryTestIdentification:
    """Gauss-Newton from where the set-up has everything."""
    stated = RotaryTestSettings.from_setup(problem.setup).repeatability_um
    known = stated if sigma_um is None else positive("sigma_um", sigma_um)
    x = problem.start
    converged = False
    for _ in range(MAX_STEPS):
        off = problem.residuals(x)
        fit = linear_fit(problem.jacobian(x), off)
        x = x + fit.solution
        converged = bool(np.abs(fit.solution).max(initial=0.0) < 1e-7)
        if converged:
            break
    return _result(problem, x, fit, known, converged=converged)


def _result(
    problem: RotaryReadings, x: Floats, fit: LinearFit, known: float, *, converged: bool
) -> RotaryTestIdentification:
    """Estimates by name."""
    off = problem.measured - problem.modelled(x)
    freedom = off.size - fit.rank
    sigma = known or float(np.sqrt(np.sum(off**2) / freedom))
    names, count = problem.names, len(problem.chain.location_errors)
    covariance = sigma**2 * fit.cofactor[:count, :count]
    std = sigma * fit.std
    degrees = np.inf if known else float(freedom)
    bar = None if problem.bar_is_known else (float(x[-1]), float(std[-1]))
    return RotaryTestIdentification(
        errors=dict(zip(names, map(float, x[:count]), strict=False)),
        std_errors=dict(zip(names, map(float, std[:count]), strict=False)),
        names=names[:count],
        covariance=covariance,
        sigma_um=sigma,
        degrees_of_freedom=degrees,
        combinations=tuple(named_combination(names, row) for row in fit.combinations),
        sources=of_readings(covariance, sigma, "µm", 0.0, degrees),
        offsets_um=_by_group(problem.groups, x[count:]),
        offsets_std_um=_by_group(problem.groups, std[count:]),
        residuals_um=off,
        converged=converged,
        bar_length_um=bar,
        **made_with(problem.setup, problem.data),
    )


def _by_group(groups: Sequence[str], values: Floats) -> dict[str, tuple[float, float, float]]:
    """Three values for each group."""
    rows = values[: 3 * len(groups)].reshape(-1, 3).tolist()
    return {group: (x, y, z) for group, (x, y, z) in zip(groups, rows, strict=True)}
