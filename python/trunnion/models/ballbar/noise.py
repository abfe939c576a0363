"""Noise of ball-bar lengths with a memory: what a recorder filters, what shakes the machine slowly.

Readings of a run come one after the other, some milliseconds apart. Filters of the recorder and of
the transmitter, and vibrations far slower than the readings, make the errors of neighbours alike.
Taken for independent ones, what they draw round the circle looks like causes of 0.1 µm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.fit import grid_values, variant_columns
from trunnion.diagnosis.noise import Channel, basis_beside, whitener
from trunnion.diagnosis.outliers import far_out_beside
from trunnion.diagnosis.whitening import identity

if TYPE_CHECKING:
    from trunnion.models.ballbar.model import BallbarModel

MIN_READINGS = 6  # a column that is no noise: of fewer the fit makes neighbours alike


def noise_of(model: BallbarModel, residuals: Floats) -> Callable[[Floats], Floats]:
    """Whitener of readings whose noise has a memory within a run; else they stay as they are.

    It is what is left when every candidate is fitted at once, of the residuals (n,) of the plain
    model. What is no stationary noise is no noise with a memory: structure is looked for in it.
    """
    channel = _channel(model)
    basis = basis_beside(residuals, channel)
    if len(residuals) < MIN_READINGS * basis.shape[1]:
        return identity
    left = residuals - basis @ (basis.T @ residuals)
    far = far_out_beside(basis, left, float(np.max(model.readings.least)))
    if len(far):  # false readings are no noise
        fixed = np.concatenate([channel.fixed, np.eye(len(residuals))[:, far]], axis=1)
        channel = replace(channel, fixed=fixed)
    found = whitener(model, residuals, [channel], model.path.runs)
    has_memory = not found.dependent and any(noise.order for _, noise in found.filters)
    return found if has_memory else identity


def _channel(model: BallbarModel) -> Channel:
    """All readings with the columns that are no noise in them."""
    fixed, sought = [model.base_jacobian(model.start)], []
    for effect in model.effects:
        columns = variant_columns(model, effect, model.start, grid_values(effect))
        if len(columns) == 1:
            fixed.append(columns[0])
        else:
            sought.append(columns)
    every = np.concatenate(fixed, axis=1)
    return Channel(np.arange(len(every)), every, tuple(sought))
