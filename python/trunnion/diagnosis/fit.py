"""Least squares of a model with its nuisance parameters and a set of effects."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import DataError, KinematicsError
from trunnion.base.units import Floats as Array
from trunnion.base.units import Integers as IntArray
from trunnion.diagnosis.effect import Effect, Values, lengths
from trunnion.diagnosis.model import Model

Flags: TypeAlias = NDArray[np.bool_]

__all__ = ["Fit", "fit", "orthonormal", "variants"]

STEPS = 12
VISIBLE = 3e-3
# Share of a parameter, squared, in directions that are not seen, from which it counts as not
# determined. Set-up errors of 100 µm leak 2e-6 of one nuisance parameter into another.
LEAK_NUISANCE = 1e-5
LEAK = 1e-4
GRID_ZOOMS = 2
ZOOM_POINTS = 9


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    nuisance, effects:
        Values.
    residuals:
        Reading minus prediction of all readings, those left out too, shape (n,).
    white:
        Whitened residuals of the readings that were used, orthogonal to ``basis``.
    jacobian:
        Derivative by nuisance and effect parameters, all readings, not whitened, shape (n, p + k).
    names:
        (effect id, parameter name) of each column after the nuisance's.
    covariance:
        Of nuisance and effect parameters per unit of noise, in the directions that are seen.
    blind:
        Parameters that take part in a direction that is not seen: not determined.
    basis:
        Orthonormal basis of the whitened jacobian, rows used.
    """

    nuisance: Array
    effects: dict[str, Values]
    residuals: Array
    white: Array
    jacobian: Array
    names: tuple[tuple[str, str], ...]
    covariance: Array
    blind: Flags
    basis: Array

    def std(self) -> Array:
        """Return standard errors per unit of noise; inf where a parameter is not determined."""
        return np.where(self.blind, np.inf, np.sqrt(np.diag(self.covariance)))

    @property
    def rss(self) -> float:
        """Sum of squares of the whitened residuals."""
        return float(self.white @ self.white)

    @property
    def dof(self) -> int:
        """Degrees of freedom left."""
        rows, columns = self.basis.shape
        return int(rows - columns)


def orthonormal(columns: Array, visible: float = 1e-9) -> tuple[Array, Array, Array, Array]:
    """SVD of columns scaled to unit length, directions that vanish left out: u, s, vt, scale."""
    scale = lengths(columns)
    u, s, vt = np.linalg.svd(columns / scale, full_matrices=False)
    seen = s > visible
    return u[:, seen], s[seen], vt[seen], scale


def variants(model: Model, effect: Effect, nuisance: Array) -> tuple[list[Values], Array]:
    """Columns of an effect's linear parameters at each grid value of its nonlinear ones.

    Returns the values (linear parameters 0) and the columns, shape (v, n, k).
    """
    linear = [i for i, p in enumerate(effect.parameters) if p.linear]
    grids = [p.grid if p.grid else (0.0,) for p in effect.parameters]
    values = [effect.values(map(float, row)) for row in itertools.product(*grids)]
    columns = [model.effect_jacobian(nuisance, effect, v)[:, linear] for v in values]
    return values, np.stack(columns)


def fit(
    model: Model,
    rows: IntArray,
    effects: Sequence[Effect],
    start: Array,
    values: dict[str, Values],
    whiten: Callable[[Array], Array],
) -> Fit:
    """Gauss-Newton from ``start``; nonlinear parameters are first zoomed in on, one at a time.

    ``rows``: readings used. ``whiten`` maps all readings.
    """
    y = model.readings.values
    nuisance = start.copy()
    values = {k: Values(v) for k, v in values.items()}
    index = [(e, p) for e in effects for p in e.parameters]
    p_n = len(nuisance)

    def derivative() -> Array:
        parts = [model.jacobian(nuisance, values)]
        parts += [model.effect_jacobian(nuisance, e, values[e.id]) for e in effects]
        return np.concatenate(parts, axis=1)

    def solve(jac: Array, r: Array) -> _Step:
        return _solve(whiten(jac)[rows], whiten(r)[rows], p_n, model.visible)

    def apply(step: Array) -> tuple[Array, dict[str, Values]]:
        new = {k: Values(v) for k, v in values.items()}
        for (e, p), d in zip(index, step[p_n:], strict=True):
            low, high = p.bounds
            new[e.id][p.name] = float(np.clip(new[e.id][p.name] + d, low, high))
        return nuisance + step[:p_n], new

    def rest(at: Array, v: dict[str, Values]) -> Array:
        return np.asarray(y - model.predict(at, v))

    if not all(e.linear for e in effects):
        _zoom(model, rows, effects, nuisance, values, whiten)
    r = rest(nuisance, values)
    w = whiten(r)[rows]
    rss = float(w @ w)
    for _ in range(STEPS):
        jac = derivative()
        solved = solve(jac, r)
        step = solved.step
        promised = float(np.sum((solved.basis.T @ w) ** 2))
        if promised <= 1e-10 * rss or rss <= 0:
            break
        for _half in range(6):
            nuisance_new, values_new = apply(step)
            try:
                r_new = rest(nuisance_new, values_new)
            except (DataError, KinematicsError):  # a step out of what the model can be
                step = step / 8
                continue
            w_new = whiten(r_new)[rows]
            rss_new = float(w_new @ w_new)
            if rss_new <= rss * (1 + 1e-12):
                break
            step = step / 2
        else:
            break
        nuisance, values, r, w = nuisance_new, values_new, r_new, w_new
        gained, rss = rss - rss_new, rss_new
        if gained <= 1e-9 * rss:
            break
    jac = derivative()
    last = solve(jac, r)
    return Fit(
        nuisance,
        values,
        r,
        w - last.basis @ (last.basis.T @ w),
        jac,
        tuple((e.id, p.name) for e, p in index),
        last.covariance,
        last.blind,
        last.basis,
    )


