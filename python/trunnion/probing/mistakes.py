"""Common mistakes of a measurement, recognised by what they do to its estimates.

A sentence names the likely cause; no number is changed. Other set-ups and units are tried only
where the residuals are no touch probe's, or where the touches are off the modelled surface.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from trunnion._core import Moves
from trunnion.base.errors import DataError
from trunnion.base.units import Floats
from trunnion.data.meant import some_rows
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.machine.sizes import (
    LARGE_ARCSEC,
    LARGE_UM,
    SURE_SIGMAS,
    TINY_UM,
    in_other_units,
    length_doubts,
)
from trunnion.probing.guesses import TOOL_ENDS, likely_cause, scatter_um
from trunnion.probing.model import TouchModel, ticks_um
from trunnion.probing.place_mistakes import beside
from trunnion.probing.result import NO_PROBE_UM, IdentificationResult
from trunnion.probing.tick_mistakes import tick_mistakes
from trunnion.setup import Setup

TIP_SHARE = 0.1
"""Of the ball's radius: how near an estimate has to come; errors of machines are smaller."""

MIN_UM = 200.0
"""Below this an estimate is an ordinary error of a machine."""

PLANNED_UM = 0.1
"""From where a touch was planned: less than a probe's noise, as four decimals of a mm round it."""

PLANNED = (
    "Every touch lies where the set-up expects it, the placement of the artefact included: is this "
    "the plan, not what was measured?"
)


def likely_mistakes(
    result: IdentificationResult,
    data: Touches,
    model: TouchModel,
    moves: Moves,
    beside: Floats | None = None,
) -> tuple[str, ...]:
    """Name what is likely wrong with a measurement that gives this result.

    model: Of the set-up, without effects. moves: The touches, as it knows them. beside: How causes
    that are known of change the touches, (n, k).
    """
    setup, said = model.setup, []
    beside = np.empty((len(data), 0)) if beside is None else beside
    near = model.values(result.errors, result.placement)
    by_sight = seen_at_once(data, model, moves)
    of_ticks = [] if PLANNED in by_sight else tick_mistakes(data, model, moves, near, beside)
    if of_ticks and np.any(ticks_um(setup, data)):  # half of a wrong one is in all the rest
        return (*by_sight, *of_ticks)
    if result.rms_um > NO_PROBE_UM:
        some = some_rows(data)
        before = min(scatter_um(some, setup), result.rms_um)
        if before > NO_PROBE_UM and (cause := likely_cause(some, setup, before)):
            said.append(f"Residuals of {before:.4g} µm have a likely cause: {cause}")
    # Where the placement is not estimated, it is in the errors.
    if result.placement is not None and not said:
        said += [*_by_size(result, setup), *_higher_or_longer(result, setup)]
    return (*said, *by_sight, *of_ticks)


