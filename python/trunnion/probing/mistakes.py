"""Common mistakes of a measurement, recognised by what they do to its estimates.

A sentence names the likely cause; no number is changed. Other set-ups and units are tried only
where the residuals are no touch probe's, or where the touches are off the modelled surface.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

import numpy as np

from trunnion.base.errors import DataError, TrunnionError
from trunnion.base.units import unit_of
from trunnion.data.touches import Touches
from trunnion.probing.model import TouchModel, rounding_um
from trunnion.probing.result import NO_PROBE_UM, IdentificationResult
from trunnion.setup import AxisSetup, Machine, Setup
from trunnion.setup.machines import presets

TIP_SHARE = 0.1
"""Of the ball's radius: how near an estimate has to come; errors of machines are smaller."""

LEAST_UM = 200.0
"""Below this an estimate is an ordinary error of a machine."""

LARGE_UM = 1000.0
"""Beyond this a location error is a length that the set-up states wrongly."""

TINY_UM = (1e-3, 0.1)
"""Where the largest position error of no machine lies, but that of one in mm does."""

TINY_ARCSEC = (1e-7, 0.1)
"""Where the largest angular error of no machine lies, but one in degrees or radians does."""

SURE_SIGMAS = 5.0
"""Standard errors that an estimate is large for before its size is discussed."""

SHARE = 0.1
"""Of the residuals: what a guess has to leave at most, beside the errors of rounding."""

MAX_BEFORE_UM = 500.0
"""Residuals beyond this, and touches off the surface, count as this."""

RIVAL_FACTOR = 2.0
"""Guesses that leave up to so many times the residuals of the best are named beside it."""

MAX_ROWS = 500
MIN_FREEDOM = 5
MAX_STEPS = 50

UNITS = {"inches": 25.4, "µm": 1e-3, "cm": 10.0, "m": 1e3}
"""Units that positions may be in, in mm."""

ROUND_MM = (0.5, 1.0, 2.0, -0.5, -1.0, -2.0)
"""By how much a length is easily wrong."""

LENGTHS = (
    ("probe", "ball_radius_mm"),
    ("artefact", "length_mm"),
    ("artefact", "width_mm"),
    ("artefact", "diameter_mm"),
)
"""Lengths that residuals show; an artefact's height looks like its placement."""

Guess = tuple[str, Touches, Setup]


def likely_mistakes(result: IdentificationResult, data: Touches, setup: Setup) -> tuple[str, ...]:
    """Name what is likely wrong with a measurement that gives this result."""
    said = []
    if result.rms_um > NO_PROBE_UM:
        data = _some(data)
        before = min(_scatter_um(data, setup), result.rms_um)
        if before > NO_PROBE_UM and (cause := _cause(data, setup, before)):
            said.append(f"Residuals of {before:.4g} µm have a likely cause: {cause}")
    # Where the placement is not estimated, it is in the errors.
    if result.placement is not None and not said:
        said += _by_size(result, setup)
    if _as_planned(result, setup):
        said.append(
            "Every touch lies where the set-up expects it, the placement of the artefact included: "
            "is this the plan, not what was measured?"
        )
    if doubt := in_other_units(setup.machine.errors):
        said.append(f"[machine.errors] has {doubt}")
    return tuple(said)


def in_other_units(errors: Mapping[str, float]) -> str:
    """Ask whether errors are in mm, degrees or radians; empty where there is no doubt."""
    given = {name: float(value) for name, value in errors.items() if value}
    return " ".join(
        f"{', '.join(f'{name} = {value:g}' for name, value in some.items())}: {question}"
        for letters, (least, limit), question in (
            ("XYZ", TINY_UM, "are these mm? They are expected in µm."),
            ("ABC", TINY_ARCSEC, "are these degrees or radians? They are expected in arcsec."),
        )
        if (some := {name: value for name, value in given.items() if name[1] in letters})
        and least <= max(map(abs, some.values())) < limit
    )


@contextmanager
def large_errors_named(errors: Mapping[str, float]) -> Iterator[None]:
    """Add errors of more than 1 mm to a DataError about moves that miss the artefact."""
    try:
        yield
    except DataError as error:
        large = [
            f"{k} = {v:g} µm" for k, v in errors.items() if k[1] in "XYZ" and abs(v) > LARGE_UM
        ]
        if not large:
            raise
        raise DataError(f"{error}. Likely cause: {', '.join(large)}: errors are in µm") from None


@contextmanager
def mistakes_named(data: Touches, setup: Setup) -> Iterator[None]:
    """Add the likely cause to a DataError about touches that lie off the modelled surface."""
    try:
        yield
    except DataError as error:
        data = _some(data)
        if np.isfinite(_scatter_um(data, setup)) or not (cause := _cause(data, setup, np.inf)):
            raise
        raise DataError(f"{error}. Likely cause: {cause}") from None


