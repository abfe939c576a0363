"""Steps in which the readings of a model are recorded."""

from __future__ import annotations

from functools import partial

import numpy as np

from trunnion.base.recognition import recognised, unstated
from trunnion.base.repeats import Repeats
from trunnion.base.resolution import Grid
from trunnion.base.units import Flags, Floats
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.records import units_of
from trunnion.diagnosis.whitening import Scaling, Whiten, identity


def steps_of(model: Model, residuals: Floats, dof: int) -> Floats:
    """Step of each reading: the model's, or one that is recognised in the readings of a unit.

    ``residuals``, ``dof``: of the plain fit. Places on a regular grid are no steps: see
    :func:`~trunnion.base.resolution.unstated`.
    """
    readings = model.readings
    if readings.step is None and readings.clocked is not None:
        return readings.clocked
    stated = np.zeros(len(readings)) if readings.step is None else np.asarray(readings.step)
    _, index = units_of(readings)
    steps = np.array(stated, dtype=np.float64)
    planned = 0.0 if readings.planned is None else recognised(np.append(readings.planned, 0.0))
    for some in (index == i for i in range(index.max() + 1)):
        left = float(np.sqrt(np.sum(residuals[some] ** 2) / max(dof, 1)))
        off = partial(_off_start, model, some)
        known = [values[some] for values in readings.numbers]
        if step := unstated(known, float(stated[some].max()), left, off, planned):
            steps[some] = step
    return steps


def grid_of(model: Model, residuals: Floats, dof: int, jacobian: Floats) -> Grid | None:
    """Return the grid of readings that are recorded in steps; None: they are not.

    ``jacobian``: by what is always fitted, shape (n, p).
    """
    if model.grid is not None:
        return model.grid
    readings, step = model.readings, steps_of(model, residuals, dof)
    if not np.any(step > 0):
        return None
    recorded, coordinates = readings.recorded, readings.coordinates
    return Grid.of(readings.values, step, jacobian, model.replicates, recorded, coordinates)


def white_beside(grid: Grid, noise: float) -> Whiten:
    """Whitener of readings with this noise beside the errors of rounding."""
    errors = grid.errors(noise)
    if errors is None:
        return identity
    return errors if len(errors.rows) else Scaling(errors.scale)


def weights_of(whiten: Whiten) -> Floats | float:
    """Weights of readings in a fit, of size 1 where they are of one noise, shape (n,)."""
    return np.asarray(1 / whiten.scale**2) if isinstance(whiten, Repeats | Scaling) else 1.0


def white_rounding(grid: Grid, whiten: Whiten) -> float:
    """Mean variance of the errors of rounding of white readings."""
    of_grid = whiten is identity or isinstance(whiten, Repeats | Scaling)
    if of_grid or grid.known is not None:
        return grid.rounding
    return white_variance(grid.step / np.sqrt(12), whiten)


def white_variance(sizes: Floats, whiten: Whiten) -> float:
    """Mean variance, after whitening, of independent errors of these standard deviations (n,)."""
    if not np.any(sizes):
        return 0.0
    if whiten is identity:
        return float(np.mean(sizes**2))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(len(sizes), 8))
    return float(np.mean(np.asarray(whiten(sizes[:, None] * signs)) ** 2))


def _off_start(model: Model, some: Flags) -> Floats:
    """Return what these readings have more than a machine without errors gives."""
    return (model.readings.values - model.predict(model.start, {}))[some]
