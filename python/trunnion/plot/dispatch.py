"""Which pictures a result or measured data are drawn by: the table behind ``.plot()``."""

from __future__ import annotations

from inspect import signature
from typing import Any

import trunnion.plot
from trunnion.base.errors import InputError, TrunnionError
from trunnion.plot.image import thumbnail_of
from trunnion.plot.picture import Picture
from trunnion.plot.static import draw_all

PICTURES = {
    "AxisLog": "axis_log_pictures",
    "BallVerification": "ball_verification_picture",
    "Ballbar": "circular_pictures",
    "BallbarIdentification": "ballbar_residuals_picture",
    "Budget": "budget_pictures",
    "Cause": "cause_pictures",
    "Circle": "circle_picture",
    "ClosedFormResult": "estimates_pictures",
    "ClosureDependence": "closure_picture",
    "CncParameters": "cnc_parameters_pictures",
    "Comparison": "methods_pictures",
    "CompensationForecast": "forecast_picture",
    "CompensationTable": "compensation_table_picture",
    "Conformity": "conformity_picture",
    "Constraint": "constraint_picture",
    "ContourComparison": "contour_pictures",
    "ContourRun": "contour_pictures",
    "ContourSweep": "contour_sweep_picture",
    "Contribution": "contribution_pictures",
    "ControlFiles": "control_files_pictures",
    "CorrectedProgram": "corrected_program_picture",
    "Correction": "correction_picture",
    "CubeChange": "ballbar_view_picture",
    "CubeStudy": "cube_study_picture",
    "Diagnosis": "diagnosis_picture",
    "DiagnosisBatch": "batch_pictures",
    "Diameters": "diameters_picture",
    "ErrorMap": "error_map_picture",
    "Estimate": "estimate_pictures",
    "ExpectedDiscrimination": "discrimination_pictures",
    "FieldMotion": "field_motion_picture",
    "Finishing": "finishing_picture",
    "Flatness": "flatness_picture",
    "Forward": "forward_pictures",
    "Gain": "gain_pictures",
    "Identifiability": "identifiability_picture",
    "IdentificationResult": "estimates_pictures",
    "InstrumentComparison": "instruments_picture",
    "Interval": "interval_picture",
    "Iso2302": "positioning_picture",
    "Iso2302Rotary": "positioning_picture",
    "Iso2304": "circular_picture",
    "Ladder": "ladder_picture",
    "Levels": "levels_pictures",
    "MachineComparison": "trend_pictures",
    "Margins": "margins_picture",
    "NextMeasurement": "next_picture",
    "NextPass": "next_picture",
    "Observability": "observability_picture",
    "PerPosition": "per_position_pictures",
    "Points": "points_picture",
    "PoseField": "pose_field_picture",
    "Positioning": "positioning_picture",
    "PrintedZeros": "printed_zeros_pictures",
    "ProbePath": "probe_path_picture",
    "Removable": "removable_picture",
    "RepeatablePart": "repeatable_picture",
    "ResidualInterval": "residual_interval_picture",
    "Residuals": "readings_picture",
    "RotaryTest": "rotary_test_pictures",
    "Sensitivity": "sensitivity_picture",
    "Setting": "setting_pictures",
    "Straightness": "straightness_picture",
    "Structure": "structure_pictures",
    "Sweep": "error_motion_pictures",
    "Touches": "touches_pictures",
    "Twist": "twist_pictures",
    "VolumetricError": "volumetric_picture",
}
"""Class → function of :mod:`trunnion.plot` that returns its picture, or several, as
:class:`~trunnion.plot.picture.Picture`; the report of a diagnosis has more."""

DRAWN = {
    "AxisLog": "plot_axis_log",
    "Ballbar": "plot_circular",
    "CncParameters": "plot_cnc_parameters",
    "ClosedFormResult": "plot_estimates",
    "Comparison": "plot_methods",
    "ContourComparison": "plot_contour_error",
    "ContourRun": "plot_contour_error",
    "Correction": "plot_correction",
    "Diagnosis": "plot_diagnosis",
    "Estimate": "plot_estimate",
    "IdentificationResult": "plot_estimates",
    "MachineComparison": "plot_comparison",
    "Observability": "plot_observability",
    "Positioning": "plot_positioning",
    "Iso2302": "plot_positioning",
    "Iso2302Rotary": "plot_positioning",
    "ProbePath": "plot_probe_path",
    "Sweep": "plot_error_motion",
    "VolumetricError": "plot_volumetric",
}
"""Class → function that draws it by matplotlib, of those with options or a layout of their own;
all others are drawn as their pictures are described."""


def _named(result: Any, table: dict[str, str]) -> tuple[str, Any] | None:
    """Return class and function of a result by the first of its classes that a table holds."""
    for kind in type(result).__mro__:
        if kind.__name__ in table:
            return kind.__name__, getattr(trunnion.plot, table[kind.__name__])
    return None


def draw(result: Any, *, ax: Any = None, **options: Any) -> Any:
    """Draw a result by the pictures of its class; return the axes, or the figure of several.

    Parameters
    ----------
    result
        Any public result, or measured data.
    ax
        Axes for the first picture; those of a new figure unless given.
    **options
        As the function of its class takes them (``tn.plot.plot_...``, or the one in `PICTURES`);
        all others as :meth:`trunnion.plot.picture.Picture.draw` does.

    Raises
    ------
    InputError
        There is no picture for a result of this class, or nothing to draw in this one.
    """
    described, own = _named(result, PICTURES), _named(result, DRAWN)
    if own is not None and described is not None and own[0] == described[0]:
        return own[1](result, ax=ax, **options)
    known = () if described is None else signature(described[1]).parameters
    found = pictures(result, **{k: options.pop(k) for k in list(options) if k in known})
    if not found:
        name = type(result).__name__
        kinds = f"one of {', '.join(sorted(PICTURES))}"
        raise InputError(
            f"plot: got {name}, expected {f'{name} with something to draw' if described else kinds}"
        )
    return draw_all(found, ax, **options)


def pictures(result: Any, **options: Any) -> tuple[Picture, ...]:
    """Return the pictures of a result or of data, as described; none where there is none.

    options: As the function that describes them takes them.
    """
    described = _named(result, PICTURES)
    if described is None:
        return ()
    made = described[1](result, **options)
    return tuple(made) if isinstance(made, list | tuple) else (made,)


def thumbnail(result: Any) -> str:
    """Return the first picture of a result as a small image in HTML, for a notebook; else "".

    The figure is none of pyplot's, so that a notebook shows it once.
    """
    try:
        found = pictures(result)
    except TrunnionError:  # a field or readings that a result read from JSON does not hold
        return ""
    return thumbnail_of(found[0]) if found else ""
