"""Common mistakes of a measurement, recognised by what they do to its estimates.

A sentence names the likely cause; no number is changed. Other set-ups and units are tried only
where the residuals are no touch probe's, or where the touches are off the modelled surface.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from trunnion._core import Moves
from trunnion.base.errors import DataError, TrunnionError
from trunnion.base.units import Floats
from trunnion.data.meant import some_rows
from trunnion.data.mistaken import FACTORS_MM, factors, of_number
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
from trunnion.probing.model import (
    TouchModel,
    rounding_um,
    ticks_um,
)
from trunnion.probing.place_mistakes import beside, other_centre_mm, other_place_mm
from trunnion.probing.result import NO_PROBE_UM, IdentificationResult
from trunnion.probing.tick_mistakes import tick_mistakes
from trunnion.setup import Artefact, AxisSetup, Machine, Probe, Setup
from trunnion.setup.machines import presets

TIP_SHARE = 0.1
"""Of the ball's radius: how near an estimate has to come; errors of machines are smaller."""

MIN_UM = 200.0
"""Below this an estimate is an ordinary error of a machine."""

SHARE = 0.1
"""Of the residuals: what a guess has to leave at most, beside the errors of rounding."""

BETTER = 0.5
"""Of the residuals: the same with the errors of rounding."""

MAX_BEFORE_UM = 500.0
"""Residuals beyond this, and touches off the surface, count as this."""

RIVAL_FACTOR = 2.0
"""Guesses that leave up to so many times the residuals of the best are named beside it."""

ALONG = 0.9
"""Cosine of the angle between an approach and the spindle within which it is along it."""

MIN_ALONG = 3
MAX_LONGER_MM = 500.0
"""How far from the surface the contact of such an approach is looked for."""

MIN_FREEDOM = 5
MAX_STEPS = 50

PLANNED_UM = 0.1
"""From where a touch was planned: less than a probe's noise, as four decimals of a mm round it."""

TOOL_ENDS = {"to the tip of the ball": -1.0, "beyond the centre of the ball": 1.0}
"""Where else a tool's length may end; how much higher a touch is recorded then, in radii."""

ROUND_MM = tuple(sign * size for sign in (1, -1) for size in (0.5, 1.0, 2.0, 5.0, 10.0))
"""By how much a length is easily wrong."""

LENGTHS = (
    ("probe", "ball_radius_mm"),
    ("artefact", "length_mm"),
    ("artefact", "width_mm"),
    ("artefact", "diameter_mm"),
)
"""Lengths that residuals show; an artefact's height looks like its placement up to some mm."""


@dataclass(frozen=True)
class Guess:
    """What may have been meant.

    text: How it reads.
    unit_mm: What positions were recorded in, for scatters to be compared in it.
    """

    text: str
    data: Touches
    setup: Setup
    unit_mm: float = 1.0


def likely_mistakes(
    result: IdentificationResult, data: Touches, model: TouchModel, moves: Moves
) -> tuple[str, ...]:
    """Name what is likely wrong with a measurement that gives this result.

    model: Of the set-up, without effects. moves: The touches, as it knows them.
    """
    setup, said = model.setup, []
    near = model.values(result.errors, result.placement)
    planned = result.placement is not None and _as_planned(data, model, moves)
    of_ticks = [] if planned else tick_mistakes(data, model, moves, near)
    by_sight = [*length_doubts(setup), *beside(data)]
    if of_ticks and np.any(ticks_um(setup, data)):  # half of a wrong one is in all the rest
        return (*by_sight, *of_ticks)
    if result.rms_um > NO_PROBE_UM:
        some = some_rows(data)
        before = min(_scatter_um(some, setup), result.rms_um)
        if before > NO_PROBE_UM and (cause := _cause(some, setup, before)):
            said.append(f"Residuals of {before:.4g} µm have a likely cause: {cause}")
    # Where the placement is not estimated, it is in the errors.
    if result.placement is not None and not said:
        said += [*_by_size(result, setup), *_higher_or_longer(result, setup)]
    if planned:
        said.append(
            "Every touch lies where the set-up expects it, the placement of the artefact included: "
            "is this the plan, not what was measured?"
        )
    said += by_sight
    if doubt := in_other_units(setup.machine.errors):
        said.append(f"[machine.errors] has {doubt}")
    return (*said, *of_ticks)


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
        cause = _cause(data, setup, _scatter_um(data, setup)) or " ".join(length_doubts(setup))
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


