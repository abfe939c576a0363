"""Closed forms of Kang, Kim and Jee (2022): as printed, and with errors apart from placement."""

from __future__ import annotations

from functools import partial
from typing import Literal

import numpy as np

import trunnion._core as _core
from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.base.errors import DataError
from trunnion.base.resolution import ANY_PLACE, grown
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.machine.effects import PLACEMENT
from trunnion.machine.geometry import made_with
from trunnion.probing.estimated import estimated
from trunnion.probing.model import (
    TouchModel,
    grid_of,
    known_sigma_um,
    rounding_um,
    steps_um,
)
from trunnion.probing.recorded import readings_um
from trunnion.probing.result import ClosedFormResult, PerPosition
from trunnion.probing.scatter import scatter_um
from trunnion.setup import Setup

PER_C = ("c_deg", "EA", "EB_C", "EC", "EX", "EY_C", "EZ")
PER_A = ("a_deg", "EB_A", "EY_A")
MAX_STEPS = 50

SEES_PRINTED = (
    "The printed forms assume a perfectly placed artefact: EC0A is found plus its yaw, EZ0A plus "
    "its height, EX0C and EY0C cancel on average over C (equations (6) and (7) return the "
    "artefact's eccentricity), and EB0A comes out too small on side faces (equation (9) takes "
    "distances from the X axis)."
)
SEES_SEPARATING = (
    "The separating forms find the eight location errors and the six placement parameters from "
    "the same touches; probe lobing, the artefact's height, XZ squareness and Z backlash are not "
    "identifiable."
)


@checked
def closed_form(
    data: Touches,
    setup: Setup,
    method: Literal["printed", "separating"] = "separating",
) -> ClosedFormResult:
    """Estimate the location errors of a `trt-ca` table from the paper's touches of the cross.

    Touches are chosen by a_deg, c_deg and `point` (the paper's labels 1 to 20); `cycle` is
    ignored, repeated touches are averaged, others left aside. Rows that repeat others (pasted
    twice, or copied to another cycle) count once; a note says so.

    Parameters
    ----------
    data
        Touches with labels.
    setup
        Machine, artefact and probe; half a tick of the trigger is taken off.
    method
        "printed": equations (3) to (20) for any steps of C and A = ±90°, as printed but for the
        corrections listed in `slips`; other tilts are refused, as (9) and (10) do not hold there.
        "separating": closed forms derived from the same 72 touches (C = 0°, 90°, 180°, 270° and
        A = ±90°) for the eight errors and the six placement parameters, applied once to the
        readings and once to what the exact model leaves of them.

    Raises
    ------
    DataError
        Touches that the forms need are missing or lie off the modelled surface; no labels; touches
        17 to 20 at another tilt than ±90° with "printed".
    UnknownNameError
        Another method.

    References
    ----------
    Kang, Kim, Jee (2022), equations (3) to (20); derivation of the separating forms in
    ``docs/explanation/closed-forms.md``.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> round(tn.closed_form(touches, setup, method="separating")["EX0C"], 2)
    14.95
    """
    is_printed = choose("method", method, ("printed", "separating")) == "printed"
    return estimated(data, setup, partial(_solved, method=method, is_printed=is_printed))


def _solved(data: Touches, setup: Setup, method: str, *, is_printed: bool) -> ClosedFormResult:
    """Solve the closed forms."""
    model = TouchModel(setup)
    moves = model.moves(data)
    if data.point is None:
        raise DataError("column point: got none, expected the paper's labels 1 to 20")
    labels = [int(label) for label in data.point]
    start = model.values()
    # Scatter of a reading about the model that fits; what the printed forms leave is not noise.
    # (Fitted whatever is known: touches off the modelled surface are refused here.)
    fit = model.core.fit(moves, start, huber=None, sigma_um=0.0, priors=[], max_steps=MAX_STEPS)
    known = known_sigma_um(setup, data)
    sigma, scattered = known or max(fit["sigma_um"], rounding_um(setup, data)), None
    if not known:
        jacobian = model.core.linearise(moves, fit["values"])[1]
        scattered = scatter_um(setup, data, jacobian, fit["residuals_um"])
    each, said = (sigma, ()) if scattered is None else (scattered[0], scattered[1:])
    printed, per_c, per_a, operator = model.core.printed(moves, labels)
    per_position = PerPosition(
        c=tuple(dict(zip(PER_C, row, strict=True)) for row in per_c.tolist()),
        a=tuple(dict(zip(PER_A, row, strict=True)) for row in per_a.tolist()),
    )
    count = len(model.error_names)
    checks: dict[str, tuple[float, float]] = {}
    values = start.copy()
    values[:count] = printed
    if not is_printed:
        values, kappa, zeta, operator = model.core.separate(moves, labels, start)
        # The variance of ζ is 35/48 of that of one reading.
        checks = {"κ": (kappa, 1.0), "ζ": (zeta, float(np.sqrt(35 / 48)))}
    names = model.names[: count if is_printed else len(values)]
    covariance = (each * operator) @ (each * operator).T
    covariance = _beside_rounding(model, data, values, operator, covariance)
    spread = np.sqrt(np.diag(covariance))
    found = dict(zip(model.names, map(float, values), strict=True))
    return ClosedFormResult(
        method=f"{method} closed forms",
        errors={name: found[name] for name in model.error_names},
        placement=None if is_printed else {name: found[name] for name in PLACEMENT},
        effects={},
        std_errors=dict(zip(names, map(float, spread), strict=True)),
        names=names,
        covariance=covariance,
        residuals_um=model.core.residuals(moves, values),
        sigma_um=sigma,
        degrees_of_freedom=float(np.any(operator != 0, axis=0).sum() - len(names)),
        converged=True,
        per_position=per_position,
        checks_um={name: (value, share * sigma) for name, (value, share) in checks.items()},
        sees=SEES_PRINTED if is_printed else SEES_SEPARATING,
        slips=tuple(_core.closed_form_slips()) if is_printed else (),
        notes=said,
        **made_with(setup, data),
    )


def _beside_rounding(
    model: TouchModel, data: Touches, values: Floats, operator: Floats, covariance: Floats
) -> Floats:
    """Covariance that knows of touches that round alike, as :func:`trunnion.identify` has it."""
    if not np.any(steps_um(model.setup, data)):
        return covariance
    along, moves = readings_um(data), model.moves(data)
    jacobian = model.core.linearise(moves, values)[1]
    residuals = model.core.residuals(moves, values)
    grid = grid_of(model, data, jacobian)
    noise = grid.noise(residuals, len(along) - len(values), jacobian)
    columns = jacobian[:, : len(covariance)]
    drawn = grid.draws(along, residuals, columns, covariance, noise, ANY_PLACE)
    return covariance if drawn is None else grown(covariance, operator @ drawn)
