"""The set-up: machine, artefact and probe of a measurement, as it stands in ``setup.toml``.

Every key but the artefact's kind has a default, and ``print(setup)`` lists them all with value,
unit and meaning. Tables ``[machine]`` (with ``[machine.errors]`` and ``[machine.tolerance]``),
``[axes.X]`` and so on, ``[artefact]``, ``[probe]``, ``[resolution]``, ``[table]``, ``[plan]``,
``[control]``, ``[report]`` are its own.
``[turning]``, ``[servo]``, ``[ballbar]``, ``[hybrid]`` and ``[rotary_test]`` belong to these
processes, which declare them; a file with one of them needs no ``[artefact]`` (its kind is then
"none"). Any other key is an error, in any table, whichever command reads the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, instance, named, with_article, within
from trunnion.base.errors import InputError
from trunnion.base.frozen import FrozenMapping
from trunnion.base.read_files import RecordedFile
from trunnion.setup.agreement import check
from trunnion.setup.artefact import UNCERTAINTY, Artefact
from trunnion.setup.control import ControlSetup
from trunnion.setup.fields import LENGTH, Number, Part, Section, key
from trunnion.setup.machine import AxisSetup, Machine
from trunnion.setup.machines import Description
from trunnion.setup.report import ReportSetup
from trunnion.setup.write import (
    PROCESS_TABLES,
    commented_toml,
    headline_of,
    report_of,
    tables_of,
    toml_of,
)

AXES = ("X", "Y", "Z", "A", "B", "C")

SPEED = Number(1e-3, 1e7)

PERIODS_MS = (0.01, 50.0)
"""Servo periods of controls: 1 ms of LinuxCNC, 3 ms of an iTNC 530, 1 to 32 ms of a Sinumerik 840C.