def _cause(data: Touches, setup: Setup, before_um: float) -> str | None:
    """Say with what other set-up or unit the touches fit; None: with none that is tried."""
    tried = [(_scatter_um(guess.data, guess.setup), guess) for guess in _guesses(data, setup)]
    rounding = rounding_um(setup, data)
    limit = SHARE * min(before_um, MAX_BEFORE_UM)
    most = BETTER * min(before_um, MAX_BEFORE_UM)  # however coarse the stated ticks are
    fitting = [
        (s, g) for s, g in tried if s <= most and np.sqrt(max(s**2 - rounding**2, 0.0)) <= limit
    ]
    if not fitting:
        return None
    # In inches all fits as in mm: what no artefact and no ball is as small as says which is meant.
    fitting = [(s, g) for s, g in fitting if not length_doubts(g.setup)] or fitting
    best = min(scatter / guess.unit_mm for scatter, guess in fitting)
    near = [(s, g) for s, g in fitting if s / g.unit_mm <= RIVAL_FACTOR * best]
    left = min(scatter for scatter, _ in near)
    return f"the touches fit to {left:.2g} µm {', or '.join(guess.text for _, guess in near)}."


def _guesses(data: Touches, setup: Setup) -> Iterator[Guess]:
    """Yield what may have been meant."""
    for what, factor in FACTORS_MM.items():
        with suppress(TrunnionError):  # too far for positions
            meant = _at(data, data.position_mm * factor)
            yield Guess(f"if their positions {what}", meant, setup, factor)
    for names, unit in ((("x_mm", "y_mm", "z_mm"), "mm"), (tuple(data.set_positions), "deg")):
        yield from _other_units(data, setup, names, unit)
    yield from _other_columns(data, setup)
    if long := _longer_mm(data, setup):
        text = (
            f"if the tool is {abs(long):.4g} mm {'longer' if long > 0 else 'shorter'} than the "
            "control took it for (was G43 off, or the length of another tool on?), or the artefact "
            f"stands as much {'higher' if long > 0 else 'lower'} (place_mm)"
        )
        yield Guess(text, _at(data, data.position_mm - long * _spindle(data, setup)), setup)
    if "head" in Chain(setup).sides.values() and _of_machine(data, setup):
        # Else it is a location error, named by its size.
        along = setup.probe.ball_radius_mm * _spindle(data, setup)
        for end, sign in TOOL_ENDS.items():
            meant = _at(data, data.position_mm - sign * along)
            text = f"if the tool's length was measured {end} (not to its centre)"
            yield Guess(text, meant, setup)
    for what, factor in FACTORS_MM.items():
        for parts in ("artefact",), ("artefact", "probe"), ("probe",):
            tables = " and ".join(f"[{part}]" for part in parts)
            with suppress(TrunnionError):  # too large or too small for an artefact
                scaled: dict[str, Any] = {
                    part: _in_mm(getattr(setup, part), factor) for part in parts
                }
                yield Guess(f"if the lengths in {tables} {what}", data, replace(setup, **scaled))
        if any(axis.point_mm for axis in setup.axes.values()):
            with suppress(TrunnionError):
                axes = {
                    x: replace(axis, point_mm=_times(axis.point_mm, factor))
                    if axis.point_mm
                    else axis
                    for x, axis in setup.axes.items()
                }
                placed = replace(setup, axes=axes)
                yield Guess(f"if the places of the axes (point_mm) {what}", data, placed)
    for part, changes, text in _changes(data, setup):
        with suppress(TrunnionError):  # not a set-up: other axes, a cross without arms
            yield Guess(text, data, replace(setup, **{part: changes}))


