"""Effects on points: what the axes of a machine do to features, one entry each in `entries`.

An entry says how its columns follow from the programmed places, so that the same effect can be
bound to any points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations, permutations
from typing import Any, Protocol, TypeAlias

import numpy as np

from trunnion.base.smooth import Modes
from trunnion.base.units import ARCSEC, Floats
from trunnion.data.points import Points
from trunnion.data.times import elapsed_s
from trunnion.diagnosis.effect import (
    ALL_AXES,
    Effect,
    Parameter,
    drift,
    from_then_on,
    gridded,
    linear,
    periodic,
)
from trunnion.diagnosis.jumps import moments_tried
from trunnion.machine.effects import Owner
from trunnion.machine.linear_axes import LinearMotion, Travel, angular, bow
from trunnion.models.breaks import break_of, zero_shift
from trunnion.models.points.geometry import AXES, Places, groups_of, places_of
from trunnion.models.warming import LONGEST, warmup

CATALOGUED = ("scale_x", "scale_y", "scale_z", "squareness_xy", "squareness_xz", "squareness_yz")
"""Ids that are in the catalogue of the machine, too."""
OF_TIME = (
    *(
        f"{what}_{axis}"
        for what in ("drift", "warmup", "screw_warmup", "zero_shift")
        for axis in AXES
    ),
    *("common_drift", "part_warmup", "setup_shift"),
)
COMMON_DEGREE = 6
MIN_REPEATS = 20
STEADY = 6.0  # times the measurement, a time constant by which a part grows steadily

Shape: TypeAlias = Callable[[Points, Places], Floats]
"""Change of the readings per unit of each parameter, shape (n d, k)."""


class Entry(Protocol):
    """An entry of the catalogue."""

    def effect(self, points: Points, places: Places, /) -> Effect | None:
        """Return the effect, bound to points; None if these cannot show it."""
        ...


@dataclass(frozen=True)
class LinearError:
    """An error of the axes as a function of the place, linear in its parameters.

    ``moves``: the linear axes move so wherever they stand (:class:`LinearMotion`).
    """

    id: str
    parameters: tuple[str, ...]
    label: str
    shape: Shape
    owner: Owner = Owner.MACHINE
    moves: bool = False
    looks_like: str = ""

    def effect(self, points: Points, places: Places) -> Effect:
        """Return the effect, bound to points."""
        return linear(
            self.id,
            self.parameters,
            self.shape(points, places),
            self.label,
            owner=self.owner,
            motion=LinearMotion(self.id, places.used) if self.moves else None,
            looks_like=self.looks_like,
        )


@dataclass(frozen=True)
class PeriodicError:
    """A wave along an axis (a screw, a scale), its pitch sought."""

    axis: int

    def effect(self, points: Points, places: Places) -> Effect | None:
        """Return the effect, bound to points; None if the travel is too short for a pitch."""
        grid = places.pitches(self.axis)
        if not grid:
            return None
        pitch = Parameter("pitch_mm", grid=grid, bounds=(grid[-1] * 0.8, grid[0] * 1.25))
        place = np.repeat(points.nominal_mm[:, self.axis], points.dimension)
        enters = _enter(points, self.axis, np.ones(len(points)))
        return periodic(
            f"periodic_{AXES[self.axis]}",
            pitch,
            [(place, enters)],
            f"periodic error of the {AXES[self.axis].upper()} axis",
            motion=LinearMotion(f"periodic_{AXES[self.axis]}", places.used),
        )


@dataclass(frozen=True)
class Drift:
    """An axis drifts from the instrument, in proportion to time or to the order of the points."""

    axis: int

    def effect(self, points: Points, _: Places) -> Effect:
        """Return the effect, bound to points."""
        return drift(
            f"drift_{AXES[self.axis]}",
            "total_um" if points.time_s is None else "rate_um_h",
            np.repeat(_elapsed(points), points.dimension),
            _enter(points, self.axis, np.ones(len(points))),
            f"drift of the {AXES[self.axis].upper()} axis",
            owner=Owner.TIME,
        )


@dataclass(frozen=True)
class WarmUp:
    """Something warms up while points are measured: an axis that moves, its screw, or the part.

    The latter grow from where they are held, which is anywhere: the middle of the points moves,
    too.

    id, label, owner: As of an effect. sizes: Its linear parameters, of what grows ``ppm`` first.
    axes: That move.
    """

    id: str
    sizes: tuple[str, ...]
    label: str
    owner: Owner
    axes: tuple[int, ...]

    def effect(self, points: Points, _: Places) -> Effect | None:
        """Return the effect, bound to points; None without times, or with a break between points.

        Over a break it would be any shift of any axis.
        """
        if points.time_s is None or np.ptp(hours := _elapsed(points)) <= 0:
            return None
        if break_of(points.time_s) is not None:
            return None
        enters = [_enter(points, a, np.ones(len(points))) for a in self.axes]
        longest = LONGEST  # an axis that moves steadily drifts
        if self.sizes[0] == "ppm":
            longest = STEADY
            middle = (points.nominal_mm.min(axis=0) + points.nominal_mm.max(axis=0)) / 2
            arms = 1e-3 * (points.nominal_mm - middle)
            grows = np.sum([_enter(points, a, arms[:, a]) for a in self.axes], axis=0)
            enters.insert(0, grows)
        minutes = np.repeat(60.0 * hours, points.dimension)
        columns = np.stack(enters, axis=1)
        return warmup(
            self.id,
            self.sizes,
            minutes,
            columns,
            self.label,
            longest=longest,
            owner=self.owner,
        )


def warm_ups(dimension: int) -> list[Entry]:
    """Return what warms up, of points in a plane or in space."""
    out: list[Entry] = []
    for i, a in enumerate(AXES[:dimension]):
        axis = f"warm-up of the {a.upper()} axis"
        screw = f"warm-up of the screw of the {a.upper()} axis, which grows"
        out.append(WarmUp(f"warmup_{a}", ("amplitude_um",), axis, Owner.TIME, (i,)))
        out.append(WarmUp(f"screw_warmup_{a}", ("ppm", "amplitude_um"), screw, Owner.TIME, (i,)))
    sizes = ("ppm", *(f"d{a}_um" for a in AXES[:dimension]))
    part, every = "warm-up of the part, which grows", tuple(range(dimension))
    return [*out, WarmUp("part_warmup", sizes, part, Owner.WORKPIECE, every)]


@dataclass(frozen=True)
class ZeroShiftOfAxis:
    """The zero of an axis shifts in the break of a measurement that was begun again."""

    axis: int

    def effect(self, points: Points, _: Places) -> Effect | None:
        """Return the effect, bound to points; None if they were measured in one go."""
        t0_s = None if points.time_s is None else break_of(points.time_s)
        if t0_s is None:
            return None
        after = from_then_on(t0_s, _moments(points), groups_of(points)[1])
        columns = _enter(points, self.axis, after.astype(float))
        return zero_shift(AXES[self.axis], columns[:, None])


@dataclass(frozen=True)
class CommonDrift:
    """Part and instrument drift from each other, slowly and in any way, alike at all places.

    Polynomials of time or order (Legendre) in each coordinate. It shows where each place was
    measured over and over; elsewhere it looks like an error of the axes.
    """

    def effect(self, points: Points, _: Places) -> Effect | None:
        """Return the effect, bound to points; None if they were not measured over and over."""
        place = places_of(points.nominal_mm)
        if len(points) < MIN_REPEATS * (int(place.max()) + 1):
            return None
        when = _moments(points)
        u = 2.0 * (when - when.min()) / max(float(np.ptp(when)), 1e-9) - 1.0
        shapes = np.polynomial.legendre.legvander(u, COMMON_DEGREE)[:, 1:]
        columns = [_enter(points, a, s) for a in range(points.dimension) for s in shapes.T]
        names = [
            f"{a}{k}_um" for a in AXES[: points.dimension] for k in range(1, COMMON_DEGREE + 1)
        ]
        label = "drift between part and instrument, common to all points"
        return linear("common_drift", names, np.stack(columns, axis=1), label, owner=Owner.TIME)


@dataclass(frozen=True)
class SetupShift:
    """The part slips on the instrument at a moment: it shifts, and turns about its middle."""

    def effect(self, points: Points, _: Places) -> Effect | None:
        """Return the effect, bound to points; None if there is but one moment."""
        when = _moments(points)
        moments = np.unique(when)
        between = (moments[1:] + moments[:-1]) / 2
        if len(between) < 2:
            return None
        also = None if points.time_s is None else break_of(moments)
        grid = moments_tried(between, len(points) * points.dimension, also)
        name = "row" if points.time_s is None else "t0_s"
        shape = ShiftShape(name, when, groups_of(points)[1], points.dimension, _turned(points))
        about = AXES[2 if points.dimension == 2 else 0 :]
        return gridded(
            "setup_shift",
            [
                *(f"d{a}_um" for a in AXES[: points.dimension]),
                *(f"r{a}_arcsec" for a in about),
                Parameter(name, grid=grid, bounds=(moments[0], moments[-1])),
            ],
            shape.columns,
            "shift of the part on the instrument",
            slopes=shape.slopes,
            owner=Owner.PLACEMENT,
        )


def entries(dimension: int) -> list[Entry]:
    """Return every entry of the catalogue for points in a plane or in space, but for the field."""
    axes = range(dimension)
    name = [f"the {a.upper()} axis" for a in AXES]
    out: list[Entry] = [
        LinearError(
            f"scale_{AXES[i]}", ("ppm",), f"scale of {name[i]}", partial(_slope, i, i, 1e-3)
        )
        for i in axes
    ]
    # Λ_xy −= g, Λ_xz += g, Λ_yz −= g
    out += [
        LinearError(
            f"squareness_{AXES[i]}{AXES[j]}",
            ("arcsec",),
            f"squareness of {AXES[j].upper()} to {AXES[i].upper()}",
            partial(_slope, i, j, (1e3 if (i, j) == (0, 2) else -1e3) * ARCSEC),
        )
        for i, j in combinations(axes, 2)
    ]
    bows = {
        f"positioning_{AXES[i]}": (i, i, f"positioning of {name[i]}, beyond its scale")
        for i in axes
    } | {
        f"straightness_{AXES[j]}_of_{AXES[i]}": (
            j,
            i,
            f"straightness of {name[i]} in {AXES[j].upper()}",
        )
        for i, j in permutations(axes, 2)
    }
    out += [
        LinearError(id_, ("a2_um", "a3_um"), label, partial(_moved, bow, into, i), moves=True)
        for id_, (into, i, label) in bows.items()
    ]
    out += [
        LinearError(
            f"angular_{AXES[about]}_of_{AXES[i]}",
            ("a1_arcsec", "a2_arcsec"),
            f"angular error of {name[i]} about {AXES[about].upper()}",
            partial(_moved, angular, about, i),
            moves=True,
        )
        for i in axes
        for about in ((2,) if dimension == 2 else range(3))
    ]
    out += [PeriodicError(i) for i in axes]
    expansion = "thermal expansion of the part"
    larger = LinearError("expansion", ("ppm",), expansion, _larger, Owner.WORKPIECE)
    out.append(replace(larger, looks_like=ALL_AXES))
    out += [Drift(i) for i in axes]
    out += warm_ups(dimension)
    return [*out, SetupShift(), *(ZeroShiftOfAxis(i) for i in axes), CommonDrift()]


def catalogue(points: Points, places: Places) -> list[Effect]:
    """All named candidates for which these points have the columns."""
    made = (entry.effect(points, places) for entry in entries(points.dimension))
    return [e for e in made if e is not None]


# --- how the places enter


def _enter(p: Points, axis: int, change: Floats) -> Floats:
    """Readings, (n d,), changed in one coordinate by ``change`` (n,)."""
    out = np.zeros((len(p), p.dimension))
    out[:, axis] = change
    return out.reshape(-1)


def _slope(into: int, along: int, size: float, p: Points, _: Places) -> Floats:
    """Proportional to the programmed place along one axis, in one coordinate."""
    return _enter(p, into, size * p.nominal_mm[:, along])[:, None]


def _larger(p: Points, _: Places) -> Floats:
    return np.asarray(p.nominal_mm.reshape(-1, 1) * 1e-3)


def _moved(
    motion: Callable[[int, int, Floats, Travel], Floats],
    into: int,
    along: int,
    p: Points,
    places: Places,
) -> Floats:
    """Displacements (n, 3, k) by a motion of a linear axis as columns of the readings, (n d, k)."""
    moved = motion(into, along, p.nominal_mm, places.used)
    return np.ascontiguousarray(moved[:, : p.dimension]).reshape(-1, moved.shape[2])


def _turned(p: Points) -> Floats:
    """Change of the readings as the part turns by 1 arcsec about its middle, (n d, 1 or 3)."""
    arms = np.zeros((len(p), 3))
    arms[:, : p.dimension] = p.nominal_mm - (p.nominal_mm.min(0) + p.nominal_mm.max(0)) / 2
    about = np.eye(3)[2 if p.dimension == 2 else 0 :]
    moved = [1e3 * ARCSEC * np.cross(axis, arms)[:, : p.dimension].reshape(-1) for axis in about]
    return np.stack(moved, axis=1)


def _elapsed(p: Points) -> Floats:
    """Hours since the first point of the group; without times the order, 0 to 1 in the group."""
    _, group = groups_of(p)
    out = np.zeros(len(p))
    for g in range(int(group.max()) + 1):
        mine = group == g
        if p.time_s is not None:
            out[mine] = elapsed_s(p.time_s[mine]) / 3600.0
        else:
            out[mine] = np.linspace(0.0, 1.0, int(mine.sum()))
    return out


def _moments(p: Points) -> Floats:
    """Times, or row numbers where there are none."""
    return np.arange(len(p), dtype=float) if p.time_s is None else np.asarray(p.time_s)


@dataclass(frozen=True, eq=False)
class ShiftShape:
    """Shift of all that comes later in the same set-up; the moment lies between rows.

    ``turned``: change of the readings as the part turns by 1 arcsec, (n d, m).
    """

    name: str
    when: Floats
    group: Any
    dimension: int
    turned: Floats

    def columns(self, values: Mapping[str, float]) -> Floats:
        """Columns of the shift, shape (n d, d), and of the turn."""
        after = from_then_on(values[self.name], self.when, self.group).astype(float)
        shift = in_every_coordinate(after[:, None], self.dimension)
        turn = self.turned * np.repeat(after, self.dimension)[:, None]
        return np.concatenate([shift, turn], axis=1)

    def slopes(self, _: Mapping[str, float]) -> Floats:
        """No derivative by the moment, shape (n d, 1)."""
        return np.zeros((len(self.when) * self.dimension, 1))


def in_every_coordinate(f: Floats, d: int) -> Floats:
    """Functions of the place (n, k) as columns of the readings, (n d, d k)."""
    n, k = f.shape
    out = np.zeros((n, d, d, k))
    for i in range(d):
        out[:, i, i] = f
    return out.reshape(n * d, d * k)


# --- what has no name


@dataclass(frozen=True, eq=False)
class Field:
    """Modes of a smooth field in every coordinate, less what named effects make of them.

    ``taken``: id → share of each of the field's columns, shape (k of the effect, d modes).
    """

    travel: Travel
    modes: Modes
    taken: dict[str, Floats] = field(repr=False)

    def effect(self, points: Points, named: Sequence[Effect], here: Floats | None = None) -> Effect:
        """Return the effect, bound to points.

        named: The others of these points. here: The modes at their programmed places, if known.
        """
        if here is None:
            here = self.modes.at(self.travel.field_places(points.nominal_mm))
        columns = in_every_coordinate(here, points.dimension)
        for e in named:
            if e.id in self.taken:
                columns = (
                    columns - e.columns(e.values([0.0] * len(e.parameters))) @ self.taken[e.id]
                )
        names = [
            f"{a}{k + 1}_um" for a in AXES[: points.dimension] for k in range(self.modes.count)
        ]
        return linear("field", names, columns, "smooth field of errors without a name")