def _by_size(result: IdentificationResult, setup: Setup) -> list[str]:
    """Name position errors that no machine has."""
    radius = setup.probe.ball_radius_mm * 1e3
    said = []
    sure = {
        name: value
        for name, value in result.errors.items()
        if name[1] in "XYZ" and abs(value) > SURE_SIGMAS * result.std_errors.get(name, np.inf)
    }
    for name, value in sure.items():
        height = value - setup.machine.errors.get(name, 0.0)
        near = abs(abs(height) - radius) <= TIP_SHARE * radius
        if name.startswith("EZ0") and near and abs(height) >= LEAST_UM:
            where = "to the tip of the ball" if height < 0 else "beyond the centre of the ball"
            said.append(
                f"{name} is {height:+.0f} µm, about the radius of the ball ({radius:.0f} µm): was "
                f"the tool's length measured {where}? It is expected to the centre."
            )
        elif abs(height) > LARGE_UM:
            said.append(
                f"{name} is {height:+.0f} µm from the set-up, more than 1 mm: are the places of "
                "the axes and of the artefact there (point_mm, place_mm) right, and in mm?"
            )
    largest = max(sure, key=lambda name: abs(sure[name]), default=None)
    if largest is not None and TINY_UM[0] < abs(sure[largest]) < TINY_UM[1]:
        said.append(
            f"The largest position error is {largest} = {sure[largest]:.2g} µm: if the data are "
            "simulated, were the errors given in mm? They are expected in µm."
        )
    return said


def _cause(data: Touches, setup: Setup, before_um: float) -> str | None:
    """Say with what other set-up or unit the touches fit; None: with none that is tried."""
    tried = [(_scatter_um(meant, other), text) for text, meant, other in _guesses(data, setup)]
    best = min((scatter for scatter, _ in tried), default=np.inf)
    beside_rounding = np.sqrt(max(best**2 - rounding_um(setup, data) ** 2, 0.0))
    if beside_rounding > SHARE * min(before_um, MAX_BEFORE_UM):
        return None
    texts = [text for scatter, text in tried if scatter <= RIVAL_FACTOR * best]
    return f"the touches fit to {best:.2g} µm {', or '.join(texts)}."


def _guesses(data: Touches, setup: Setup) -> Iterator[Guess]:
    """Yield what may have been meant: how it reads, the touches and the set-up then."""
    for unit, mm in UNITS.items():
        x, y, z = data.position_mm.T * mm
        with suppress(TrunnionError):  # too far for positions
            meant = data.with_columns(x_mm=x, y_mm=y, z_mm=z)
            yield f"if their positions are in {unit}", meant, setup
    turned = {f"{letter}_deg": np.degrees(angle) for letter, angle in data.rotary_deg.items()}
    with suppress(TrunnionError):  # too far for angles
        yield "if their angles are in radians", data.with_columns(**turned), setup
    for part, changes, text in _changes(data, setup):
        with suppress(TrunnionError):  # not a set-up: other axes, a cross without arms
            yield text, data, replace(setup, **{part: changes})


def _changes(data: Touches, setup: Setup) -> Iterator[tuple[str, Any, str]]:
    """Yield a part of the set-up, what it may have been meant to be, and how that reads."""
    letters = [letter.upper() for letter in data.rotary_deg]
    for turned in [*letters, *(["".join(letters)] if len(letters) > 1 else [])]:
        known = {letter: setup.axes.get(letter, AxisSetup()) for letter in turned}
        axes = {letter: replace(axis, sense=-axis.sense) for letter, axis in known.items()}
        text = " and ".join(f"sense = {axis.sense} of axis {x}" for x, axis in axes.items())
        yield "axes", {**setup.axes, **axes}, f"with {text}"
    for preset in presets():
        if preset != setup.machine.name:
            yield "machine", Machine(preset), f'with preset = "{preset}"'
    for part, name in LENGTHS:
        given = getattr(getattr(setup, part), name)
        near = () if given is None else (2 * given, given / 2, *(given + step for step in ROUND_MM))
        for value in dict.fromkeys(near):
            with suppress(TrunnionError):  # no length, or none of this artefact
                other = replace(getattr(setup, part), **{name: value})
                yield part, other, f"with {part}.{name} = {value:g} (not {given:g})"


def _as_planned(result: IdentificationResult, setup: Setup) -> bool:
    """Whether all that touches show is less than the step of a command: of no machine that probed.

    Errors that the set-up states are in the plan, too.
    """
    if result.placement is None or setup.machine.errors:
        return False
    step = {"µm": setup.resolution.linear_um, "arcsec": setup.resolution.rotary_arcsec}
    return result.rms_um < step["µm"] and all(
        abs(value) < step[unit_of(name)]
        for name, value in {**result.errors, **result.placement}.items()
    )


def _scatter_um(data: Touches, setup: Setup) -> float:
    """Scatter of a reading about the plain model; infinite where that does not fit at all."""
    try:
        model = TouchModel(setup)
        fit = model.core.fit(
            model.moves(data),
            model.values(),
            huber=None,
            sigma_um=0.0,
            priors=[],
            max_steps=MAX_STEPS,
        )
    except TrunnionError:
        return np.inf
    usable = fit["converged"] and fit["degrees_of_freedom"] >= MIN_FREEDOM
    return fit["sigma_um"] if usable else np.inf


def _some(data: Touches) -> Touches:
    """Take some of many touches: enough to recognise a mistake."""
    if len(data) <= MAX_ROWS:
        return data
    return data[np.sort(np.random.default_rng(0).permutation(len(data))[:MAX_ROWS])]
