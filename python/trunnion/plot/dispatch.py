"""Which picture a result is drawn by: the table behind ``result.plot()``."""

from __future__ import annotations

from typing import Any

import trunnion.plot
from trunnion.base.errors import InputError

__all__ = ["draw"]

PICTURES = {
    "BallbarIdentification": "plot_ballbar_residuals",
    "ClosedFormResult": "plot_estimates",
    "ContourComparison": "plot_contour_error",
    "ContourRun": "plot_contour_error",
    "ContourSweep": "plot_contour_sweep",
    "Correction": "plot_correction",
    "CubeChange": "plot_ballbar_view",
    "CubeStudy": "plot_cubes",
    "Diagnosis": "plot_diagnosis",
    "Identifiability": "plot_identifiability",
    "IdentificationResult": "plot_estimates",
    "Margins": "plot_margins",
    "Observability": "plot_observability",
    "ProbePath": "plot_probe_path",
    "Sensitivity": "plot_sensitivity",
    "VolumetricError": "plot_volumetric",
}
"""Class of a result → function of :mod:`trunnion.plot`."""


def draw(result: Any, **options: Any) -> Any:
    """Draw a result by the picture of its class; ``options`` go to that function.

    Raises
    ------
    InputError
        There is no picture for a result of this class.
    """
    for kind in type(result).__mro__:
        if kind.__name__ in PICTURES:
            return getattr(trunnion.plot, PICTURES[kind.__name__])(result, **options)
    raise InputError(
        f"plot: got {type(result).__name__}, expected one of {', '.join(sorted(PICTURES))}"
    )
