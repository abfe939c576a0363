"""Effects on ball-bar lengths of a three-axis machine, and those that any machine has.

Every effect is a displacement δ of the tool point, or of a part of the bar, and enters with the
bar's direction n: reading += n·δ. Formulas are in the package's docstring.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from trunnion.base.units import ARCSEC, Floats, Integers
from trunnion.diagnosis.effect import (
    Effect,
    Parameter,
    drift,
    from_then_on,
    gridded,
    linear,
    periodic,
)
from trunnion.machine.effects import Motion, Owner
from trunnion.machine.linear_axes import CURVATURE, LinearMotion, arc
from trunnion.models.ballbar.path import AXES, Path

CATALOGUED = (
    *(f"scale_{a}" for a in AXES),
    *(f"backlash_{a}" for a in AXES),
    "squareness_xy",
    "squareness_xz",
    "squareness_yz",
)
"""Ids that are in the catalogue of the machine, too."""
BAR_LENGTH, SHIFT, BACKLASH_SLOPE = "ballbar_length", "setup_shift", "backlash_slope_"
OF_POSITIONING = (
    "a positioning error of the {0} axis that is bent by as much (E{0}{0}). A positioning run of "
    "{0} says which it is"
)
"""What circles in one plane show as an arc of the other guide: x² and y² add up to a constant."""
OF_LATERAL_PLAY = (
    "a lateral play of the {0} axis in {1} that grows along {0} by as much, and hardly from a "
    "backlash of the {1} axis that grows along {1} in a curve"
)
"""What circles in one plane show as a backlash of an axis that grows along another one: n is along
the bar, so that n_x·y and n_y·x are the same."""
MIN_REACH = 1e-3
"""Share of the bar along an axis, from which it shows the centre there."""
MIN_PITCH_MM = 4.0
MAX_MOMENTS = 48
BESIDE_SLIP = 32  # one of so many readings is before a slip, and one after it
DECAY_RATIO = 1.6  # of neighbours on the grid of decays
LONGEST_DECAY = 0.6  # of the time between two reversals
CLOSE = 3  # readings after a reversal whose spacing is looked at
TIME_CONSTANTS = 12


@dataclass(frozen=True, eq=False)
class Bar:
    """The bar in each reading: unit direction (n, 3), and the ball's centre (n, 3)."""

    direction: Floats
    centre_mm: Floats


def three_axis(path: Path, bar: Bar) -> list[Effect]:
    """Effects of a machine whose linear axes go where they are commanded."""
    moving = path.moving
    out = [_scale(path, bar, a) for a in moving]
    for i, j, g in ((0, 1, -1.0), (0, 2, 1.0), (1, 2, -1.0)):
        if i in moving and j in moving:
            # From the centre: the constant part is the centre's anyway, and columns stay small.
            place = (path.tips - bar.centre_mm)[:, j]
            name = f"squareness_{AXES[i]}{AXES[j]}"
            column = g * bar.direction[:, i] * place * 1e3 * ARCSEC
            label = f"squareness of {AXES[j].upper()} to {AXES[i].upper()}"
            out.append(linear(name, ["arcsec"], column, label))
    out += [_straightness(path, bar, i, a) for a, i in permutations(moving, 2)]
    for a in moving:
        out += _reversal(path, bar, a)
    out += _gain_mismatch(path, bar)
    for a in moving:
        out += cyclic(
            f"cyclic_{AXES[a]}",
            [(path.tips[:, a], bar.direction[:, a])],
            f"cyclic error of the {AXES[a].upper()} axis",
            LinearMotion(f"cyclic_{AXES[a]}", path.used),
        )
    return out


def drifts(path: Path, bar: Bar) -> list[Effect]:
    """Effects of the tool drifting from the ball."""
    hours = path.hours
    if hours is None or np.ptp(hours) == 0:
        return []
    return [
        drift(
            f"drift_{AXES[a]}",
            "rate_um_h",
            hours,
            bar.direction[:, a],
            f"drift of the tool along {AXES[a].upper()}",
            owner=Owner.TIME,
            needs=("time_s",),
        )
        for a in path.moving
    ]


