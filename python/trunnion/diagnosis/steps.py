"""Steps in which the readings of a model are recorded."""

from __future__ import annotations

from functools import partial

import numpy as np

from trunnion.base.resolution import Grid, unstated
from trunnion.base.units import Flags, Floats
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.records import units_of


def steps_of(model: Model, plain: Fit) -> Floats:
    """Step of each reading: the model's, or one that is recognised in the readings of a unit.

    Places on a regular grid are no steps: see :func:`~trunnion.base.resolution.unstated`.
    """
    readings = model.readings
    stated = np.zeros(len(readings)) if readings.step is None else np.asarray(readings.step)
    _, index = units_of(readings)
    steps = np.array(stated, dtype=np.float64)
    for some in (index == i for i in range(index.max() + 1)):
        left = float(np.sqrt(np.sum(plain.residuals[some] ** 2) / max(plain.dof, 1)))
        off = partial(_off_start, model, some)
        known = [values[some] for values in readings.numbers]
        if step := unstated(known, float(stated[some].max()), left, off):
            steps[some] = step
    return steps


def grid_of(model: Model, plain: Fit) -> Grid | None:
    """Return the grid of readings that are recorded in steps; None: they are not."""
    readings, step = model.readings, steps_of(model, plain)
    if not np.any(step > 0):
        return None
    groups = np.asarray(model.groups)
    recorded, coordinates = readings.recorded, readings.coordinates
    return Grid.of(readings.values, step, plain.jacobian, groups, recorded, coordinates)


def _off_start(model: Model, some: Flags) -> Floats:
    """Return what these readings have more than a machine without errors gives."""
    return (model.readings.values - model.predict(model.start, {}))[some]