Controls that read the probe with each step of their motors look 50 000 times a second.
"""


@dataclass(frozen=True)
class _Period:
    """The time between two looks of a control at its probe, ms."""

    words: str = f"0, or a number from {PERIODS_MS[0]:g} to {PERIODS_MS[1]:g} ms"

    def __call__(self, what: str, value: Any) -> float:
        period = within(what, value, 0.0)
        low, high = PERIODS_MS
        if period == 0 or low <= period <= high:
            return period
        units = {"µs": 1e-3, "s": 1e3}
        meant = [u for u, factor in units.items() if low <= factor * period <= high]
        asked = f": is it in {meant[0]} ({units[meant[0]] * period:g} ms)?" if meant else ""
        raise InputError(f"{what}: got {period:g}, expected {self.words}{asked}")


@dataclass(frozen=True)
class Probe(Part):
    """Touch probe. A control looks at it every `servo_period_ms`; 0 σ means unknown.

    The recorded position is the first look after contact, half a tick late on average, which every
    estimate takes off. The tick is feed × servo period (LinuxCNC: 1 ms is 10 µm at 600 mm/min); a
    probe that is latched at fixed steps of travel has a `tick_um` instead. Give one of the two.
    Coordinates that are only written in steps, to the nearest one, have a `resolution_um`.

    A ball that is not where the control takes it to be, beside the spindle axis or along it, moves
    the location errors of the table with it: no reading shows that. `offset_std_um` and
    `length_std_um` state how closely it is known.

    `length_mm` (ball centre to pivot) is used by a rotary head only. `stem_radius_mm` is for
    collision checks; None is half the ball radius: read it as `effective_stem_radius_mm`. So are
    `stem_length_mm` and `body_diameter_mm`.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.Probe(servo_period_ms=1.0).ticks_um(600.0)
    10.0
    """

    table: ClassVar[str] = "probe"
    ball_radius_mm: float = key(1.0, LENGTH, "radius of the ball")
    repeatability_um: float = key(0.0, UNCERTAINTY, "standard deviation; 0: to be estimated")
    tick_um: float = key(0.0, UNCERTAINTY, "travel between two looks at the probe, at every feed")
    length_mm: float = key(150.0, LENGTH, "ball centre to the pivot of a rotary head")
    stem_radius_mm: float | None = key(None, LENGTH, "for collision checks; else half the ball's")
    servo_period_ms: float = key(0.0, _Period(), "time between two looks; tick = feed × it")
    calibration_um: float = key(0.0, UNCERTAINTY, "standard uncertainty of the ball's radius")
    stem_length_mm: float | None = key(
        None, LENGTH, "ball centre to the probe's body, for collision checks; else length_mm"
    )
    body_diameter_mm: float = key(
        0.0, Number(0.0, 1e4), "of the probe's body, from stem_length_mm to length_mm; 0: none"
    )
    resolution_um: float = key(
        0.0, UNCERTAINTY, "step of the recorded coordinates, rounded and not late; 0: not known"
    )
    offset_std_um: float = key(
        0.0, UNCERTAINTY, "standard uncertainty of the ball beside the spindle axis, X and Y each"
    )
    length_std_um: float = key(0.0, UNCERTAINTY, "standard uncertainty of the probe's length")

    def __post_init__(self) -> None:
        """Check every field, and that the ball is thicker than its stem."""
        super().__post_init__()
        if self.effective_stem_radius_mm > self.ball_radius_mm:
            limit = (
                f"at most probe.ball_radius_mm = {self.ball_radius_mm:g}: the ball touches first"
            )
            raise self.refuse("stem_radius_mm", limit)
        if self.body_diameter_mm > 0 and self.stem_length_mm is None:
            raise self.refuse("stem_length_mm", "where the body begins, beside body_diameter_mm")
        if self.effective_stem_length_mm > self.length_mm:
            limit = f"at most probe.length_mm = {self.length_mm:g}, where the body ends"
            raise self.refuse("stem_length_mm", limit)
        if self.tick_um and self.servo_period_ms:
            raise self.refuse(
                "servo_period_ms", f"0 beside probe.tick_um = {self.tick_um:g}: give one of the two"
            )

    def ticks_um(self, feed_mm_min: Any) -> Any:
        """Travel between two looks at the probe, µm, at feeds in mm/min (any shape)."""
        return self.tick_um + self.servo_period_ms * feed_mm_min / 60.0

    @property
    def effective_stem_length_mm(self) -> float:
        """Length of the stem from the ball's centre: as given, or up to `length_mm`."""
        return self.length_mm if self.stem_length_mm is None else self.stem_length_mm

    @property
    def effective_stem_radius_mm(self) -> float:
        """Radius of the stem: as given, or half the ball radius."""
        given = self.stem_radius_mm
        return 0.5 * self.ball_radius_mm if given is None else given


@dataclass(frozen=True)
class Resolution(Part):
    """What commands are rounded to; 0 = not rounded. Recorded positions are not rounded.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.Resolution(linear_um=1.0).to_dict()
    {'linear_um': 1.0, 'rotary_arcsec': 0.36}
    """

    table: ClassVar[str] = "resolution"
    linear_um: float = key(0.1, UNCERTAINTY, "step of commands to linear axes; 0: not rounded")
    rotary_arcsec: float = key(0.36, UNCERTAINTY, "step of commands to rotary axes")


@dataclass(frozen=True)
class TableSetup(Part):
    """The rotary table as a disc, its top in the plane Z = 0 at A = 0, for collision checks.

    `is_assumed`: the set-up does not say how large it is.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.TableSetup(radius_mm=200.0).to_dict()
    {'radius_mm': 200.0, 'thickness_mm': 30.0}
    """

    table: ClassVar[str] = "table"
    radius_mm: float = key(150.0, LENGTH, "of the rotary table, a disc with its top at Z = 0")
    thickness_mm: float = key(30.0, LENGTH, "of the rotary table")
    is_assumed: bool = field(default=False, repr=False, compare=False)


@dataclass(frozen=True)
class PlanSetup(Part):
    """How a plan moves: where an approach starts, how far it searches, at what rapid speeds.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.PlanSetup(slow_feed_mm_min=30.0).slow_feed_mm_min
    30.0
    """

    table: ClassVar[str] = "plan"
    clearance_mm: float = key(5.0, LENGTH, "from the surface to the ball where an approach starts")
    overtravel_mm: float = key(5.0, LENGTH, "how far behind the contact an approach may search")
    rapid_mm_min: float = key(10000.0, SPEED, "rapid feed of linear axes")
    rotary_deg_min: float = key(3600.0, SPEED, "rapid speed of rotary axes")
    slow_feed_mm_min: float = key(
        0.0, Number(0.0, 1e7), "feed of a second, measuring pass of every touch; 0: one pass"
    )


