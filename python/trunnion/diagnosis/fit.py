"""Least squares of a model with its nuisance parameters and a set of effects.

What the readings do not identify of the nuisance parameters, and of effects that act on some of
them, is decided at the model's start, where dependencies are exact, and stays there
(:mod:`trunnion.base.statistics`): at the end of a fit leftovers of second order look like
information. A fit moves in the directions that are left.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import DataError, KinematicsError
from trunnion.base.statistics import (
    MANY_ROWS,
    QUICK_ROWS,
    LinearFit,
    Spanned,
    basis_of,
    linear_fit,
    quick_factor,
    spanned,
)
from trunnion.base.units import Floats as Array
from trunnion.base.units import Integers as IntArray
from trunnion.diagnosis.columns import DEPENDENT
from trunnion.diagnosis.effect import Effect, Values
from trunnion.diagnosis.gains import gains_at, zoom_one
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.of_some import OfSome
from trunnion.diagnosis.whitening import Whiten

Flags: TypeAlias = NDArray[np.bool_]

MAX_STEPS = 12
ABSORBED_SHARE = DEPENDENT**0.5
MAX_HALVINGS = 6


@dataclass(frozen=True, eq=False)
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
        Of nuisance and effect parameters per unit of noise; 0 for those that did not move.
    not_identifiable:
        Parameters that take part in a combination that is not identifiable.
    combinations:
        These combinations, shape (k, p + k), largest component 1.
    directions:
        In which the parameters moved, shape (rank, p + k): those of the nuisance, then effects.
    basis:
        Orthonormal basis of the whitened jacobian along the directions, rows used.
    judged:
        What of the nuisance parameters the readings identify, at the model's start.
    """

    nuisance: Array
    effects: dict[str, Values]
    residuals: Array
    white: Array
    jacobian: Array
    names: tuple[tuple[str, str], ...]
    covariance: Array
    not_identifiable: Flags
    combinations: Array
    directions: Array
    basis: Array
    judged: LinearFit

    def std(self) -> Array:
        """Return standard errors per unit of noise; inf where a parameter is not identifiable."""
        return np.where(self.not_identifiable, np.inf, np.sqrt(np.diag(self.covariance)))

    @property
    def rss(self) -> float:
        """Sum of squares of the whitened residuals."""
        return float(self.white @ self.white)

    @property
    def dof(self) -> int:
        """Degrees of freedom left."""
        rows, columns = self.basis.shape
        return int(rows - columns)


def grid_values(effect: Effect) -> list[Values]:
    """Values at each point of the grid of an effect's nonlinear parameters, linear ones 0."""
    names = [p.name for p in effect.parameters]
    grids = [tuple(map(float, p.grid)) if p.grid else (0.0,) for p in effect.parameters]
    return [Values(zip(names, row, strict=True)) for row in itertools.product(*grids)]


def first_values(effect: Effect) -> Values:
    """Return the first of :func:`grid_values`."""
    return Values((p.name, float(p.grid[0]) if p.grid else 0.0) for p in effect.parameters)


def variant_columns(
    model: Model, effect: Effect, nuisance: Array, values: Sequence[Values]
) -> Array:
    """Columns of an effect's linear parameters at each of these values, shape (v, n, k)."""
    return model.linear_columns(nuisance, effect, values).transpose(0, 2, 1)


def beside(parts: Sequence[Array], room: Array | None = None) -> Array:
    """Columns of all parts beside each other; of many rows, each column in a row in memory.

    ``room``: array for these.
    """
    if len(parts[0]) < MANY_ROWS:
        return np.concatenate(parts, axis=1)
    return np.concatenate([part.T for part in parts], out=None if room is None else room.T).T


