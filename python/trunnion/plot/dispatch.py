"""Which picture a result is drawn by: the table behind ``result.plot()``."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import trunnion.plot
from trunnion.base.errors import InputError
from trunnion.plot.axes import close

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    "Flatness": "plot_flatness",
    "Identifiability": "plot_identifiability",
    "Iso2302": "plot_positioning",
    "Iso2302Rotary": "plot_positioning",
    "Iso2304": "plot_circular",
    "IdentificationResult": "plot_estimates",
    "MachineComparison": "plot_comparison",
    "Margins": "plot_margins",
    "Observability": "plot_observability",
    "ProbePath": "plot_probe_path",
    "Sensitivity": "plot_sensitivity",
    "Straightness": "plot_straightness",
    "VolumetricError": "plot_volumetric",
}
"""Class of a result → function of :mod:`trunnion.plot`."""

NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))

DESCRIBED: dict[str, str] = {}
"""Class of a result → function of :mod:`trunnion.plot` that returns its picture, or several, as
:class:`~trunnion.plot.picture.Picture` (or a scene with ``to_plotly``); before `PICTURES`."""


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
        if kind.__name__ in DESCRIBED:
            return _described(kind.__name__, result)[0].draw(**options)
    raise InputError(
        f"plot: got {type(result).__name__}, expected one of {', '.join(sorted(PICTURES))}"
    )


def pictures(result: Any) -> tuple[Any, ...]:
    """Return the pictures of a result's page: descriptions, or SVG where there are none."""
    for kind in type(result).__mro__:
        if kind.__name__ in DESCRIBED:
            return _described(kind.__name__, result)
        if kind.__name__ in PICTURES:
            drawn = draw(result)
            figure = getattr(drawn, "figure", drawn)
            try:
                return (_svg(figure),)
            finally:
                close(figure)
    return ()


def _described(kind: str, result: Any) -> tuple[Any, ...]:
    made = getattr(trunnion.plot, DESCRIBED[kind])(result)
    return tuple(made) if isinstance(made, list | tuple) else (made,)


def _svg(figure: Figure) -> str:
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "trunnion"}):
        figure.savefig(buffer, format="svg", metadata=NO_METADATA)
    text = buffer.getvalue()
    return text[text.index("<svg") :]
