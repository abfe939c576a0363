"""What estimates of touches share: readings count once, steps are recognised, mistakes named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from trunnion.base.arguments import renumber
from trunnion.base.errors import TrunnionError
from trunnion.data.distinct import distinct_rows
from trunnion.data.frame import frame_notes
from trunnion.data.touches import Touches
from trunnion.probing.mistakes import likely_mistakes, mistakes_named
from trunnion.probing.model import TouchModel, with_recognised_step
from trunnion.probing.result import IdentificationResult
from trunnion.setup import Setup

MIN_SCATTER_UM = 1e-6
"""A picometre: no measurement scatters less."""

R = TypeVar("R", bound=IdentificationResult)


def estimated(data: Touches, setup: Setup, solve: Callable[[Touches, Setup], R]) -> R:
    """Return the estimate of the rows that are readings of their own, with residuals of all rows.

    A row that repeats another has its residual, and weight 0: it is no evidence, and standard
    errors that counted it would be too small.
    """
    own = distinct_rows(data)
    if own.rows is None or own.stands_for is None:
        return _with_notes(data, setup, solve)
    try:
        found = _with_notes(own.data, setup, solve)
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


def _with_notes(data: Touches, setup: Setup, solve: Callable[[Touches, Setup], R]) -> R:
    """Solve, with the step of the readings where it is recognised, and name likely mistakes."""
    with mistakes_named(data, setup):
        result = solve(data, setup)
        left = result.residuals_um, result.degrees_of_freedom
        if recognised := with_recognised_step(setup, data, *left):
            known, said = recognised
            result = solve(data, known)
            result = replace(result, notes=(*result.notes, said))
    model = TouchModel(setup)
    mistakes = likely_mistakes(result, data, model, model.moves(data))
    vain = _without_scatter(result, setup)
    return replace(result, notes=(*frame_notes(data), *mistakes, *result.notes, *vain))


def _without_scatter(result: IdentificationResult, setup: Setup) -> tuple[str, ...]:
    """Say where nothing shows how readings scatter: standard errors are 0, or of the arithmetic."""
    if setup.probe.repeatability_um or result.sigma_um > MIN_SCATTER_UM:
        return ()
    why = "The touches fit exactly, as simulated ones without noise do"
    if result.degrees_of_freedom <= 0:
        why = "There are no more touches than parameters, and they fit exactly"
    return (
        f"{why}: nothing shows how readings scatter, and the standard errors, 0 or nearly so, say "
        "nothing of a measurement. State [probe] repeatability_um (or simulate with noise_um).",
    )
