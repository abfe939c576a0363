"""`scene`: the view in space of a result, a measurement or a set-up."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.diagnosis.records import WITHOUT_DATA
from trunnion.diagnosis.result import Diagnosis
from trunnion.plot.scenes.machine import posture
from trunnion.plot.scenes.touches import machine_view, touches_view
from trunnion.setup import Setup

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def scene(thing: Any, *context: Any, **options: Any) -> Figure:
    """Return a view in space that one can turn, as a Plotly figure; notebooks show it.

    Parameters
    ----------
    thing
        A set-up (the machine in a posture: ``A=90``); touches or a plan (probe path and approach
        vectors, posture by posture); an identification or a diagnosis of touches (residuals as
        arrows); one or more volumetric errors (error field, side by side); a contouring run
        (contour error as colour) or a path; points, a sweep, a flatness; a part program; a
        hybrid mechanism (``pose=`` of its joints), a transformed cube.
    context
        What else it takes: the set-up of touches; touches and set-up of an identification; further
        volumetric errors.
    options
        ``magnification`` of error arrows (their scale in µm is stated in the picture);
        ``residuals_um`` and ``probe_path=False`` for touches; ``pose`` and ``names`` for volumetric
        errors.

    Raises
    ------
    InputError
        There is nothing to see in space of such a thing, or context is missing.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(artefact=tn.Artefact("cross"))
    >>> view = scene(tn.plan(setup), setup)
    >>> len(view.layout.sliders[0].steps)
    9
    """
    for kind in type(thing).__mro__:
        if kind.__name__ in VIEWS:
            made = VIEWS[kind.__name__](thing, context, options)
            return made.figure() if hasattr(made, "steps") else made
    raise InputError(
        f"scene: got {type(thing).__name__}, expected one of {', '.join(sorted(VIEWS))}"
    )


def _one(context: tuple[Any, ...], kind: type, of: str) -> Any:
    """Return the one thing of a class in the context."""
    found = [thing for thing in context if isinstance(thing, kind)]
    if len(found) != 1:
        raise InputError(
            f"scene of {of}: got {len(found)} {kind.__name__}, expected the one that it is of as "
            f"an argument: scene({kind.__name__.lower()})"
        )
    return found[0]


def _setup(setup: Setup, _: tuple[Any, ...], options: dict[str, Any]) -> Any:
    return machine_view(setup, posture(setup, options))


def _touches(touches: Touches, context: tuple[Any, ...], options: dict[str, Any]) -> Any:
    return touches_view(touches, _one(context, Setup, "touches"), **options)


def _identified(result: Any, context: tuple[Any, ...], options: dict[str, Any]) -> Any:
    of = type(result).__name__
    touches, setup = _one(context, Touches, of), _one(context, Setup, of)
    return touches_view(touches, setup, **{"residuals_um": result.residuals_um, **options})


def _diagnosed(d: Diagnosis, context: tuple[Any, ...], options: dict[str, Any]) -> Any:
    """Residuals of the extended model, or ``which="before"``, of touches; data of other kinds."""
    which = options.pop("which", "after")
    if which not in ("before", "after"):
        raise InputError(f"which: got {which!r}, expected 'before' or 'after'")
    if isinstance(d.data, tuple):
        raise InputError(
            f"scene: got a diagnosis of {len(d.data)} measurements together, expected a diagnosis "
            "of one of them: each has a place of its own in space"
        )
    if d.data is None:
        raise InputError(f"scene: {WITHOUT_DATA}")
    if not isinstance(d.data, Touches) or d.residuals is None:
        return scene(d.data, *context, **options)
    record = d.residuals
    values: Floats = record.before if which == "before" else record.after
    rows = d.data[record.rows]
    return touches_view(rows, d.setup, **{"residuals_um": values, **options})


def _later(module: str, name: str, *, several: bool = False) -> Callable[..., Any]:
    """Return a view of a module that is imported when it is used."""

    def view(thing: Any, context: tuple[Any, ...], options: dict[str, Any]) -> Any:
        made = getattr(importlib.import_module(f"trunnion.plot.scenes.{module}"), name)
        if several:
            return made([thing, *context], **options)
        return made(thing, **options)

    return view


VIEWS: dict[str, Callable[..., Any]] = {
    "ClosedFormResult": _identified,
    "ContourRun": _later("paths", "run_view"),
    "CubeChange": _later("hybrid", "cube_view"),
    "Diagnosis": _diagnosed,
    "IdentificationResult": _identified,
    "Mechanism": _later("hybrid", "mechanism_view"),
    "Path": _later("paths", "path_view"),
    "Points": _later("fields", "points_view"),
    "Program": _later("paths", "program_view"),
    "Flatness": _later("fields", "flatness_view"),
    "Setup": _setup,
    "Sweep": _later("fields", "sweep_view"),
    "Touches": _touches,
    "VolumetricError": _later("fields", "volume_figure", several=True),
}
"""Class → the view of it: the table behind ``result.scene()``."""
