"""The set-up: machine, artefact and probe of a measurement, as it stands in ``setup.toml``.

Every key but the artefact's kind has a default, and ``print(setup)`` lists them all with value,
unit and meaning. Tables ``[machine]`` (with ``[machine.errors]`` and ``[machine.tolerance]``),
``[axes.X]`` and so on, ``[artefact]``, ``[probe]``, ``[resolution]``, ``[table]``, ``[plan]``,
``[control]``, ``[report]`` are its own.
``[turning]``, ``[servo]``, ``[ballbar]``, ``[hybrid]`` and ``[rotary_test]`` belong to these
processes, which declare and read them; a file with one of them needs no ``[artefact]`` (its kind is
then "none"). Any other key is an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, entry, instance, named, with_article
from trunnion.base.errors import InputError
from trunnion.base.frozen import FrozenMapping
from trunnion.setup.control import ControlSetup
from trunnion.setup.fields import (
    COORDINATE,
    LENGTH,
    Choice,
    Key,
    Number,
    Part,
    Section,
    Vector,
    Vectors,
    key,
    keys_of,
)
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

DIMENSIONS: Mapping[str, tuple[str, ...]] = {
    "cross": ("length_mm", "width_mm", "height_mm"),
    "cuboid": ("length_mm", "width_mm", "height_mm"),
    "sphere": ("diameter_mm", "centre_mm", "stem_diameter_mm"),
    "spheres": ("diameter_mm", "spheres_mm", "stem_diameter_mm"),
    "ring": ("diameter_mm", "outer_diameter_mm", "height_mm"),
    "none": ("length_mm", "width_mm", "height_mm"),  # earlier versions wrote them
}
"""Keys of an artefact beside its kind; "none" where nothing is touched."""

HOLDING = ("base_mm", "clamps_mm", "chuck_mm")
"""What an artefact of any kind is held by, as obstacles of a plan."""

STANDING = ("place_mm", "turn_deg", "tolerance_mm", "tolerance_deg", *HOLDING)
"""Keys that say how an artefact of any kind stands on the table."""

CERTIFICATE = (
    *("calibration_um", "calibration_arcsec", "expansion_ppm_k"),
    *("temperature_c", "temperature_std_k"),
)
"""Keys that say how well an artefact of any kind is known."""

REFERENCE_C = 20.0
"""Temperature that dimensions are stated at (ISO 1)."""

UNCERTAINTY = Number(0.0, 1e4)
SPEED = Number(1e-3, 1e7)


@dataclass(frozen=True)
class Artefact(Part):
    """What is touched, mm.

    `kind` is "cross", "cuboid" (a datum cube, wherever `place_mm` puts it), "sphere", "spheres" (a
    ball plate, a ball bar, a scale with its master balls) or "ring" (a ring gauge or a bore, its
    axis Z of the artefact frame), "none" where nothing is touched.

    A sphere needs `diameter_mm` and `centre_mm`, several need `spheres_mm`, two to nine centres
    (all in the artefact frame); a ring needs `diameter_mm` (of the bore) and `outer_diameter_mm`.
    They are None for the others. Stems, from each sphere down to the table top, are obstacles of a
    plan, as are a plate of the lengths `base_mm` under the artefact, boxes beside it (`clamps_mm`)
    and a chuck (`chuck_mm`); a `stem_diameter_mm` of None is a third of the sphere's: read it as
    `effective_stem_diameter_mm`.

    `place_mm` and `turn_deg` (about Z) are where the artefact's frame nominally stands in the
    table's, whose origin is the centre of its top; the placement that is identified is the
    deviation from there. A plan keeps clear of the artefact wherever within `tolerance_mm` (any
    direction) and `tolerance_deg` (about Z) of its place it stands.

    What is stated of its calibration and temperature is part of uncertainty budgets.

    Examples
    --------
    >>> import trunnion as tn
    >>> ball = tn.Artefact("sphere", diameter_mm=24.0, centre_mm=(60.0, 0.0, 80.0))
    >>> ball.effective_stem_diameter_mm
    8.0
    """

    table: ClassVar[str] = "artefact"
    kind: str = key(..., Choice(tuple(DIMENSIONS)), "what is touched")
    length_mm: float = key(100.0, LENGTH, "along X")
    width_mm: float = key(25.0, LENGTH, "of a cross's bars; of a cuboid along Y")
    height_mm: float = key(25.0, LENGTH, "along Z")
    diameter_mm: float | None = key(None, LENGTH, "of the sphere, of each sphere, of the bore")
    centre_mm: tuple[float, float, float] | None = key(
        None, Vector(3, COORDINATE), "of the sphere, artefact frame"
    )
    spheres_mm: tuple[tuple[float, float, float], ...] | None = key(
        None, Vectors(3, 2, 9, COORDINATE), "centres of several spheres, artefact frame"
    )
    outer_diameter_mm: float | None = key(None, LENGTH, "of the ring; its outside is not touched")
    stem_diameter_mm: float | None = key(
        None, Number(0.0, 1e5), "of the sphere's stem; 0: none; else a third of the sphere's"
    )
    place_mm: tuple[float, float, float] = key(
        (0.0, 0.0, 0.0), Vector(3, COORDINATE), "nominal place on the table, from its centre"
    )
    turn_deg: float = key(0.0, Number(-360.0, 360.0), "nominal turn about Z on the table")
    tolerance_mm: float = key(2.0, Number(0.0, 1e3), "how far from its place it may stand")
    tolerance_deg: float = key(1.0, Number(0.0, 45.0), "how far it may be turned about Z")
    base_mm: tuple[float, float, float] | None = key(
        None, Vector(3, LENGTH), "plate under the artefact: along X and Y, height; else none"
    )
    clamps_mm: tuple[tuple[float, ...], ...] | None = key(
        None,
        Vectors(5, 0, 100, COORDINATE),
        "boxes beside the artefact, such as jaws of a vise, on the table and turned with it: X and "
        "Y of the middle from its place, lengths along X and Y, height; else none",
    )
    chuck_mm: tuple[float, float] | None = key(
        None, Vector(2, LENGTH), "chuck about the artefact's place: diameter, height; else none"
    )
    calibration_um: float = key(0.0, UNCERTAINTY, "standard uncertainty of each dimension")
    calibration_arcsec: float = key(0.0, UNCERTAINTY, "standard uncertainty of its squareness")
    expansion_ppm_k: float = key(11.5, Number(0.0, 100.0), "expansion coefficient; steel: 11.5")
    temperature_c: float = key(
        REFERENCE_C, Number(-50.0, 150.0), "of the artefact; dimensions are those at 20 °C"
    )
    temperature_std_k: float = key(0.0, Number(0.0, 100.0), "standard uncertainty of it")

    def __post_init__(self) -> None:
        """Check every field, and that the kind has these dimensions."""
        super().__post_init__()
        own = self.own_names()
        for name, declared in keys_of(Artefact).items():
            value = getattr(self, name)
            if name in own and value is None and name not in ("stem_diameter_mm", *HOLDING):
                raise self.refuse(name, f"{declared.takes.words}: a {self.kind} needs it")
            if name not in own and value != declared.default:
                has = ", ".join(own[1:])
                raise self.refuse(name, f"none: a {self.kind} has {has}")
        if self.kind == "cross" and self.width_mm >= self.length_mm:
            limit = f"less than artefact.length_mm = {self.length_mm:g}: a cross has arms"
            raise self.refuse("width_mm", limit)
        if (self.outer_diameter_mm or np.inf) <= (self.diameter_mm or 0.0):
            limit = f"more than artefact.diameter_mm = {self.diameter_mm:g}, the bore's"
            raise self.refuse("outer_diameter_mm", limit)
        if self.diameter_mm is not None and self.effective_stem_diameter_mm >= self.diameter_mm:
            limit = f"less than artefact.diameter_mm = {self.diameter_mm:g}: the sphere is touched"
            raise self.refuse("stem_diameter_mm", limit)

    @property
    def growth(self) -> float:
        """Its dimensions at its temperature, as a multiple of those at 20 °C."""
        return 1.0 + 1e-6 * self.expansion_ppm_k * (self.temperature_c - REFERENCE_C)

    @property
    def effective_stem_diameter_mm(self) -> float:
        """Diameter of a sphere's stem: as given, or a third of the sphere's; else 0."""
        given = self.stem_diameter_mm
        if "stem_diameter_mm" not in self.own_names():
            return 0.0
        return (self.diameter_mm or 0.0) / 3.0 if given is None else given

    @property
    def centres_mm(self) -> tuple[tuple[float, float, float], ...]:
        """Centres of its spheres, artefact frame; none where it has none."""
        own = () if self.centre_mm is None else (self.centre_mm,)
        return own if self.spheres_mm is None else self.spheres_mm

    def own_names(self) -> tuple[str, ...]:
        """Return the names of the keys that this kind has."""
        return names_of(self.kind)

    def own_keys(self) -> Mapping[str, Key]:
        """Return the kind, its dimensions and how it stands."""
        own = self.own_names()
        return {name: declared for name, declared in keys_of(Artefact).items() if name in own}


def names_of(kind: str) -> tuple[str, ...]:
    """Return the names of the keys that a kind of artefact has."""
    return ("kind", *DIMENSIONS[kind], *(() if kind == "none" else STANDING + CERTIFICATE))


@dataclass(frozen=True)
class Probe(Part):
    """Touch probe. A control looks at it every `servo_period_ms`; 0 σ means unknown.

    The recorded position is the first look after contact, half a tick late on average, which every
    estimate takes off. The tick is feed × servo period (LinuxCNC: 1 ms is 10 µm at 600 mm/min); a
    probe that is latched at fixed steps of travel has a `tick_um` instead. Give one of the two.

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
    servo_period_ms: float = key(0.0, Number(0.0, 1e3), "time between two looks; tick = feed × it")
    calibration_um: float = key(0.0, UNCERTAINTY, "standard uncertainty of the ball's radius")
    stem_length_mm: float | None = key(
        None, LENGTH, "ball centre to the probe's body, for collision checks; else length_mm"
    )
    body_diameter_mm: float = key(
        0.0, Number(0.0, 1e4), "of the probe's body, from stem_length_mm to length_mm; 0: none"
    )

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

    `source` is the file that it was read from.

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

    def __post_init__(self) -> None:
        """Check the types of the parts and the names of the axes."""
        for name, part in PARTS.items():
            instance(name, getattr(self, name), part, with_article(part))
        for axis, given in named("axes", self.axes, "a mapping of axis name to AxisSetup").items():
            instance(f"axes.{choose('axes', axis, AXES)}", given, AxisSetup, "an AxisSetup")
        object.__setattr__(self, "axes", FrozenMapping(self.axes or {}))
        self._check_axes()
        for axis, made in self.axes.items():
            _check_range(axis, made)
        for name in PROCESS_TABLES:
            object.__setattr__(self, name, Section.of(name, getattr(self, name)))

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

    def _check_axes(self) -> None:
        """Refuse axes that the machine has not, and what an axis cannot have."""
        known = self.machine.description()
        letters = known.core(1.0).letters
        for axis, given in self.axes.items():
            with entry("axes", axis):
                if axis not in "XYZ" and axis not in letters:
                    has = ", ".join("XYZ" + letters)
                    raise InputError(
                        f"axes.{axis}: got an axis that machine {self.machine.name} has not, "
                        f"expected one of {has}"
                    )
            for name in ("direction", "point_mm"):
                value = getattr(given, name)
                with entry("axes", axis, name):
                    if axis in "XYZ" and value is not None:
                        raise InputError(
                            f"axes.{axis}.{name}: got {list(value)}, expected none: linear axes "
                            "are along X, Y, Z of the machine frame, wherever they are"
                        )
                    if axis in letters and value is not None:
                        self._check_line(axis, name, value)
        with entry("machine"):
            self.machine.check_errors(self.description().core(self.probe.length_mm))

    def _check_line(self, axis: str, name: str, value: tuple[float, float, float]) -> None:
        """Let the core refuse the direction or, with its direction, the point of one axis."""
        known = self.machine.description()
        direction = self.axes[axis].direction
        if direction is not None:
            known = replace(known, directions={**known.directions, axis: direction})
        if name == "point_mm":
            known = replace(known, points_mm={**known.points_mm, axis: value})
        known.core(self.probe.length_mm)

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


def _check_range(axis: str, given: AxisSetup) -> None:
    """Refuse a range in the other unit, or one from high to low."""
    own, other = ("range_mm", "range_deg") if axis in "XYZ" else ("range_deg", "range_mm")
    limits = getattr(given, own)
    with entry("axes", axis, other):
        if getattr(given, other) is not None:
            got = list(getattr(given, other))
            raise InputError(f"axes.{axis}.{other}: got {got}, expected {own} for axis {axis}")
    with entry("axes", axis, own):
        if limits is not None and not limits[0] < limits[1]:
            raise InputError(
                f"axes.{axis}.{own}: got {list(limits)}, expected the lower limit first"
            )