PARTS: Mapping[str, type[Part]] = {
    part.table: part
    for part in (
        Machine,
        Artefact,
        Probe,
        Resolution,
        TableSetup,
        PlanSetup,
        ControlSetup,
        ReportSetup,
    )
}


@dataclass(frozen=True, repr=False)
class Setup:
    """A whole set-up; ``print(setup)`` lists every key with its value, unit and meaning.

    `source` is the file that it was read from, `read_as` that file as it was then.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(ball_radius_mm=1.5))
    >>> setup.sense("C"), setup.probe.effective_stem_radius_mm
    (1, 0.75)
    """

    artefact: Artefact
    machine: Machine = field(default_factory=Machine)
    axes: Mapping[str, AxisSetup] = field(default_factory=dict)
    probe: Probe = field(default_factory=Probe)
    resolution: Resolution = field(default_factory=Resolution)
    table: TableSetup = field(default_factory=lambda: TableSetup(is_assumed=True))
    plan: PlanSetup = field(default_factory=PlanSetup)
    control: ControlSetup = field(default_factory=ControlSetup)
    report: ReportSetup = field(default_factory=ReportSetup)
    turning: Mapping[str, Any] = field(default_factory=dict)
    servo: Mapping[str, Any] = field(default_factory=dict)
    ballbar: Mapping[str, Any] = field(default_factory=dict)
    hybrid: Mapping[str, Any] = field(default_factory=dict)
    rotary_test: Mapping[str, Any] = field(default_factory=dict)
    source: str = field(default="", compare=False, repr=False)
    read_as: RecordedFile | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        """Check the types of the parts and the names of the axes."""
        for name, part in PARTS.items():
            instance(name, getattr(self, name), part, with_article(part))
        for axis, given in named("axes", self.axes, "a mapping of axis name to AxisSetup").items():
            instance(f"axes.{choose('axes', axis, AXES)}", given, AxisSetup, "an AxisSetup")
        object.__setattr__(self, "axes", FrozenMapping(self.axes or {}))
        for name in PROCESS_TABLES:
            object.__setattr__(self, name, Section.of(name, getattr(self, name)))
        check(self)

    @checked
    def sense(self, axis: str) -> int:
        """Return 1 or -1: the sense of an axis (1 unless the set-up says otherwise)."""
        return self.axes[axis].sense if axis in self.axes else 1

    def axis_points(self) -> dict[str, tuple[float, float, float]]:
        """Return the nominal points of axes that are stated, by letter, mm."""
        stated = {letter: axis.point_mm for letter, axis in self.axes.items()}
        return {letter: point for letter, point in stated.items() if point is not None}

    def axis_ranges(self) -> dict[str, tuple[float, float]]:
        """Return the ranges of axes that are stated, by letter, mm or degrees."""
        stated = {letter: axis.range_mm or axis.range_deg for letter, axis in self.axes.items()}
        return {letter: limits for letter, limits in stated.items() if limits is not None}

    def description(self) -> Description:
        """Return where the axes of the machine are: its chain, and what ``[axes.X]`` says."""
        known = self.machine.description()
        stated = {k: a.direction for k, a in self.axes.items() if a.direction is not None}
        return replace(
            known,
            directions={**known.directions, **stated},
            points_mm={**known.points_mm, **self.axis_points()},
        )

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return the tables of the file with plain values; empty ones left out."""
        return tables_of(self)

    def to_toml(self, *, comments: bool = False) -> str:
        """Return the text of a ``setup.toml`` that reads back as an equal set-up.

        With `comments`: every key with its meaning beside it, those without a value as comments.
        """
        return commented_toml(self) if comments else toml_of(self)

    def __repr__(self) -> str:
        return f"<Setup: {headline_of(self)}>"

    def __str__(self) -> str:
        return report_of(self).text()

    def _repr_html_(self) -> str:
        return report_of(self).html()
