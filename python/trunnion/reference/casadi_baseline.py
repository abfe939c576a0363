"""A second opinion on `trunnion.identify`: the same estimates from a symbolic model in CasADi.

The model of a touch (`trunnion.reference.casadi_model`) and the search share no code with the core.
Both are plain and slow on purpose. Which feature a touch meets is looked up at every step.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.base.errors import DataError
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.machine.estimate import named_combination
from trunnion.machine.geometry import made_with
from trunnion.probing.result import IdentificationResult
from trunnion.reference.casadi_model import (
    EFFECTS,
    MM_PER_UM,
    PLACEMENT,
    SHIFT_TIME,
    Contacts,
    Model,
    Rows,
)

if TYPE_CHECKING:
    from trunnion.setup import Setup

FAR_MM = 5.0
"""A touch farther than this from the modelled surface is refused."""

RANK_TOLERANCE = 1e-3
"""Scaled singular values below this share of the largest are not identifiable: what readings leave
open at first order comes back at second order, through tilts of 1e-4 rad, with such a share."""

EMPTY_UM = 1e-9
"""A parameter that moves no reading by more than this (µm a unit): sin 180° in double precision."""

STEP_TOLERANCE = 1e-9
MAX_ITERATIONS = 60
TIME_CONSTANT = "warmup_z.tau_min"


@checked
def identify(
    data: Touches,
    setup: Setup,
    *,
    effects: Iterable[str] | Mapping[str, Mapping[str, float]] = (),
) -> IdentificationResult:
    """Estimate location errors, placement and effects by least squares (Gauss-Newton).

    Parameters
    ----------
    data
        Recorded touches.
    setup
        Machine, artefact and probe. Half a tick is taken off every reading;
        ``machine.errors`` is where the search starts, and results are totals.
    effects
        Ids of the catalogue, or a mapping id -> parameters held at the given values
        (``{"setup_shift": {"t0_s": 300.0}, "drift_z": {}}``). The time of a shift that is not held
        is searched between every two touches; a time constant over a grid, then refined.

    Returns
    -------
    IdentificationResult
        The covariance holds ``repeatability_um**2 + tick_um**2 / 12`` for the variance of a reading
        where the repeatability is known, else the variance of the residuals.

    Raises
    ------
    UnknownNameError
        For an effect, preset or location error that is in no list.
    InputError
        For an effect whose columns the data do not have.
    DataError
        For fewer touches than unknowns, or a touch more than 5 mm from the modelled surface.
    ImportError
        Without CasADi.
    """
    held: dict[str, Mapping[str, float]] = (
        dict(effects) if isinstance(effects, Mapping) else {id_: {} for id_ in effects}
    )
    rows = Rows.of(data, setup, held)
    model = Model(setup, held)
    if rows.n < len(model.names):
        raise DataError(
            f"touches: got {rows.n} rows, expected at least the {len(model.names)} of the unknowns"
        )
    found = (_gauss_newton(model, rows, t0_s, start) for t0_s, start in _starts(model, rows))
    result = _result(model, rows, min(found, key=lambda solution: solution.cost))
    return replace(result, **made_with(setup, data))


@checked
def linearise(
    data: Touches,
    setup: Setup,
    values: Mapping[str, float],
    *,
    effects: Iterable[str] = (),
) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Residuals and their symbolic derivatives at given parameters, nothing solved.

    Parameters
    ----------
    data, setup
        As for `identify`.
    values
        Parameters by name, an effect's as "id.parameter"; those of the set-up or 0 if not given.
    effects
        Ids of the catalogue.

    Returns
    -------
    residuals_um : (n,)
        Recorded minus predicted coordinate along the approach, half a tick taken off.
    jacobian : (n, p)
        Derivatives of the residuals, µm per unit of each parameter.
    names
        Order of the columns; the time of a shift has none.
    """
    held: dict[str, Mapping[str, float]] = {id_: {} for id_ in effects}
    rows = Rows.of(data, setup, held)
    model = Model(setup, held)
    x = model.start()
    for name, value in values.items():
        if name != SHIFT_TIME:
            x[model.names.index(choose("parameter", name, model.names))] = value
    t0_s = float(values.get(SHIFT_TIME, 0.0))
    residuals, jacobian = _evaluate(model, rows, x, t0_s, model.contacts(x, rows, t0_s))
    return residuals, jacobian, model.names