def _other_units(data: Touches, setup: Setup, names: Sequence[str], unit: str) -> Iterator[Guess]:
    """Yield single columns in another unit, and the angles together."""
    together = [tuple(names)] if unit == "deg" and len(names) > 1 else []
    for some in (*together, *((name,) for name in names)):
        for said, factor in factors(unit).items():
            with suppress(TrunnionError):  # too far for positions
                meant = data.with_columns(**{name: factor * data[name] for name in some})
                what = "their angles" if some in together else some[0]
                yield Guess(f"if {what} {of_number(said, len(some))}", meant, setup)


def _other_columns(data: Touches, setup: Setup) -> Iterator[Guess]:
    """Yield columns that may be exchanged, mirrored, or of the contact."""
    pairs = combinations([f"{axis}_mm" for axis in "xyz"], 2)
    ways = combinations([f"dir_{axis}" for axis in "xyz"], 2)
    turned = combinations([f"{letter}_deg" for letter in data.rotary_deg], 2)
    for one, other in (*pairs, *ways, *turned):
        exchanged = data.with_columns(**{one: data[other], other: data[one]})
        yield Guess(f"if {one} and {other} are exchanged", exchanged, setup)
    for axis in "xyz":
        mirrored = data.with_columns(**{f"{axis}_mm": -data[f"{axis}_mm"]})
        yield Guess(f"if {axis}_mm counts the other way", mirrored, setup)
        other_way = data.with_columns(**{f"dir_{axis}": -data[f"dir_{axis}"]})
        yield Guess(f"if dir_{axis} counts the other way", other_way, setup)
    against = {f"dir_{axis}": -data[f"dir_{axis}"] for axis in "xyz"}
    text = "if every direction of approach is reversed (dir is the way that the ball moves)"
    yield Guess(text, data.with_columns(**against), setup)
    radius = setup.probe.ball_radius_mm
    text = (
        f"if the positions are those of the contact, already corrected by the ball's radius of "
        f"{radius:g} mm (expected: the centre of the ball)"
    )
    yield Guess(text, _at(data, data.position_mm - radius * data.direction), setup)


def _of_machine(data: Touches, setup: Setup) -> bool:
    """Whether touches have the rotary axes of a machine, and no others."""
    return {letter.upper() for letter in data.rotary_deg} == set(Chain(setup).letters)


def _at(data: Touches, position_mm: Floats) -> Touches:
    """Return touches at other recorded positions, (n, 3)."""
    x, y, z = position_mm.T
    return data.with_columns(x_mm=x, y_mm=y, z_mm=z)


def _spindle(data: Touches, setup: Setup) -> Floats:
    """Return the direction of the spindle from the tool point, machine frame, (n, 3)."""
    chain = Chain(setup)
    head = {x: turn * (chain.sides[x.upper()] == "head") for x, turn in data.rotary_deg.items()}
    axes = np.column_stack([np.zeros((len(data), 3)), chain.to_machine(head, len(data))])
    return np.asarray(chain.machine({}).forward(axes)[:, 3:])


def _longer_mm(data: Touches, setup: Setup) -> float:
    """By how much touches along the spindle are recorded too far from the work; 0: unknown."""
    if not _of_machine(data, setup):
        return 0.0
    along = np.sum(data.direction * _spindle(data, setup), axis=1) < -ALONG
    if np.count_nonzero(along) < MIN_ALONG:
        return 0.0
    model, ahead = TouchModel(setup), data[np.flatnonzero(along)]
    try:
        way = model.core.simulate(
            model.moves(ahead),
            model.values(),
            from_start=False,
            reach_mm=MAX_LONGER_MM,
            noise_um=0.0,
            seed=0,
            sample=0,
        )
    except TrunnionError:  # some miss the artefact
        return 0.0
    long = float(np.median(way))
    return long if abs(long) > LARGE_UM / 1e3 else 0.0


