"""Estimates of touches of which some are no readings of their own: each reading counts once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from trunnion.base.arguments import renumber
from trunnion.base.errors import TrunnionError
from trunnion.data.distinct import distinct_rows
from trunnion.data.touches import Touches
from trunnion.probing.result import IdentificationResult

R = TypeVar("R", bound=IdentificationResult)


def of_each_once(data: Touches, estimate: Callable[[Touches], R]) -> R:
    """Return the estimate of the rows that are readings of their own, told of all rows given.

    A row that repeats another has its residual, and weight 0: it is no evidence, and standard
    errors that counted it would be too small.
    """
    own = distinct_rows(data)
    if own.rows is None or own.stands_for is None:
        return estimate(data)
    try:
        found = estimate(own.data)
    except TrunnionError as error:
        renumber(error, own.rows.tolist())
        raise
    weights = np.zeros(len(data))
    weights[own.rows] = 1.0 if found.weights is None else found.weights
    return replace(
        found,
        residuals_um=found.residuals_um[own.stands_for],
        weights=weights,
        notes=(*own.notes, *found.notes),
    )
