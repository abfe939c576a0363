"""Measured points: deviations from their nominal places, as a vector map."""

from __future__ import annotations

import numpy as np

from trunnion.base.units import Floats
from trunnion.data.points import Points
from trunnion.models.points.geometry import Frame, groups_of


def deviations_um(points: Points) -> Floats:
    """Return measured less nominal (n, d), µm, after the best fit of place and turn of each group.

    Where the plate lay on the measuring machine is no error of the machine that made it.
    """
    labels, group = groups_of(points)
    nominal, measured = points.nominal_mm, points.measured_mm
    away = np.empty_like(nominal)
    for k, label in enumerate(labels):
        mine = group == k
        frame = Frame.of(nominal[mine], measured[mine], str(label))
        away[mine] = 1e3 * (frame.back(measured[mine]) - nominal[mine])
    return away
