"""Positions that are whole numbers once they are taken for another unit: converted ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEP_AS_GIVEN = 0.01
"""Multiples of this are round as they are given."""

MIN_WHOLE = 3
"""Whole degrees among different positions, from which on they are taken for converted ones."""
WHOLE_DEG = 0.01  # what four decimals of a radian leave
MIN_DEG = 0.5

MM_PER_INCH = 25.4
STEPS_MM: Mapping[float, int] = {1.0: 3, 0.1: 5}
"""Steps of positions in mm, and how many different ones show them: by chance one in 10⁵ does."""
WHOLE_MM = 0.003  # what four decimals of an inch leave


def in_radians(values: NDArray[Any]) -> bool:
    """Whether positions are whole degrees when taken for radians, and not as they are."""
    distinct = np.unique(np.abs(values))
    degrees = np.degrees(distinct[distinct > np.radians(MIN_DEG)])
    if len(degrees) < MIN_WHOLE or len(degrees) < len(distinct) - 1:
        return False
    return bool(
        _whole(degrees, 1.0, WHOLE_DEG).all() and not _whole(distinct, STEP_AS_GIVEN, 1e-9).all()
    )


def in_inches(columns: Iterable[NDArray[Any]]) -> bool:
    """Whether positions of every column are round in mm when taken for inches, and not as given.

    25.4 times what is round in mm is whole only in steps of 0.5 or 5 mm. What such steps add up to
    differs in no third decimal, and is one coincidence, however many positions there are.
    """
    distinct = np.unique(np.abs(np.concatenate([*columns, np.zeros(1)])))
    beyond = np.round(distinct - STEP_AS_GIVEN * np.round(distinct / STEP_AS_GIVEN), 6)
    independent = len(np.unique(np.append(beyond, 0.0))) - 1
    return any(
        independent >= least and _whole(distinct * MM_PER_INCH, step, WHOLE_MM).all()
        for step, least in STEPS_MM.items()
    )


def _whole(values: NDArray[Any], step: float, tolerance: float) -> NDArray[np.bool_]:
    """Which values are multiples of a step."""
    return np.asarray(np.abs(values - step * np.round(values / step)) < tolerance)
