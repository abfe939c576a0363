"""How well the moment of a slip, the place of a kink or one pitch among several is known.

Between two readings nothing changes with it, so that it has no derivative and no standard error by
the covariance of a fit. Its probability is exp(-RSS / 2 variance) at each value, beforehand alike
everywhere (Hinkley 1970, Inference about the change-point in a sequence of random variables,
Biometrika 57): flat between two readings.

A covariance knows one optimum. Where a wave of another pitch, sampled at the same places, explains
about as well, each has the probability of its likelihood, beforehand alike.
"""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from trunnion.base.statistics import MANY_ROWS, Spanned, basis_of_all, spanned
from trunnion.base.units import Floats
from trunnion.diagnosis.along import Along, Beside, of_ratios
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Effect, Parameter, Values
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.gains import gains_at
from trunnion.diagnosis.of_some import OfSome

TRIALS = 128  # values that are tried near the one found
NEGLIGIBLE = 24.0  # of -2 ln L above the best: a probability of 6e-6 of it
APART = 5.0  # standard errors, from which on an optimum is another one
DETERMINED = 0.5  # times the spread if it could be anywhere: above, the readings do not tell


def moment_errors(case: Case, effect: Effect, f: Fit, variance: float) -> dict[str, float]:
    """Return the standard error about the fitted value of each moment that is determined, by name.

    ``variance``: of a whitened reading. Of an effect with several nonlinear parameters each is
    looked at with the others held.
    """
    still = moments_of(case, effect, f)
    if not still:
        return {}
    fitted = f.effects[effect.id]
    basis, y = without_one(case, effect, f)

    def gains(name: str, trials: Floats) -> Floats:
        """Drop of RSS / variance by the effect with each of these values, (t,)."""

        def columns(some: Floats) -> OfSome:
            every = [Values({**fitted, name: trial}) for trial in some.tolist()]
            made = case.model.white_piece(f.nuisance, effect, every, case.whiten)
            return OfSome.of(made).rows(slice(None) if case.complete else case.rows)

        return gains_at(columns, trials, basis, y) / variance

    found = {
        p.name: _spread(fitted[p.name], np.asarray(p.grid), partial(gains, p.name)) for p in still
    }
    return {name: std for name, std in found.items() if np.isfinite(std)}


def moments_of(case: Case, effect: Effect, f: Fit) -> list[Parameter]:
    """Return the nonlinear parameters of an effect of a fit with which nothing changes there."""
    moved = np.any(f.jacobian[:, case.columns_of(effect, f)] != 0, axis=0)
    return [p for p, moves in zip(effect.parameters, moved, strict=True) if not (p.linear or moves)]


def without_one(case: Case, effect: Effect, f: Fit) -> tuple[Floats | Spanned, Floats]:
    """Orthonormal basis of all columns of a fit but those of an effect, and what it leaves, (n,).

    Of what the fit leaves and the effect makes.
    """
    return _beside(case, f, case.columns_of(effect, f), _left_and_made(case, effect, f))


def _left_and_made(case: Case, effect: Effect, f: Fit) -> Floats:
    """What a fit leaves and an effect makes, white (n,)."""
    own, fitted = case.columns_of(effect, f), f.effects[effect.id]
    linear = [i for i, p in enumerate(effect.parameters) if p.linear]
    made = f.jacobian[:, own][:, linear] @ [fitted[effect.parameters[i].name] for i in linear]
    return case.white(f.residuals + made)


def other_optima(case: Case, effect: Effect, f: Fit, variance: float) -> dict[str, float]:
    """Return how far parameters of an effect are off if another optimum is the right one.

    Root of the mean square over all optima of its one parameter on a scale of ratios, by name;
    nothing where there is no other one to speak of. ``variance``: of a whitened reading.
    """
    free = of_ratios(effect)
    if free is None or len(case.rows) >= MANY_ROWS or variance <= 0:
        return {}
    own = case.columns_of(effect, f)
    fitted = np.array([f.effects[effect.id][p.name] for p in effect.parameters])
    linear = [i for i, p in enumerate(effect.parameters) if p.linear]
    at = effect.parameters.index(free)
    if not f.jacobian[:, own[at]].any():  # a moment
        return {}
    basis, y = _beside_few(case, f, own, _left_and_made(case, effect, f))
    along = Along.of(case, effect, free, Beside(f.nuisance, basis, y), free.grid)
    found, near = along.at(fitted[[at]])[0], APART * case.std(effect, f, variance)[at]
    squares, weights = np.zeros(len(fitted)), 1.0
    seen = [fitted[at]]
    for top, most in zip(*along.peaks(), strict=True):
        if most < found - NEGLIGIBLE * variance:
            break
        gain, place = along.best_about(top)
        if gain < found - NEGLIGIBLE * variance or np.min(np.abs(np.subtract(seen, place))) <= near:
            continue
        seen.append(place)
        there = np.zeros(len(fitted))
        there[at] = place
        there[linear] = along.sizes(place)
        weight = np.exp(min(gain - found, 0.0) / (2.0 * variance))
        squares, weights = squares + weight * (there - fitted) ** 2, weights + weight
    off = np.sqrt(squares / weights)
    return {p.name: float(x) for p, x in zip(effect.parameters, off, strict=True) if x > 0}


def determined(effect: Effect, std: Mapping[str, float]) -> dict[str, float]:
    """Return standard errors; inf of a parameter that may have any value that is looked for."""
    wide = [p.name for p in effect.parameters if p.grid and std[p.name] > max(p.grid) - min(p.grid)]
    return {**std, **dict.fromkeys(wide, np.inf)}


def _beside(case: Case, f: Fit, own: list[int], y: Floats) -> tuple[Floats | Spanned, Floats]:
    """Orthonormal basis of all columns of a fit but some, and what it leaves of y."""
    if len(y) < MANY_ROWS:
        return _beside_few(case, f, own, y)
    every = case.white_jacobian(f)
    hold = np.zeros(every.shape[1], dtype=bool)
    hold[own] = True
    found = spanned(every, y, hold)
    return found, found.left(y)


def _beside_few(case: Case, f: Fit, own: list[int], y: Floats) -> tuple[Floats, Floats]:
    """Return the same of few rows: all that is fitted is in the basis of the fit."""
    basis = f.basis @ basis_of_all(np.delete(case.in_basis(f), own, axis=1))
    return basis, y - basis @ (basis.T @ y)


def _spread(fitted: float, grid: Floats, gains: Callable[[Floats], Floats]) -> float:
    """Root of the mean square about the fitted value; inf where every value is as likely."""
    grid = np.unique(np.append(grid, fitted))
    coarse = gains(grid)
    likely = np.flatnonzero(coarse >= coarse.max() - NEGLIGIBLE)
    first, last = likely[0] - 1, likely[-1] + 1
    trials = np.linspace(grid[max(first, 0)], grid[min(last, len(grid) - 1)], TRIALS)
    fine = gains(trials)
    weights = np.exp((fine - fine.max()) / 2.0)
    std = np.sqrt(np.average((trials - fitted) ** 2, weights=weights))
    anywhere = np.sqrt(np.mean((np.linspace(grid[0], grid[-1], TRIALS) - fitted) ** 2))
    return float(std) if std < DETERMINED * anywhere else np.inf