def fit(
    model: Model,
    rows: IntArray,
    effects: Sequence[Effect],
    start: Array,
    values: dict[str, Values],
    whiten: Whiten,
    judged: LinearFit | None = None,
) -> Fit:
    """Gauss-Newton from ``start``; nonlinear parameters are first zoomed in on, one at a time.

    ``rows``: readings used. ``whiten`` maps all readings. ``judged``: of another fit of the model
    to the same rows with the same weights.
    """
    problem = _Problem(model, rows, effects, whiten, judged)
    at = _Point(problem.begun(start), {k: Values(v) for k, v in values.items()})
    if not all(e.linear for e in effects):
        _zoom(problem, at)
        problem.judge(at)
    r = problem.residuals(at)
    w = problem.used(r)
    rss = float(w @ w)
    jac = problem.derivative(at)
    solved = problem.solve(jac, w)
    last: _Last | None = None
    for _ in range(MAX_STEPS):
        if solved.promised <= 1e-10 * rss or rss <= 0:
            break
        lengths = solved.lengths(last)
        step = lengths @ problem.directions
        held = bool(problem.beyond(at, step).any())
        if held:
            step = problem.within(at, jac, w, step)
        taken = _downhill(problem, at, step, rss)
        if taken is None:
            break
        at, r, w, rss_new, whole = taken
        last = _Last(solved.found.solution, lengths) if whole and not held else None
        gained, rss = rss - rss_new, rss_new
        jac = problem.derivative(at)
        solved = problem.solve(jac, w)
        if gained <= 1e-9 * rss:
            break
    solved = problem.standing(at, jac, w, solved)
    found, basis = solved.found, solved.basis()
    return Fit(
        at.nuisance,
        at.values,
        r,
        w - basis @ (basis.T @ w),
        jac,
        tuple((e.id, p.name) for e, p in problem.index),
        problem.directions.T @ found.cofactor @ problem.directions,
        problem.not_identifiable(found),
        problem.combinations(found),
        problem.directions[~found.held],
        basis,
        problem.judged,
    )


@dataclass
class _Point:
    """Values of all parameters."""

    nuisance: Array
    values: dict[str, Values]


@dataclass(frozen=True)
class _Step:
    """Least squares of a step, ``columns`` (white) mixed to those along the directions.

    ``promised``: drop of the sum of squares. ``factor``: triangular factor, of many rows: ``found``
    is of its rows then, and the basis is made where it is asked for.
    """

    found: LinearFit
    promised: float
    columns: Array
    mixed: Array | None
    factor: Array | None = None

    @classmethod
    def of(cls, columns: Array, mixed: Array | None, w: Array, tolerance: float) -> "_Step":
        """Solve for the lengths of a step in each direction to whitened residuals ``w``."""
        factor = None
        if len(columns) >= QUICK_ROWS:
            factor = quick_factor(columns, w, mixed)
            rows, right = factor[:, :-1], factor[:, -1]
        else:
            rows, right = columns if mixed is None else columns @ mixed, w
        found = linear_fit(rows, right, tolerance=tolerance, basis=True)
        return cls(found, float(np.sum((found.basis.T @ right) ** 2)), columns, mixed, factor)

    def lengths(self, last: "_Last | None") -> Array:
        """How far to go in each direction; of many rows, further by how the last step fell.

        Where what is left of the readings is no noise beside a nonlinear parameter, each step is a
        fixed share of the one before, and a dozen do not arrive (Anderson 1965, of one step back).
        """
        own = self.found.solution
        if last is None or self.factor is None or len(self.columns) < MANY_ROWS:
            return own
        fell = own - last.solution
        along = self.factor[:, :-1] @ fell
        size = float(along @ along)
        share = float(along @ (self.factor[:, :-1] @ own)) / size if size > 0 else 0.0
        return np.asarray(own - share * (last.taken + fell))

    def basis(self) -> Array:
        """Orthonormal basis of the directions that are not held, all rows."""
        if self.factor is None:
            return self.found.basis
        return basis_of(self.columns, self.found, self.factor, self.mixed)


@dataclass(frozen=True)
class _Last:
    """The step before: as least squares have it, and as it was taken."""

    solution: Array
    taken: Array


