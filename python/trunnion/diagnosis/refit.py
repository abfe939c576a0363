"""A model fitted again with causes that are given, to compare measurements like with like."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.plain import case_of

MAX_STEPS = 8
SETTLED = 1e-9  # of the residual's squares
MAX_POINTS = 8
MIN_CYCLES = 3  # whose scatter says something
SAME = 0.01  # of its standard error, by which a value may still move
EXACT = 1e-6  # of a value that is known without noise


@dataclass(frozen=True, eq=False)
class Refit:
    """Linear parameters of a model with some effects, its nonlinear ones held.

    names: nuisance, then effects' as "id.parameter", p of them. values: (p,). covariance: (p, p).
    not_identifiable: (p,). degrees_of_freedom: of the noise. free: degrees of freedom of each
    standard error, (p,). columns: of every reading, (n, p). rss: what is left of white readings,
    squared.

    Where the measurement is one run several times, standard errors are no less than the scatter of
    the runs says: what differs from run to run is no noise of a reading.
    """

    names: tuple[str, ...]
    values: Floats
    covariance: Floats
    not_identifiable: Floats
    degrees_of_freedom: int
    free: Floats
    columns: Floats
    rss: float


def refit(model: Model, effects: Mapping[str, Mapping[str, float]], outliers: Integers) -> Refit:
    """Fit nuisance and the linear parameters of effects.

    A model that is linearised at a size (:meth:`Model.near`) is linearised anew about its own fit
    until that stays: columns taken about other data are not those of a machine in another state.

    effects: Id → values, of which the nonlinear ones are held. outliers: data rows left out.
    """
    at = model.near()
    found = _fitted(at, effects, outliers)
    for _ in range(MAX_POINTS):
        about = at.about(*_within(at, found, effects))
        if about is at:
            break
        at, before = about, found
        found = _fitted(at, effects, outliers)
        std = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
        moved = np.abs(found.values - before.values)[len(at.nuisance) :]
        still = np.maximum(SAME * std, EXACT * np.abs(found.values))[len(at.nuisance) :]
        if np.all(moved <= still):
            break
    return found


def _within(
    model: Model, found: Refit, effects: Mapping[str, Mapping[str, float]]
) -> tuple[Floats, dict[str, Values]]:
    """Nuisance and effects of a fit, these within what their parameters can be."""
    count = len(model.nuisance)
    fitted = dict(zip(found.names[count:], found.values[count:].tolist(), strict=True))
    values = {}
    for name, held in effects.items():
        each = {p.name: p for p in model.effect(name).parameters}
        sizes = {k: fitted.get(f"{name}.{k}", held.get(k, 0.0)) for k in each}
        values[name] = Values({k: float(np.clip(v, *each[k].bounds)) for k, v in sizes.items()})
    return found.values[:count], values


def _fitted(model: Model, effects: Mapping[str, Mapping[str, float]], outliers: Integers) -> Refit:
    """Fit about where the model is linearised."""
    bad = np.flatnonzero(np.isin(model.readings.rows, outliers))
    case = case_of(model).without(bad)
    used = [model.effect(name) for name in effects]
    linear = [[i for i, p in enumerate(e.parameters) if p.linear] for e in used]
    count = len(model.nuisance)
    at = np.concatenate([case.plain.nuisance, np.zeros(sum(map(len, linear)))])

    def split(x: Floats) -> tuple[Floats, dict[str, Values]]:
        left = iter(x[count:].tolist())
        values = {
            e.id: Values(
                {p.name: next(left) if p.linear else effects[e.id][p.name] for p in e.parameters}
            )
            for e in used
        }
        return x[:count], values

    def columns(x: Floats) -> Floats:
        nuisance, values = split(x)
        own = [
            model.effect_jacobian(nuisance, e, values[e.id])[:, k]
            for e, k in zip(used, linear, strict=True)
        ]
        return np.concatenate([model.jacobian(nuisance, values), *own], axis=1)

    held = linear_fit(
        case.white(model.jacobian(model.start, {})),
        np.zeros(len(case.rows)),
        tolerance=model.rank_tolerance,
    )
    hold = np.concatenate([held.held, np.zeros(len(at) - count, dtype=bool)])
    for _ in range(MAX_STEPS):
        every = columns(at)
        white = case.white(model.readings.values - model.predict(*split(at)))
        solved = linear_fit(case.white(every), white, hold=hold, tolerance=model.rank_tolerance)
        gained = float(np.sum((case.white(every) @ solved.solution) ** 2))
        at = at + solved.solution
        if gained <= SETTLED * float(white @ white):
            break
    left = case.white(model.readings.values - model.predict(*split(at)))
    dof = max(len(case.rows) - solved.rank, 1)
    lost = solved.not_identifiable | np.append(
        held.not_identifiable, np.zeros(len(at) - count, dtype=bool)
    )
    names = [x.name for x in model.nuisance]
    names += [f"{e.id}.{p.name}" for e in used for p in e.parameters if p.linear]
    rss = float(left @ left)
    covariance = solved.cofactor * float(case.floor.noise(rss, dof))
    grown, free = np.ones(len(at)), np.full(len(at), float(dof))
    if model.cycles is not None:
        moved = _moved_by_cycles(case.white(every) * left[:, None], model.cycles[case.rows])
        scatter = np.sum((moved @ solved.cofactor) ** 2, axis=0)
        known = np.diag(covariance) > 0
        grown[known] = np.sqrt(np.maximum(scatter[known] / np.diag(covariance)[known], 1.0))
        free = np.where(grown > 1, len(moved) - 1.0, free)
    covariance = covariance * np.outer(grown, grown)
    return Refit(tuple(names), at, covariance, lost, dof, free, every, rss)


def _moved_by_cycles(pulls: Floats, runs: Integers) -> Floats:
    """What each run moves the sides of the normal equations, by what each reading does (n, p).

    The sum of their squares is the covariance, (r, p); of too few runs none. Residuals of runs that
    are fitted together are smaller than theirs by themselves (a jackknife of groups, MacKinnon and
    White 1985).
    """
    index = np.unique(runs, return_inverse=True)[1].reshape(-1)
    count = int(index.max()) + 1
    moved = np.zeros((count, pulls.shape[1]))
    np.add.at(moved, index, pulls)
    return moved * np.sqrt(count / (count - 1)) if count >= MIN_CYCLES else moved[:0]
