"""The case that a diagnosis starts from: the plain fit, noise and steps, linearised candidates."""

import numpy as np

from trunnion.base.errors import DataError, TooFewReadingsError
from trunnion.base.resolution import Floor, Grid
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.fit import Fit, fit
from trunnion.diagnosis.linearised import Linearised
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.noise import Whitener
from trunnion.diagnosis.own_effects import check_own
from trunnion.diagnosis.steps import grid_of, white_beside, white_rounding, white_variance
from trunnion.diagnosis.whitening import Whiten, Whiteners, identity


def plain_fit(model: Model) -> Fit:
    """Fit of a model without effects, readings as they are."""
    start = np.asarray(model.start, dtype=np.float64)
    return fit(model, np.arange(len(model.readings)), (), start, {}, identity)


def case_of(model: Model, *, dependent: bool = False) -> Case:
    """Fit the model without effects, and linearise the candidates there.

    ``dependent``: whether to take no residuals for stationary noise.
    """
    n, p = len(model.readings), len(model.nuisance)
    if not np.all(np.isfinite(model.readings.values)):
        bad = int(np.argmin(np.isfinite(model.readings.values)))
        raise DataError(
            f"reading of row {model.readings.rows[bad]}: got {model.readings.values[bad]}, "
            "expected a finite number"
        )
    for effect in model.effects:
        check_own(effect, n)
    if n <= p:
        raise TooFewReadingsError(
            f"readings: got {n} for {p} unknowns, expected more than unknowns"
        )
    if (known := model.known_noise) is not None:
        return whitened(model, None, model.grid, known)
    plain = plain_fit(model)
    grid = grid_of(model, plain.residuals, plain.dof, plain.jacobian)
    whiten = (model.dependent if dependent else model.whitener)(plain.residuals)
    if grid is not None and whiten is identity:
        whiten = white_beside(grid, grid.noise(plain.residuals, plain.dof, plain.jacobian))
    return whitened(model, plain, grid, whiten)


def whitened(model: Model, plain: Fit | None, grid: Grid | None, whiten: Whiten) -> Case:
    """Case of all readings; ``plain``: a fit of readings as they are to start from, if there is."""
    rows, (known, places) = np.arange(len(model.readings)), model.known_alone
    if plain is None or whiten is not identity:
        start = known if plain is None else plain.nuisance
        plain = fit(model, rows, (), np.asarray(start, dtype=np.float64), {}, whiten)
    floor = _floor(model, grid, whiten)
    dependent = isinstance(whiten, Whitener) and whiten.dependent
    if dependent or (isinstance(whiten, Whiteners) and whiten.known):
        # Whitened readings have a variance of 1; dependent ones count as fewer than they are.
        floor = Floor(max(floor.variance, 1.0))
    linearised = Linearised(model, plain.nuisance, whiten, places)
    return Case(model, rows, whiten, plain, linearised, floor, grid)


def _floor(model: Model, grid: Grid | None, whiten: Whiten) -> Floor:
    """Least variance of a white reading: of errors of rounding alone, or what is no evidence."""
    least = np.broadcast_to(np.asarray(model.readings.least), len(model.readings))
    smallest = white_variance(least, whiten)
    return Floor(smallest if grid is None else max(smallest, white_rounding(grid, whiten)))