def seen_at_once(data: Touches, model: TouchModel, moves: Moves) -> tuple[str, ...]:
    """Name what shows without any estimate: a plan, lengths and errors of other units, columns."""
    doubt = in_other_units(model.setup.machine.errors)
    return (
        *((PLANNED,) if _as_planned(data, model, moves) else ()),
        *length_doubts(model.setup),
        *beside(data),
        *((f"[machine.errors] has {doubt}",) if doubt else ()),
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
        if not len(data):
            raise
        data = some_rows(data)
        cause = likely_cause(data, setup, scatter_um(data, setup)) or " ".join(length_doubts(setup))
        if not cause:
            raise
        raise DataError(f"{error}. Likely cause: {cause}") from None


def _by_size(result: IdentificationResult, setup: Setup) -> list[str]:
    """Name location errors that no machine has."""
    radius = setup.probe.ball_radius_mm * 1e3
    said = []
    sure = {
        name: value
        for name, value in result.errors.items()
        if name[1] in "XYZ" and _is_sure(result, name, value)
    }
    for name, value in sure.items():
        height = value - setup.machine.errors.get(name, 0.0)
        near = abs(abs(height) - radius) <= TIP_SHARE * radius
        if name.startswith("EZ0") and near and abs(height) >= MIN_UM:
            where = next(end for end, sign in TOOL_ENDS.items() if sign * height > 0)
            said.append(
                f"{name} is {height:+.0f} µm, about the radius of the ball ({radius:.0f} µm): was "
                f"the tool's length measured {where}? It is expected to the centre."
            )
        elif abs(height) > LARGE_UM:
            tool = ", and the tool's length" if name.startswith("EZ0") else ""
            said.append(
                f"{name} is {height:+.0f} µm from the set-up, more than 1 mm: are the places of "
                f"the axes and of the artefact there (point_mm, place_mm){tool} right, and in mm?"
            )
    said += _turned(result, setup)
    largest = max(sure, key=lambda name: abs(sure[name]), default=None)
    if largest is not None and TINY_UM[0] < abs(sure[largest]) < TINY_UM[1]:
        said.append(
            f"The largest position error is {largest} = {sure[largest]:.2g} µm: if the data are "
            "simulated, were the errors given in mm? They are expected in µm."
        )
    return said


def _is_sure(result: IdentificationResult, name: str, value: float) -> bool:
    """Whether an error is so much that its standard error leaves no doubt of it."""
    return abs(value) > SURE_SIGMAS * result.std_errors.get(name, np.inf)


def _turned(result: IdentificationResult, setup: Setup) -> list[str]:
    """Name angular errors that no machine has whose axes are at their zeros."""
    said = []
    for name, value in result.errors.items():
        turn, axis = value - setup.machine.errors.get(name, 0.0), name[1]
        if axis in "ABC" and abs(turn) > LARGE_ARCSEC and _is_sure(result, name, turn):
            shift = f"a work offset that shifts {axis}, " if name[3] == axis else ""
            said.append(
                f"{name} is {turn:+.0f} arcsec from the set-up, more than "
                f"{LARGE_ARCSEC / 3600:g}°: {shift}homing, or another direction of the axis?"
            )
    return said


def _higher_or_longer(result: IdentificationResult, setup: Setup) -> list[str]:
    """Say where a ball's radius in Z may be the tool's length or the place of the artefact."""
    last = offsets_along_z(setup)
    identified = "table" in last and np.isfinite(result.std_errors.get(last["table"], np.inf))
    if identified or result.placement is None or "dz_um" not in result.placement:
        return []
    off = {n: result.errors[n] - setup.machine.errors.get(n, 0.0) for n in last.values()}
    # A head that is higher than the set-up says is as work that is lower.
    parts = (off[name] if side == "table" else -off[name] for side, name in last.items())
    height = result.placement["dz_um"] + sum(parts)
    radius = setup.probe.ball_radius_mm * 1e3
    if abs(abs(height) - radius) > TIP_SHARE * radius or abs(height) < MIN_UM:
        return []
    end = next(end for end, sign in TOOL_ENDS.items() if sign * height > 0)
    where = "below" if height < 0 else "above"
    return [
        f"The artefact is found {abs(height):.0f} µm {where} its place in the set-up, about the "
        f"radius of the ball ({radius:.0f} µm): it stands there, or the tool's length was measured "
        f"{end} (expected: to the centre). These touches do not say which: either is in "
        f"{' and '.join([*last.values(), 'dz_um'])}."
    ]


def offsets_along_z(setup: Setup) -> dict[str, str]:
    """Return the Z offset of the table's last axis and of the head's, by side.

    Those nearest to the work and to the tool; none of a side whose axes have none.
    """
    chain = Chain(setup)
    offsets = ((chain.sides[letter], f"EZ0{letter}") for letter in chain.letters)
    return {side: name for side, name in offsets if name in chain.location_errors}


def _as_planned(data: Touches, model: TouchModel, moves: Moves) -> bool:
    """Whether every touch is exactly where it was planned: no machine does that.

    However coarse its commands are: errors may be smaller than a step of them. Half a tick, which
    is taken off a touch that a control has made, is in no plan.
    """
    off = np.asarray(model.core.residuals(moves, model.values()))
    return bool(np.all(np.abs(off + ticks_um(model.setup, data) / 2) < PLANNED_UM))