@dataclass(frozen=True)
class _Step:
    """Solution of one linear least-squares problem."""

    step: Array
    covariance: Array
    blind: Flags
    basis: Array


def _solve(a: Array, r: Array, p: int, visible: float) -> _Step:
    """Least squares by the columns of ``a``, the first p of them nuisance.

    The nuisance takes what it can. Of what effects still change, directions that keep less than
    ``VISIBLE`` of their size count as not seen: they stay where they are.
    """
    x = a[:, p:]
    u_n, s_n, vt_n, scale_n = orthonormal(a[:, :p], visible)
    back_n = (vt_n.T / s_n) / scale_n[:, None]
    blind_n = 1.0 - np.einsum("ij,ij->j", vt_n, vt_n) > LEAK_NUISANCE
    scale = lengths(x)
    own = u_n.T @ x
    u, s, vt = np.linalg.svd((x - u_n @ own) / scale, full_matrices=False)
    seen = s > VISIBLE
    u, s, vt = u[:, seen], s[seen], vt[seen]
    back = (vt.T / s) / scale[:, None]
    step_x = back @ (u.T @ r)
    step_n = back_n @ (u_n.T @ r - own @ step_x)
    leak = back_n @ own
    cov_x = back @ back.T
    cross = -leak @ cov_x
    covariance = np.block([[back_n @ back_n.T + leak @ cov_x @ leak.T, cross], [cross.T, cov_x]])
    blind_x = 1.0 - np.einsum("ij,ij->j", vt, vt) > LEAK
    return _Step(
        np.concatenate([step_n, step_x]),
        covariance,
        np.concatenate([blind_n, blind_x]),
        np.concatenate([u_n, u], axis=1),
    )


def _zoom(
    model: Model,
    rows: IntArray,
    effects: Sequence[Effect],
    nuisance: Array,
    values: dict[str, Values],
    whiten: Callable[[Array], Array],
) -> None:
    """Refine nonlinear parameters between the neighbours of their grid values, in place.

    The linear parameters of all effects are solved for at each trial; they are left at zero.
    """
    y = whiten(model.readings.values - model.predict(nuisance, {}))[rows]
    linear = {e.id: [i for i, p in enumerate(e.parameters) if p.linear] for e in effects}

    def columns(e: Effect) -> Array:
        at = Values({p.name: 0.0 if p.linear else values[e.id][p.name] for p in e.parameters})
        return whiten(model.effect_jacobian(nuisance, e, at)[:, linear[e.id]])[rows]

    base = whiten(model.jacobian(nuisance, {}))[rows]
    for e in effects:
        others = [columns(o) for o in effects if o is not e]
        q = orthonormal(np.concatenate([base, *others], axis=1))[0]
        left = y - q @ (q.T @ y)
        for p in e.parameters:
            if p.linear:
                continue
            grid = np.asarray(p.grid)
            at = int(np.argmin(np.abs(grid - values[e.id][p.name])))
            low = float(grid[max(at - 1, 0)])
            high = float(grid[min(at + 1, len(grid) - 1)])
            for _ in range(GRID_ZOOMS):
                trials = np.linspace(low, high, ZOOM_POINTS)
                gains = []
                for t in trials:
                    values[e.id][p.name] = float(t)
                    x = columns(e)
                    x = orthonormal(x - q @ (q.T @ x))[0]
                    gains.append(float(np.sum((x.T @ left) ** 2)))
                best = int(np.argmax(gains))
                # the middle of equally good values: between two touches a slip's time is free
                top = np.flatnonzero(np.asarray(gains) >= gains[best] * (1 - 1e-12))
                best = int(top[len(top) // 2])
                values[e.id][p.name] = float(trials[best])
                low = float(trials[max(best - 1, 0)])
                high = float(trials[min(best + 1, ZOOM_POINTS - 1)])
    for e in effects:
        for p in e.parameters:
            if p.linear:
                values[e.id][p.name] = 0.0