@dataclass(frozen=True)
class _Solution:
    x: Floats
    t0_s: float
    residuals: Floats
    jacobian: Floats
    converged: bool

    @property
    def cost(self) -> float:
        return float(self.residuals @ self.residuals)


def _evaluate(
    model: Model, rows: Rows, x: Floats, t0_s: float, contact: Contacts
) -> tuple[Floats, Floats]:
    """Residuals (n,) and their derivatives (n, p)."""
    residual, slope = model.slope.map(rows.n)(x, rows.table(t0_s, contact))
    # A mapped CasADi function puts the (1, p) derivatives of the touches side by side.
    return np.array(residual).ravel(), np.array(slope).reshape(rows.n, -1)


def _scaled_svd(jacobian: Floats) -> tuple[Floats, Floats, Floats, Floats, int]:
    """SVD of the design with columns of length one, those lengths, and the rank."""
    scale = np.linalg.norm(jacobian, axis=0)
    empty = scale < EMPTY_UM
    scale = np.where(empty, 1.0, scale)
    u, s, vt = np.linalg.svd(np.where(empty, 0.0, jacobian / scale), full_matrices=False)
    return u, s, vt, scale, int(np.sum(s > RANK_TOLERANCE * s[0]))


def _step(residuals: Floats, jacobian: Floats) -> Floats:
    u, s, vt, scale, rank = _scaled_svd(jacobian)
    return np.asarray(-(vt[:rank].T @ ((u[:, :rank].T @ residuals) / s[:rank])) / scale)


def _gauss_newton(model: Model, rows: Rows, t0_s: float, x: Floats) -> _Solution:
    converged = False
    contact = model.contacts(x, rows, t0_s)
    residuals, jacobian = _evaluate(model, rows, x, t0_s, contact)
    _check_near(residuals)
    for _ in range(MAX_ITERATIONS):
        step = _step(residuals, jacobian)
        share = 1.0
        cost = float(residuals @ residuals)
        while True:
            tried = x + share * step
            contact = model.contacts(tried, rows, t0_s)
            new_residuals, new_jacobian = _evaluate(model, rows, tried, t0_s, contact)
            new_cost = float(new_residuals @ new_residuals)
            if np.isfinite(new_cost) and new_cost <= cost * (1 + 1e-9) + 1e-15:
                break
            share /= 2
            if share < 1e-4:
                return _Solution(x, t0_s, residuals, jacobian, converged=False)
        x, residuals, jacobian = tried, new_residuals, new_jacobian
        if np.all(np.abs(step) < STEP_TOLERANCE * np.maximum(1.0, np.abs(x) * 1e-3)):
            converged = True
            break
    return _Solution(x, t0_s, residuals, jacobian, converged)


def _check_near(residuals: Floats) -> None:
    far = np.flatnonzero(~(np.abs(residuals) * MM_PER_UM <= FAR_MM))
    if len(far):
        off = residuals[far[0]] * MM_PER_UM
        where = "passes it by" if not np.isfinite(off) else f"{abs(off):.3f} mm from it"
        raise DataError(
            f"touch {far[0]}: got a position that is not on the modelled surface ({where}), "
            f"expected one within {FAR_MM:g} mm; {len(far)} of {len(residuals)} touches are "
            "like this"
        )


