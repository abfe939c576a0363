"""What may have been meant by touches that do not fit their set-up: tried, and named if it fits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from trunnion.base.errors import TrunnionError
from trunnion.base.units import Floats
from trunnion.data.mistaken import FACTORS_MM, factors, listed, of_number
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.machine.sizes import LARGE_UM, SIZES_OF, length_doubts
from trunnion.probing.model import TouchModel, rounding_um
from trunnion.probing.place_mistakes import other_centre_mm, other_place_mm
from trunnion.setup import AxisSetup, Machine, Setup
from trunnion.setup.artefact import DIMENSIONS
from trunnion.setup.machines import presets

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

SINGLE_LENGTHS = (
    *LENGTHS,
    ("artefact", "height_mm"),
    ("artefact", "outer_diameter_mm"),
    ("artefact", "centre_mm"),
    ("artefact", "place_mm"),
)
"""Lengths of which one alone is easily in another unit."""


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


def likely_cause(data: Touches, setup: Setup, before_um: float) -> str | None:
    """Say with what other set-up or unit the touches fit; None: with none that is tried."""
    tried = [(scatter_um(guess.data, guess.setup), guess) for guess in _guesses(data, setup)]
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


def scatter_um(data: Touches, setup: Setup) -> float:
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
    yield from _other_lengths(data, setup)
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
    for one, other in combinations("xyz", 2):
        both = {
            name.format(axis): data[name.format(its)]
            for name in ("{}_mm", "dir_{}")
            for axis, its in ((one, other), (other, one))
        }
        axes = f"{one.upper()} and {other.upper()}"
        yield Guess(
            f"if {axes} are exchanged, places and directions", data.with_columns(**both), setup
        )
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


def _other_lengths(data: Touches, setup: Setup) -> Iterator[Guess]:
    """Yield a set-up with lengths in another unit: of a table or two, each by itself, of axes."""
    tables = (("artefact",), ("artefact", "probe"), ("probe",))
    tried = [tuple(one for part in parts for one in _lengths(setup, part)) for parts in tables]
    tried += [(one,) for one in SINGLE_LENGTHS if np.any(getattr(getattr(setup, one[0]), one[1]))]
    points = {x: axis for x, axis in setup.axes.items() if axis.point_mm}
    for what, factor in FACTORS_MM.items():
        for some in filter(None, dict.fromkeys(tried)):
            with suppress(TrunnionError):  # too large or too small for an artefact
                yield Guess(f"if {_called(some, setup, what)}", data, _times(setup, some, factor))
        with suppress(TrunnionError):
            axes = {
                x: replace(axis, point_mm=_scaled(axis.point_mm, factor))
                for x, axis in points.items()
            }
            if axes:
                text = f"if the places of the axes (point_mm) {what}"
                yield Guess(text, data, replace(setup, axes={**setup.axes, **axes}))


def _lengths(setup: Setup, part: str) -> list[tuple[str, str]]:
    """Return the lengths that a table of a set-up states; those by default are in mm already."""
    table = getattr(setup, part)
    return [
        (part, name)
        for name, declared in table.own_keys().items()
        if name.endswith("_mm") and getattr(table, name) != declared.default
    ]


def _times(setup: Setup, lengths: Sequence[tuple[str, str]], factor: float) -> Setup:
    """Return a set-up with some lengths, each a table and a key, times a factor."""
    changed: dict[str, dict[str, Any]] = {}
    for part, name in lengths:
        value = getattr(getattr(setup, part), name)
        changed.setdefault(part, {})[name] = _scaled(value, factor)
    parts: dict[str, Any] = {p: replace(getattr(setup, p), **own) for p, own in changed.items()}
    return replace(setup, **parts)


def _called(lengths: Sequence[tuple[str, str]], setup: Setup, what: str) -> str:
    """Say what lengths may be, by name where others of their tables that say a size are not."""
    parts = dict.fromkeys(part for part, _ in lengths)
    own = {"artefact": DIMENSIONS[setup.artefact.kind], "probe": ("ball_radius_mm",)}
    sizes = {(part, n) for part in parts for n in own[part] if n in (*SIZES_OF, "ball_radius_mm")}
    if len(lengths) == 1 or not sizes <= {*lengths}:
        names = [f"{part}.{name}" for part, name in lengths]
        return f"{listed(names)} {of_number(what, len(names))}"
    return f"the lengths in {listed(f'[{part}]' for part in parts)} {what}"


def _scaled(length: Any, factor: float) -> Any:
    """Return a length, or a tuple of lengths, times a factor."""
    if isinstance(length, tuple):
        return tuple(_scaled(each, factor) for each in length)
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