def _in_mm(part: Artefact | Probe, factor: float) -> Artefact | Probe:
    """Return a part whose lengths are in another unit in mm; those by default are, already."""
    lengths = {
        name: getattr(part, name)
        for name, declared in part.own_keys().items()
        if name.endswith("_mm") and getattr(part, name) != declared.default
    }
    return replace(part, **{name: _times(length, factor) for name, length in lengths.items()})


def _times(length: Any, factor: float) -> Any:
    """Return a length, or a tuple of lengths, times a factor."""
    if isinstance(length, tuple):
        return tuple(_times(each, factor) for each in length)
    return length * factor


def _changes(data: Touches, setup: Setup) -> Iterator[tuple[str, Any, str]]:
    """Yield a part of the set-up, what it may have been meant to be, and how that reads."""
    letters = [letter.upper() for letter in data.rotary_deg]
    for turned in [*letters, *(["".join(letters)] if len(letters) > 1 else [])]:
        known = {letter: setup.axes.get(letter, AxisSetup()) for letter in turned}
        axes = {letter: replace(axis, sense=-axis.sense) for letter, axis in known.items()}
        text = " and ".join(f"sense = {axis.sense} of axis {x}" for x, axis in axes.items())
        yield "axes", {**setup.axes, **axes}, f"with {text}"
    long, wide = setup.artefact.length_mm, setup.artefact.width_mm
    if long is not None and wide is not None:
        with suppress(TrunnionError):  # no artefact of its kind
            other = replace(setup.artefact, length_mm=wide, width_mm=long)
            yield "artefact", other, "with artefact.length_mm and width_mm exchanged"
    if centre := other_centre_mm(data, setup):
        given = setup.artefact.centre_mm
        text = f"with artefact.centre_mm = {_vector(centre)} (not {_vector(given or ())})"
        yield "artefact", replace(setup.artefact, centre_mm=centre), text
    if place := other_place_mm(data, setup):
        text = f"with artefact.place_mm = {_vector(place)} (not {_vector(setup.artefact.place_mm)})"
        yield "artefact", replace(setup.artefact, place_mm=place), text
    for kind in ("cross", "cuboid"):
        if kind != setup.artefact.kind:
            with suppress(TrunnionError):  # it has other dimensions
                yield (
                    "artefact",
                    replace(setup.artefact, kind=kind),
                    f'with artefact.kind = "{kind}"',
                )
    for preset in presets():
        if preset != setup.machine.name:
            yield "machine", Machine(preset), f'with preset = "{preset}"'
    for part, name in (*LENGTHS, ("artefact", "height_mm")):
        given = getattr(getattr(setup, part), name)
        near = () if given is None else (2 * given, given / 2)
        if given is not None and name != "height_mm":
            near = (*near, *(given + step for step in ROUND_MM))
        for value in dict.fromkeys(near):
            with suppress(TrunnionError):  # no length, or none of this artefact
                other = replace(getattr(setup, part), **{name: value})
                yield part, other, f"with {part}.{name} = {value:g} (not {given:g})"


def _vector(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:g}' for value in values)}]"


def _as_planned(data: Touches, model: TouchModel, moves: Moves) -> bool:
    """Whether every touch is exactly where it was planned: no machine does that.

    However coarse its commands are: errors may be smaller than a step of them. Half a tick, which
    is taken off a touch that a control has made, is in no plan.
    """
    off = np.asarray(model.core.residuals(moves, model.values()))
    return bool(np.all(np.abs(off + ticks_um(model.setup, data) / 2) < PLANNED_UM))


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
