"""The set-up: machine, artefact and probe of a measurement, as it stands in ``setup.toml``.

Every key but the artefact's kind has a default, and ``print(setup)`` lists them all with value,
unit and meaning. Tables ``[machine]`` (with ``[machine.errors]``), ``[axes.X]`` and so on,
``[artefact]``, ``[probe]``, ``[resolution]``, ``[table]`` and ``[plan]`` are declared here.
``[turning]``, ``[servo]``, ``[ballbar]`` and ``[hybrid]`` belong to these processes, which declare
and read them; a file with one of them needs no ``[artefact]`` (its kind is then "none"). Any other
key is an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import trunnion._core as _core
from trunnion.base.checks import choose, entry, instance, named, within
from trunnion.base.errors import InputError, UnknownNameError
from trunnion.base.frozen import FrozenMapping
from trunnion.base.units import unit_of
from trunnion.setup.fields import (
    COORDINATE,
    LENGTH,
    Choice,
    Key,
    Number,
    Part,
    Section,
    Sign,
    Vector,
    key,
    keys_of,
)
from trunnion.setup.names import canonical_error_name
from trunnion.setup.write import headline_of, report_of, tables_of, toml_of

__all__ = [
    "Artefact",
    "AxisSetup",
    "Machine",
    "PlanSetup",
    "Probe",
    "Resolution",
    "Setup",
    "TableSetup",
]

AXES = ("X", "Y", "Z", "A", "B", "C")
PROCESS_TABLES = ("turning", "servo", "ballbar", "hybrid")
"""Tables that belong to a process, which declares and reads them."""

DIMENSIONS: Mapping[str, tuple[str, ...]] = {
    "cross": ("length_mm", "width_mm", "height_mm"),
    "cuboid": ("length_mm", "width_mm", "height_mm"),
    "sphere": ("diameter_mm", "centre_mm"),
    "none": ("length_mm", "width_mm", "height_mm"),  # earlier versions wrote them
}
"""Keys of an artefact beside its kind; "none" where nothing is touched."""

MAX_ERROR = {"µm": 1e5, "arcsec": 648_000.0}
"""Location errors beyond a tenth of a metre or half a turn are typos."""

UNCERTAINTY = Number(0.0, 1e4)
SPEED = Number(1e-3, 1e7)


@dataclass(frozen=True)
class _Presets:
    """A machine that the core knows."""

    @property
    def words(self) -> str:
        return "one of " + ", ".join(_core.presets())

    def __call__(self, what: str, value: Any) -> str:
        return choose(what, value, _core.presets())


@dataclass(frozen=True)
class _LocationErrors:
    """Location errors by name, in any spelling."""

    words: str = "a table of location errors, µm and arcsec"

    def __call__(self, what: str, value: Any) -> FrozenMapping[float]:
        errors: dict[str, float] = {}
        for spelling, size in named(what, value, self.words).items():
            with entry(spelling):
                name = _canonical(what, spelling)
                if name in errors:
                    raise InputError(f"{what}.{name}: got {spelling!r}, expected each error once")
                limit = MAX_ERROR[unit_of(name)]
                errors[name] = within(f"{what}.{name}", size, -limit, limit, unit_of(name))
        return FrozenMapping(errors)


def _canonical(what: str, spelling: str) -> str:
    try:
        return canonical_error_name(spelling)
    except UnknownNameError as error:
        raise UnknownNameError(f"{what}: {error}") from None


@dataclass(frozen=True)
class Machine(Part):
    """Chain of axes and what is known of its location errors (µm, arcsec; part of the model).

    Results are totals that include the known errors.
    """

    table: ClassVar[str] = "machine"
    preset: str = key("trt-ca", _Presets(), "chain of axes")
    errors: Mapping[str, float] = key(FrozenMapping({}), _LocationErrors(), "errors known before")

    def __post_init__(self) -> None:
        """Check every field, and that the machine has these errors."""
        super().__post_init__()
        known = [name for name, _ in _core.Machine(self.preset, 1.0, []).location_errors]
        for name in self.errors:
            with entry("errors", name):
                choose(f"machine.errors of {self.preset}", name, known)


@dataclass(frozen=True)
class AxisSetup(Part):
    """One axis. `sense` -1: the control counts it against the right-handed turn of the table."""

    table: ClassVar[str] = "axes"
    sense: int = key(1, Sign(), "-1: the control counts the axis the other way round")


@dataclass(frozen=True)
class Artefact(Part):
    """What is touched, mm. `kind` is "cross", "cuboid" or "sphere" ("none" where nothing is).

    A sphere needs `diameter_mm` and `centre_mm` (artefact frame); they are None for the others.
    """

    table: ClassVar[str] = "artefact"
    kind: str = key(..., Choice(tuple(DIMENSIONS)), "what is touched")
    length_mm: float = key(100.0, LENGTH, "along X")
    width_mm: float = key(25.0, LENGTH, "of a cross's bars; of a cuboid along Y")
    height_mm: float = key(25.0, LENGTH, "along Z")
    diameter_mm: float | None = key(None, LENGTH, "of the sphere")
    centre_mm: tuple[float, float, float] | None = key(
        None, Vector(3, COORDINATE), "of the sphere, artefact frame"
    )

    def __post_init__(self) -> None:
        """Check every field, and that the kind has these dimensions."""
        super().__post_init__()
        own = DIMENSIONS[self.kind]
        for name, declared in keys_of(Artefact).items():
            value = getattr(self, name)
            if name in own and value is None:
                raise self.refuse(name, f"{declared.takes.words}: a {self.kind} needs it")
            if name not in (*own, "kind") and value != declared.default:
                has = ", ".join(own)
                raise self.refuse(name, f"none: a {self.kind} has {has}")
        if self.kind == "cross" and self.width_mm >= self.length_mm:
            limit = f"less than artefact.length_mm = {self.length_mm:g}: a cross has arms"
            raise self.refuse("width_mm", limit)

    def own_keys(self) -> Mapping[str, Key]:
        """Return the kind and its dimensions."""
        own = ("kind", *DIMENSIONS[self.kind])
        return {name: declared for name, declared in keys_of(Artefact).items() if name in own}


@dataclass(frozen=True)
class Probe(Part):
    """Touch probe. A control looks at it every `servo_period_ms`; 0 σ means unknown.

    The recorded position is the first look after contact, half a tick late on average, which every
    estimate takes off. The tick is feed × servo period (LinuxCNC: 1 ms is 10 µm at 600 mm/min); a
    probe that is latched at fixed steps of travel has a `tick_um` instead. Give one of the two.

    `length_mm` (ball centre to pivot) is used by a rotary head only. `stem_radius_mm` is for
    collision checks; None is half the ball radius: read it as `effective_stem_radius_mm`.
    """

    table: ClassVar[str] = "probe"
    ball_radius_mm: float = key(1.0, LENGTH, "radius of the ball")
    repeatability_um: float = key(0.0, UNCERTAINTY, "standard deviation; 0: to be estimated")
    tick_um: float = key(0.0, UNCERTAINTY, "travel between two looks at the probe, at every feed")
    length_mm: float = key(150.0, LENGTH, "ball centre to the pivot of a rotary head")
    stem_radius_mm: float | None = key(None, LENGTH, "for collision checks; else half the ball's")
    servo_period_ms: float = key(0.0, Number(0.0, 1e3), "time between two looks; tick = feed × it")

    def __post_init__(self) -> None:
        """Check every field, and that the ball is thicker than its stem."""
        super().__post_init__()
        if self.effective_stem_radius_mm > self.ball_radius_mm:
            limit = (
                f"at most probe.ball_radius_mm = {self.ball_radius_mm:g}: the ball touches first"
            )
            raise self.refuse("stem_radius_mm", limit)
        if self.tick_um and self.servo_period_ms:
            raise self.refuse(
                "servo_period_ms", f"0 beside probe.tick_um = {self.tick_um:g}: give one of the two"
            )

    def ticks_um(self, feed_mm_min: Any) -> Any:
        """Travel between two looks at the probe, µm, at feeds in mm/min (any shape)."""
        return self.tick_um + self.servo_period_ms * feed_mm_min / 60.0

    @property
    def effective_stem_radius_mm(self) -> float:
        """Radius of the stem: as given, or half the ball radius."""
        given = self.stem_radius_mm
        return 0.5 * self.ball_radius_mm if given is None else given


@dataclass(frozen=True)
class Resolution(Part):
    """What commands are rounded to; 0 = not rounded. Recorded positions are not rounded."""

    table: ClassVar[str] = "resolution"
    linear_um: float = key(0.1, UNCERTAINTY, "step of commands to linear axes; 0: not rounded")
    rotary_arcsec: float = key(0.36, UNCERTAINTY, "step of commands to rotary axes")


@dataclass(frozen=True)
class TableSetup(Part):
    """The rotary table as a disc, its top in the plane Z = 0 at A = 0, for collision checks."""

    table: ClassVar[str] = "table"
    radius_mm: float = key(150.0, LENGTH, "of the rotary table, a disc with its top at Z = 0")
    thickness_mm: float = key(30.0, LENGTH, "of the rotary table")


@dataclass(frozen=True)
class PlanSetup(Part):
    """How a plan moves: where an approach starts, how far it searches, at what rapid speeds."""

    table: ClassVar[str] = "plan"
    clearance_mm: float = key(5.0, LENGTH, "from the surface to the ball where an approach starts")
    overtravel_mm: float = key(5.0, LENGTH, "how far behind the contact an approach may search")
    rapid_mm_min: float = key(10000.0, SPEED, "rapid feed of linear axes")
    rotary_deg_min: float = key(3600.0, SPEED, "rapid speed of rotary axes")


PARTS: Mapping[str, type[Part]] = {
    part.table: part for part in (Machine, Artefact, Probe, Resolution, TableSetup, PlanSetup)
}


@dataclass(frozen=True, repr=False)
class Setup:
    """A whole set-up; ``print(setup)`` lists every key with its value, unit and meaning.

    Examples
    --------
    >>> setup = Setup(artefact=Artefact("cross"), probe=Probe(ball_radius_mm=1.5))
    >>> setup.sense("C"), setup.probe.effective_stem_radius_mm
    (1, 0.75)
    """

    artefact: Artefact
    machine: Machine = field(default_factory=Machine)
    axes: Mapping[str, AxisSetup] = field(default_factory=dict)
    probe: Probe = field(default_factory=Probe)
    resolution: Resolution = field(default_factory=Resolution)
    table: TableSetup = field(default_factory=TableSetup)
    plan: PlanSetup = field(default_factory=PlanSetup)
    turning: Mapping[str, Any] = field(default_factory=dict)
    servo: Mapping[str, Any] = field(default_factory=dict)
    ballbar: Mapping[str, Any] = field(default_factory=dict)
    hybrid: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the types of the parts and the names of the axes."""
        for name, part in PARTS.items():
            instance(name, getattr(self, name), part, f"{_article(part)} {part.__name__}")
        for axis, given in named("axes", self.axes, "a mapping of axis name to AxisSetup").items():
            instance(f"axes.{choose('axes', axis, AXES)}", given, AxisSetup, "an AxisSetup")
        object.__setattr__(self, "axes", FrozenMapping(self.axes or {}))
        for name in PROCESS_TABLES:
            object.__setattr__(self, name, Section.of(name, getattr(self, name)))

    def sense(self, axis: str) -> int:
        """Return 1 or -1: the sense of an axis (1 unless the set-up says otherwise)."""
        return self.axes[axis].sense if axis in self.axes else 1

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return the tables of the file with plain values; empty ones left out."""
        return tables_of(self)

    def to_toml(self) -> str:
        """Return the text of a ``setup.toml`` that reads back as an equal set-up."""
        return toml_of(self)

    def __repr__(self) -> str:
        return f"<Setup: {headline_of(self)}>"

    def __str__(self) -> str:
        return report_of(self).text()

    def _repr_html_(self) -> str:
        return report_of(self).html()


def _article(kind: type) -> str:
    return "an" if kind.__name__[0] in "AEIOU" else "a"