class _Problem:
    """What stays the same during a fit."""

    jacobian: Array | None = None  # of many rows, place of the last one: the next replaces it
    lost: Array | None = None  # combinations with effects that are not identifiable at the start
    at_start: Array | None = None  # derivative without effects at the model's start, until asked

    def __init__(
        self,
        model: Model,
        rows: IntArray,
        effects: Sequence[Effect],
        whiten: Whiten,
        judged: LinearFit | None,
    ) -> None:
        self.model, self.rows, self.effects, self.whiten = model, rows, effects, whiten
        self.index = [(e, p) for e in effects for p in e.parameters]
        self.all_used = len(rows) == len(model.readings)
        if judged is None:
            self.at_start = model.jacobian(model.start, {})
            columns = self.used(self.at_start)
            judged = linear_fit(columns, np.zeros(len(columns)), tolerance=model.rank_tolerance)
        self.judged = judged
        rank, p = self.judged.directions.shape
        self.directions = np.eye(rank + len(self.index), p + len(self.index), p - rank)
        self.directions[:rank, :p] = self.judged.directions
        self.every = np.array_equal(self.directions, np.eye(len(self.directions)))

    def begun(self, start: Array) -> Array:
        """Values to start from: what the readings do not identify is as at the model's start."""
        directions, first = self.judged.directions, self.model.start
        if len(directions) == len(start):
            return start.copy()
        return np.asarray(first + np.linalg.lstsq(directions.T, start - first)[0] @ directions)

    def judge(self, at: _Point) -> None:
        """Let effects that are not linear move as the readings identify them at the model's start.

        Such an effect acts on some readings only (a shift on those behind its time): away from the
        start a parameter that none of these shows has a small column, by which a step is huge.
        """
        model, start = self.model, self.model.start
        effects = [e for e in self.effects if not e.linear]
        base = self.used(model.jacobian(start, {})) @ self.judged.directions.T
        own = [model.linear_columns(start, e, [at.values[e.id]])[0].T for e in effects]
        joined = beside([base, self.used(beside(own))])
        found = linear_fit(joined, np.zeros(len(joined)), tolerance=model.rank_tolerance)
        if not found.held.any():
            return
        is_judged = np.array([p.linear and not e.linear for e, p in self.index])
        each = self.directions[len(self.judged.directions) :]
        to_all = np.concatenate([self.directions[: base.shape[1]], each[is_judged]])
        self.directions = np.concatenate([found.directions @ to_all, each[~is_judged]])
        self.lost = found.combinations @ to_all
        self.every = False

    def used(self, a: Array) -> Array:
        """Whiten an array of all readings and take those that are used."""
        white = np.asarray(self.whiten(a))
        return white if self.all_used else white[self.rows]

    def residuals(self, at: _Point) -> Array:
        """Reading minus prediction, all readings."""
        return np.asarray(self.model.readings.values - self.model.predict(at.nuisance, at.values))

    def derivative(self, at: _Point) -> Array:
        """Derivative of the prediction by all parameters, all readings."""
        known, self.at_start = self.at_start, None
        if known is None or self.effects or not np.array_equal(at.nuisance, self.model.start):
            parts = self.model.derivatives(at.nuisance, self.effects, at.values)
        else:
            parts = [known]
        if self.jacobian is None and len(parts[0]) >= MANY_ROWS:
            self.jacobian = np.empty((sum(part.shape[1] for part in parts), len(parts[0]))).T
        return beside(parts, self.jacobian)

    def solve(self, jac: Array, w: Array) -> _Step:
        """Solve for the lengths of a step in each direction to whitened residuals ``w``."""
        mixed = None if self.every else self.directions.T
        return _Step.of(self.used(jac), mixed, w, self.model.rank_tolerance)

    def not_identifiable(self, solved: LinearFit) -> Flags:
        """Parameters of combinations that are not identifiable at the start, or ``solved``."""
        out: Flags = (solved.combinations @ self.directions != 0).any(axis=0)
        out[: len(self.judged.held)] |= self.judged.not_identifiable
        if self.lost is not None:
            out |= (self.lost != 0).any(axis=0)
        return out

    def combinations(self, solved: LinearFit) -> Array:
        """Combinations that are not identifiable at the start, and those of ``solved``."""
        own = self.judged.combinations
        first = np.zeros((len(own), self.directions.shape[1]))
        first[:, : own.shape[1]] = own
        lost = [] if self.lost is None else [self.lost]
        return np.concatenate([first, *lost, solved.combinations @ self.directions])

    def beyond(self, at: _Point, step: Array, held: Flags | bool = False) -> Flags:
        """Which parameters that are not held a step takes beyond bounds, (p,); sizes come last."""
        count = len(at.nuisance)
        steps = zip(self.index, step[count:], strict=True)
        after = [(p.bounds, at.values[e.id][p.name] + d) for (e, p), d in steps]
        over = ~np.array(held) & ([False] * count + [not a <= x <= b for (a, b), x in after])
        first = over & ([False] * count + [not p.linear for _, p in self.index])
        return first if first.any() else over

    def reached(self, at: _Point, step: Array) -> list[float]:
        """Values of the effects' parameters after a step, within their bounds."""
        steps = zip(self.index, step[len(at.nuisance) :], strict=True)
        return [float(np.clip(at.values[e.id][p.name] + d, *p.bounds)) for (e, p), d in steps]

    def room(self, at: _Point, step: Array) -> Array:
        """Return a step as far as the bounds let it go, each parameter for itself, (p,)."""
        before = np.array([at.values[e.id][p.name] for e, p in self.index])
        count = len(at.nuisance)
        return np.concatenate([step[:count], np.array(self.reached(at, step)) - before])

    def within(self, at: _Point, jac: Array, w: Array, step: Array) -> Array:
        """Return the step to the least squares with what is beyond its bounds held there."""
        held = np.zeros(len(step), dtype=bool)
        while (over := self.beyond(at, step, held)).any():
            held |= over
            fixed = np.where(held, self.room(at, step), 0.0)
            others = self.solve(np.where(held, 0.0, jac), w - self.used(jac @ fixed))
            step = np.where(held, fixed, others.found.solution @ self.directions)
        return step

    def standing(self, at: _Point, jac: Array, w: Array, solved: _Step) -> _Step:
        """Solve without what only a step beyond the bounds would explain: it does not move."""
        held = np.zeros(jac.shape[1], dtype=bool)
        while (over := self.beyond(at, solved.lengths(None) @ self.directions, held)).any():
            held |= over
            solved = self.solve(np.where(held, 0.0, jac), w)
        return solved

    def moved(self, at: _Point, step: Array) -> _Point:
        """Return the point after a step, effects within their bounds."""
        count = len(at.nuisance)
        new = {k: Values(v) for k, v in at.values.items()}
        for (e, p), value in zip(self.index, self.reached(at, step), strict=True):
            new[e.id][p.name] = value
        return _Point(at.nuisance + step[:count], new)


