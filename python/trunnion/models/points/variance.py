"""What belongs to a feature, and what to its measurement: components of variance."""

from __future__ import annotations

import numpy as np
from scipy import special

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.model import FINEST_NOISE

MAX_P_VALUE = 0.005
MIN_FREEDOM = 3


def variance_components(
    residuals: Floats, replicates: Integers | None
) -> tuple[Integers, float, float] | None:
    """Label of each reading, and variance between features and of one measurement, µm².

    None where nothing was measured again (what agrees better than instruments resolve is a copy),
    or where features do not differ (F test, 0.5 %).
    """
    if replicates is None:
        return None
    single = np.flatnonzero(replicates < 0)
    label = np.asarray(replicates).copy()
    label[single] = label.max() + 1 + np.arange(len(single))
    label = np.unique(label, return_inverse=True)[1].reshape(-1)
    count = np.bincount(label)
    mean = np.bincount(label, residuals) / count
    several = count > 1
    within_freedom = int(np.sum(count[several] - 1))
    between_freedom = int(np.sum(several))
    if within_freedom < MIN_FREEDOM:
        return None
    within = float(np.sum(((residuals - mean[label]) ** 2)[several[label]])) / within_freedom
    apart = float(np.sum((count * mean**2)[several])) / between_freedom
    if within < FINEST_NOISE**2:
        return None
    if special.fdtrc(between_freedom, within_freedom, apart / within) > MAX_P_VALUE:
        return None
    repeats = float(np.mean(count[several]))
    return label.astype(np.intp), (apart - within) / repeats, within
