"""Which pictures a result or measured data are drawn by: the tables behind ``.plot()``."""

from __future__ import annotations

import base64
import html
import io
from typing import Any

import trunnion.plot
from trunnion.base.errors import InputError, TrunnionError
from trunnion.plot.picture import Kind, Picture
from trunnion.plot.static import size_of

THUMBNAIL_DPI = 62

PICTURES = {
    "AxisLog": "plot_axis_log",
    "Ballbar": "plot_circular",
    "BallbarIdentification": "plot_ballbar_residuals",
    "Circle": "plot_circle",
    "ClosedFormResult": "plot_estimates",
    "CncParameters": "plot_cnc_parameters",
    "Comparison": "plot_methods",
    "CompensationTable": "plot_compensation_table",
    "Conformity": "plot_conformity",
    "ContourComparison": "plot_contour_error",
    "ContourRun": "plot_contour_error",
    "ContourSweep": "plot_contour_sweep",
    "Correction": "plot_correction",
    "CubeChange": "plot_ballbar_view",
    "CubeStudy": "plot_cube_study",
    "Diagnosis": "plot_diagnosis",
    "DiagnosisBatch": "plot_batch",
    "Diameters": "plot_diameters",
    "Estimate": "plot_estimate",
    "Flatness": "plot_flatness",
    "Identifiability": "plot_identifiability",
    "IdentificationResult": "plot_estimates",
    "InstrumentComparison": "plot_instruments",
    "Iso2302": "plot_positioning",
    "Iso2302Rotary": "plot_positioning",
    "Iso2304": "plot_circular",
    "Ladder": "plot_ladder",
    "Levels": "plot_levels",
    "MachineComparison": "plot_comparison",
    "Margins": "plot_margins",
    "Observability": "plot_observability",
    "Points": "plot_points",
    "Positioning": "plot_positioning",
    "ProbePath": "plot_probe_path",
    "RepeatablePart": "plot_repeatable",
    "Residuals": "plot_readings",
    "Sensitivity": "plot_sensitivity",
    "Straightness": "plot_straightness",
    "Sweep": "plot_error_motion",
    "VolumetricError": "plot_volumetric",
}
"""Class → function of :mod:`trunnion.plot` that draws it by matplotlib."""

DESCRIBED = {
    "AxisLog": "axis_log_pictures",
    "Ballbar": "circular_pictures",
    "BallbarIdentification": "ballbar_residuals_picture",
    "Circle": "circle_picture",
    "ClosedFormResult": "estimates_pictures",
    "CncParameters": "cnc_parameters_pictures",
    "Comparison": "methods_pictures",
    "CompensationTable": "compensation_table_picture",
    "Conformity": "conformity_picture",
    "ContourComparison": "contour_pictures",
    "ContourRun": "contour_pictures",
    "ContourSweep": "contour_sweep_picture",
    "Correction": "correction_picture",
    "CubeChange": "ballbar_view_picture",
    "CubeStudy": "cube_study_picture",
    "Diagnosis": "diagnosis_picture",
    "DiagnosisBatch": "batch_pictures",
    "Diameters": "diameters_picture",
    "Estimate": "estimate_pictures",
    "Flatness": "flatness_picture",
    "Identifiability": "identifiability_picture",
    "IdentificationResult": "estimates_pictures",
    "InstrumentComparison": "instruments_picture",
    "Iso2302": "positioning_picture",
    "Iso2302Rotary": "positioning_picture",
    "Iso2304": "circular_picture",
    "Ladder": "ladder_of_picture",
    "Levels": "levels_pictures",
    "MachineComparison": "trend_pictures",
    "Margins": "margins_picture",
    "Observability": "observability_picture",
    "Points": "points_picture",
    "Positioning": "positioning_picture",
    "ProbePath": "probe_path_picture",
    "RepeatablePart": "repeatable_picture",
    "Residuals": "readings_picture",
    "Sensitivity": "sensitivity_picture",
    "Straightness": "straightness_picture",
    "Sweep": "error_motion_pictures",
    "VolumetricError": "volumetric_picture",
}
"""Class → function of :mod:`trunnion.plot` that returns its picture, or several, as
:class:`~trunnion.plot.picture.Picture`; the report of a diagnosis has more."""


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


def pictures(result: Any) -> tuple[Picture, ...]:
    """Return the pictures of a result or of data, as described; none where there is none."""
    for kind in type(result).__mro__:
        if kind.__name__ in DESCRIBED:
            made = getattr(trunnion.plot, DESCRIBED[kind.__name__])(result)
            return tuple(made) if isinstance(made, list | tuple) else (made,)
    return ()


def thumbnail(result: Any) -> str:
    """Return the first picture of a result as a small image in HTML, for a notebook; else "".

    The figure is none of pyplot's, so that a notebook shows it once.
    """
    try:
        found = pictures(result)
    except TrunnionError:  # a field or readings that a result read from JSON does not hold
        return ""
    if not found:
        return ""
    from matplotlib.figure import Figure

    picture = found[0]
    figure = Figure(figsize=size_of(picture), layout="constrained", facecolor="white")
    polar = "polar" if picture.kind is Kind.POLAR else None
    picture.draw(figure.add_subplot(projection=polar))
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=THUMBNAIL_DPI, metadata={"Software": None})
    image = base64.b64encode(buffer.getvalue()).decode()
    alt = html.escape(picture.description, quote=True)
    return f'<img alt="{alt}" src="data:image/png;base64,{image}">'