def _downhill(
    problem: _Problem, at: _Point, step: Array, rss: float
) -> tuple[_Point, Array, Array, float, bool] | None:
    """Take a step, shortened until it leads down.

    Point, residuals, white ones, their squares, and whether the whole step was taken.
    """
    for shortened in range(MAX_HALVINGS):
        new = problem.moved(at, step)
        try:
            r = problem.residuals(new)
        except (DataError, KinematicsError):  # a step out of what the model can be
            step = step / 8
            continue
        w = problem.used(r)
        rss_new = float(w @ w)
        if rss_new <= rss * (1 + 1e-12):
            return new, r, w, rss_new, not shortened
        step = step / 2
    return None


def _zoom(problem: _Problem, at: _Point) -> None:
    """Refine nonlinear parameters between the neighbours of their grid values, in place.

    The linear parameters of all effects are solved for at each trial; they are left at zero.
    """
    model, effects, values = problem.model, problem.effects, at.values
    y = problem.used(model.readings.values - model.predict(at.nuisance, {}))
    for e in effects:
        for p in e.parameters:
            if p.linear:
                values[e.id][p.name] = 0.0

    def several(e: Effect, trials: Sequence[Values]) -> OfSome:
        white = OfSome.of(model.white_piece(at.nuisance, e, trials, problem.whiten))
        return white.rows(slice(None) if problem.all_used else problem.rows)

    def columns(e: Effect) -> Array:
        return several(e, [values[e.id]]).made(0, len(y))

    base = problem.used(model.jacobian(at.nuisance, {}))
    if not (problem.every and len(base) >= MANY_ROWS):
        base = base @ problem.judged.directions.T
    others = _Others(base, effects, columns)
    for e in effects:
        if e.linear:
            continue
        q, residual = others.without(e, y)
        for p in e.parameters:
            if p.linear:
                continue

            def made(trials: Array, e: Effect = e, name: str = p.name) -> OfSome:
                return several(e, [Values({**values[e.id], name: t}) for t in trials.tolist()])

            gains = partial(gains_at, made, basis=q, residual=residual)
            zoom_one(p.name, np.asarray(p.grid), values[e.id], gains)
        others.set(e)


class _Others:
    """Columns of the nuisance and of all effects at their values, of which one is left out.

    ``columns``: of an effect. Of many rows all are kept beside each other.
    """

    def __init__(
        self, base: Array, effects: Sequence[Effect], columns: Callable[[Effect], Array]
    ) -> None:
        self._base, self._effects, self._columns = base, effects, columns
        self._every, self._own = base[:0], dict[str, slice]()
        if len(base) >= MANY_ROWS:
            parts = [base, *map(columns, effects)]
            ends = np.cumsum([part.shape[1] for part in parts]).tolist()
            self._every = beside(parts)
            places = itertools.starmap(slice, itertools.pairwise(ends))
            self._own = {e.id: place for e, place in zip(effects, places, strict=True)}

    def without(self, e: Effect, y: Array) -> tuple[Array | Spanned, Array]:
        """Orthonormal basis of all but an effect, and what it leaves of y."""
        if not self._own:
            rest = (self._columns(o) for o in self._effects if o is not e)
            q = linear_fit(np.concatenate([self._base, *rest], axis=1), y, basis=True).basis
            return q, y - q @ (q.T @ y)
        hold = np.zeros(self._every.shape[1], dtype=bool)
        hold[self._own[e.id]] = True
        self._every[:, hold] = 0.0
        found = spanned(self._every, y, hold)
        return found, found.left(y)

    def set(self, e: Effect) -> None:
        """Take the columns of an effect at other values."""
        if self._own:
            self._every[:, self._own[e.id]] = self._columns(e)