def between_readings(when: Floats) -> Floats:
    """Moments between readings, in order."""
    moments = np.unique(when)
    return np.asarray((moments[1:] + moments[:-1]) / 2)


def setup_shift(
    when: Floats, name: str, group: Integers, bar: Bar, axes: Sequence[int]
) -> list[Effect]:
    """Make the effect of a ball that slips in its cup, or with it, at a moment: its centre moves.

    ``when``: times or row numbers, called ``name``; ``group``: number of the set-up; both (n,).
    ``axes``: along which the bar shows it.
    """
    between = between_readings(when)
    if len(between) < 2:
        return []
    # a few readings at an end that are off are bad ones: they do not say where the ball was
    few = len(between) // BESIDE_SLIP
    ends = float(between[few]), float(between[-1 - few])
    every = map(float, between[:: max(1, len(between) // MAX_MOMENTS)])
    grid = tuple(t for t in every if ends[0] <= t <= ends[1])
    shape = Slip(name, when, group, -bar.direction[:, list(axes)])
    return [
        gridded(
            SHIFT,
            [*(f"d{AXES[a]}_um" for a in axes), Parameter(name, grid=grid, bounds=ends)],
            shape.columns,
            "slip of the ball on the table",
            slopes=shape.slopes,
            owner=Owner.PLACEMENT,
        )
    ]


@dataclass(frozen=True, eq=False)
class Slip:
    """``enters`` (n, k) in all later readings of the set-up; the moment lies between readings."""

    name: str
    when: Floats
    group: Integers
    enters: Floats

    def columns(self, values: Mapping[str, float]) -> Floats:
        """Shape (n, k); along an axis that the bar does not reach afterwards nothing is shown.

        What is left of it there is the fitted centre's part, however small: sizes of it would be
        metres, and not "not identifiable".
        """
        after = from_then_on(values[self.name], self.when, self.group)
        shown = self.enters * after[:, None]
        return np.where(np.abs(shown).max(axis=0) > MIN_REACH, shown, 0.0)

    def slopes(self, _: Mapping[str, float]) -> Floats:
        """No derivative by the moment, shape (n, 1)."""
        return np.zeros((len(self.when), 1))


def ballbar_length(count: int, looks_like: str = "") -> Effect:
    """Make the effect of a bar that reads longer than it is."""
    label, ones = "length of the ball-bar", np.ones(count)
    more = {"owner": Owner.INSTRUMENT, "looks_like": looks_like}
    return linear(BAR_LENGTH, ["dl_um"], ones, label, **more)


def _scale(path: Path, bar: Bar, axis: int) -> Effect:
    place = (path.tips - bar.centre_mm)[:, axis]
    column = bar.direction[:, axis] * place * 1e-3
    return linear(f"scale_{AXES[axis]}", ["ppm"], column, f"scale of the {AXES[axis].upper()} axis")


def _straightness(path: Path, bar: Bar, into: int, along: int) -> Effect:
    """A guide bent to an arc: the only shape of it that a circle shows as that axis' own.

    An S is on a circle an S of the other axis, but for their squareness. The parameter is the
    curvature, which is the same to a bar of any length; of points it is the size of two shapes over
    the travel that they use, so that these kinds do not share it.
    """
    name = f"straightness_{AXES[into]}_of_{AXES[along]}"
    moved = arc(into, along, path.tips, path.used)[:, into, 0]
    first, second = AXES[along].upper(), AXES[into].upper()
    return linear(
        name,
        [CURVATURE],
        bar.direction[:, into] * moved,
        f"straightness of the {first} axis in {second}",
        motion=LinearMotion(name, path.used),
        looks_like=OF_POSITIONING.format(second) if len(path.moving) == 2 else "",
    )


def _reversal(path: Path, bar: Bar, axis: int) -> list[Effect]:
    """Backlash, how it grows, lateral play and reversal spike of an axis that travels both ways."""
    sign = path.both_ways(axis)
    if sign is None:
        return []
    letter = AXES[axis].upper()
    behind = -0.5 * sign[:, None] * bar.direction
    play = {f"backlash_{AXES[axis]}": (axis, f"backlash of the {letter} axis")} | {
        f"lateral_play_{AXES[a]}_of_{AXES[axis]}": (
            a,
            f"lateral play of the {letter} axis in {AXES[a].upper()}",
        )
        for a in path.moving
        if a != axis
    }
    out = [linear(name, ["b_um"], behind[:, a], label) for name, (a, label) in play.items()]
    out += _backlash_slopes(path, behind[:, axis], axis)
    return out + _spike(path, bar, axis, sign)


def _backlash_slopes(path: Path, behind: Floats, axis: int) -> list[Effect]:
    """What a backlash has more than in the middle of the travel, along its axis and across.

    Without times none: a ball-bar that warms up looks so. behind: What a backlash of 1 µm makes.
    """
    out: list[Effect] = []
    if path.hours is None or np.ptp(path.hours) == 0:
        return out
    for along in sorted(path.moving, key=lambda a: a != axis):
        name, of, over = f"{BACKLASH_SLOPE}{AXES[axis]}", AXES[axis].upper(), AXES[along].upper()
        label, looks_like = f"backlash of the {of} axis that grows along {over}", ""
        if along != axis:
            name += f"_along_{AXES[along]}"
            looks_like = OF_LATERAL_PLAY.format(of, over) if len(path.moving) == 2 else ""
        further = 1e-3 * (path.tips[:, along] - path.used.middle_mm[along])
        more = {"looks_like": looks_like, "needs": ("time_s",)}
        out.append(linear(name, ["rate_um_m"], behind * further, label, **more))
    return out


def _spike(path: Path, bar: Bar, axis: int, sign: Floats) -> list[Effect]:
    """An axis that sticks where it turns back; at the start of a circle as much as it came to."""
    since, started = path.since_reversal(axis, sign), path.since_start(sign)
    if not np.isfinite(since).any():
        return []
    speed, names = path.speed_mm_s, ["a_um"]
    name, per_mm = ("decay_mm", np.ones(len(sign))) if speed is None else ("decay_ms", 1e3 / speed)
    past = [since * per_mm]
    inside = past[0][np.isfinite(since) & (since > 0)]
    if not len(inside):
        return []
    if np.isfinite(started).any():
        names.append("start_um")
        past.append(np.where(np.isfinite(since), np.inf, started * per_mm))
    shortest, longest = _spacing(past[0], inside), LONGEST_DECAY * float(np.max(inside))
    count = 2 + int(np.log(max(longest / shortest, 1.0)) / np.log(DECAY_RATIO))
    grid = tuple(map(float, np.geomspace(shortest, max(longest, 2 * shortest), count)))
    shape = Decay(name, tuple(names), np.stack(past, axis=1), -sign * bar.direction[:, axis])
    return [
        gridded(
            f"reversal_spike_{AXES[axis]}",
            [*names, Parameter(name, grid=grid, bounds=(shortest / 2, 5 * grid[-1]))],
            shape.columns,
            f"reversal spike of the {AXES[axis].upper()} axis",
            slopes=shape.slopes,
        )
    ]


def _spacing(past: Floats, inside: Floats) -> float:
    """How closely readings follow a reversal: of a decay much shorter one reading shows anything.

    Of the reversal of which they are closest: a slow circle shows shorter decays than a fast one.
    past: Since the last reversal (n,), of which ``inside`` are later than it.
    """
    known = np.where(np.isfinite(past), past, np.max(inside))
    each = np.split(known, np.flatnonzero(np.diff(known) < 0) + 1)
    steps = [float(np.ptp(one[:CLOSE])) / (CLOSE - 1) for one in each if len(one) >= CLOSE]
    return min((step for step in steps if step > 0), default=float(np.min(inside)))


@dataclass(frozen=True, eq=False)
class Decay:
    """Size · ``enters`` (n,) · exp(-past/decay), a sum over sizes; nothing where it is infinite.

    name: Of the decay. sizes: Names of these (k,). past: Since each began (n, k).
    """

    name: str
    sizes: tuple[str, ...]
    past: Floats
    enters: Floats

    def columns(self, values: Mapping[str, float]) -> Floats:
        """Shape (n, k)."""
        exponent = np.minimum(self.past / values[self.name], 700.0)
        left = np.where(np.isfinite(self.past), np.exp(-exponent), 0.0)
        return np.asarray(self.enters[:, None] * left)

    def slopes(self, values: Mapping[str, float]) -> Floats:
        """Shape (n, 1)."""
        finite = np.where(np.isfinite(self.past), self.past, 0.0)
        sizes = np.array([values[size] for size in self.sizes])
        slope = self.columns(values) * finite / values[self.name] ** 2
        return np.asarray((slope @ sizes)[:, None])


def _gain_mismatch(path: Path, bar: Bar) -> list[Effect]:
    if len(path.moving) < 2:
        return []
    speed = path.speed_mm_s
    unit = "um" if speed is None else "ms"
    # A distance in µm per unit of the path; a velocity in mm/s makes µm of ms.
    size = np.ones(len(path.tips)) if speed is None else speed
    first, *others = path.moving
    names = [f"{AXES[a]}_{AXES[first]}_{unit}" for a in others]
    columns = [-path.tangent[:, a] * size * bar.direction[:, a] for a in others]
    label = "mismatch of the axes' gains"
    return [linear("gain_mismatch", names, np.column_stack(columns), label)]


def cyclic(
    name: str,
    parts: Sequence[tuple[Floats, Floats]],
    label: str,
    motion: Motion | None = None,
) -> list[Effect]:
    """Make a periodic error of positions (mm) that enter the readings with weights, summed."""
    travel = max(float(np.ptp(place)) for place, _ in parts)
    # Readings lie unevenly along an axis, so pitches below two of their gaps can be found.
    shortest = max(MIN_PITCH_MM, travel / 100)
    longest = travel / 2
    if longest <= shortest:
        return []
    waves = np.arange(1 / longest, 1 / shortest, 1 / (2 * travel))
    bounds = (0.9 / waves[-1], 1.1 / waves[0])
    pitch = Parameter("pitch_mm", grid=tuple(map(float, 1 / waves)), bounds=bounds)
    return [periodic(name, pitch, parts, label, motion=motion)]


def expansion(name: str, hours: Floats | None, grows: Floats, label: str) -> Effect:
    """Make a part grow by ppm, over time with a time constant; ``grows``: µm per ppm, (n,)."""
    if hours is None or np.ptp(hours) == 0:
        return linear(name, ["ppm"], grows, label)
    minutes = hours * 60.0
    length = float(np.ptp(minutes))
    grid = tuple(map(float, np.geomspace(length / 40, 4 * length, TIME_CONSTANTS)))
    tau = Parameter("tau_min", grid=grid, bounds=(length / 200, 20 * length))
    shape = Growth(minutes, grows)
    return gridded(name, ["ppm", tau], shape.columns, label, slopes=shape.slopes)


@dataclass(frozen=True, eq=False)
class Growth:
    """``grows`` · (1 - exp(-t/tau))."""

    minutes: Floats
    grows: Floats

    def columns(self, values: Mapping[str, float]) -> Floats:
        """Shape (n, 1)."""
        return np.asarray((-self.grows * np.expm1(-self.minutes / values["tau_min"]))[:, None])

    def slopes(self, values: Mapping[str, float]) -> Floats:
        """Shape (n, 1)."""
        tau = values["tau_min"]
        left = np.exp(-self.minutes / tau) * self.minutes / tau**2
        return np.asarray((-values["ppm"] * self.grows * left)[:, None])