def _starts(model: Model, rows: Rows) -> list[tuple[float, Floats]]:
    """Where to start: one place, or the best few of a grid over times that are not linear."""
    base = model.start()
    held = model.held
    times = np.unique(rows.time)
    t0_grid = [np.inf]
    if "setup_shift" in held:
        fixed = held["setup_shift"].get("t0_s")
        t0_grid = [float(fixed)] if fixed is not None else list((times[1:] + times[:-1]) / 2)
    tau_grid: list[float | None] = [None]
    if TIME_CONSTANT in model.names:
        end_min = float(times[-1] - times[0]) / 60 or 1.0
        tau_grid = list(np.geomspace(0.02 * end_min, 3 * end_min, 30))
    if len(t0_grid) * len(tau_grid) == 1:
        return [(t0_grid[0], base)]
    shifting = np.array([name.startswith("setup_shift.") for name in model.names])
    tried = []
    for tau in tau_grid:
        start = base.copy()
        free = np.ones(len(base), dtype=bool)
        if tau is not None:
            start[model.names.index(TIME_CONSTANT)] = tau
            free[model.names.index(TIME_CONSTANT)] = False
        # Without a shift its time changes no residual, only which rows its columns have.
        contact = model.contacts(start, rows, -np.inf)
        residuals, all_shifted = _evaluate(model, rows, start, -np.inf, contact)
        _check_near(residuals)
        for t0_s in t0_grid:
            shifted = (rows.time >= t0_s)[:, None]
            jacobian = np.where(shifting & ~shifted, 0.0, all_shifted)[:, free]
            step = _step(residuals, jacobian)
            left = residuals + jacobian @ step
            moved = start.copy()
            moved[free] += step
            tried.append((float(left @ left), t0_s, moved))
    tried.sort(key=lambda t: t[0])
    return [(t0_s, start) for _, t0_s, start in tried[:3]]


def _result(model: Model, rows: Rows, found: _Solution) -> IdentificationResult:
    names = model.names
    probe = model.setup.probe
    _, s, vt, scale, rank = _scaled_svd(found.jacobian)
    searched = "setup_shift" in model.held and "t0_s" not in model.held["setup_shift"]
    freedom = rows.n - rank - searched
    rounding = float(np.mean((probe.tick_um + probe.servo_period_ms * rows.feed) ** 2)) / 12
    if probe.repeatability_um > 0:
        variance = probe.repeatability_um**2 + rounding
    else:
        variance = max(float(found.cost / freedom), rounding) if freedom > 0 else np.inf
    weighted = vt[:rank] / s[:rank, None] / scale
    covariance = variance * weighted.T @ weighted
    open_ = np.linalg.norm(vt[rank:], axis=0) > RANK_TOLERANCE
    covariance[open_, :] = covariance[:, open_] = 0.0
    std = np.where(open_, np.inf, np.sqrt(np.diag(covariance)))
    std_errors = {name: float(value) for name, value in zip(names, std, strict=True)}
    values = {name: float(value) for name, value in zip(names, found.x, strict=True)}
    effects: dict[str, dict[str, float]] = {}
    for id_, held in model.held.items():
        given = {**held}
        if id_ == "setup_shift" and searched:
            given["t0_s"] = found.t0_s
            # Anywhere between the two touches is as likely: the spread of a uniform distribution.
            before, after = rows.time[rows.time < found.t0_s], rows.time[rows.time >= found.t0_s]
            std_errors[SHIFT_TIME] = float((after.min() - before.max()) / np.sqrt(12))
        effects[id_] = {
            name: float(given[name]) if name in given else values[f"{id_}.{name}"]
            for name in EFFECTS[id_][0]
        }
    return IdentificationResult(
        method="casadi gauss-newton",
        errors={name: values[name] for name in model.error_names},
        placement={name: values[name] for name in PLACEMENT},
        effects=effects,
        std_errors=std_errors,
        names=names,
        covariance=covariance,
        residuals_um=found.residuals,
        sigma_um=float(np.sqrt(variance)),
        degrees_of_freedom=freedom,
        converged=found.converged,
        combinations=tuple(named_combination(names, row / scale) for row in vt[rank:]),
    )
