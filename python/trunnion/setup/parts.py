"""The set-up: machine, artefact and probe of a measurement, read from ``setup.toml`` or built.

Every key but the artefact's kind has a default. This is the one place that lists them all::

    [machine]
    preset = "trt-ca"        # the chain of axes; the machine model knows the list
    [machine.errors]         # location errors known beforehand, µm (offsets) and arcsec (tilts):
    EX0C = 0.0               # part of the nominal model, results are totals that include them
    [axes.C]                 # one table an axis, X Y Z A B C
    sense = 1                # -1: the control counts this axis the other way round
    [artefact]
    kind = "cross"           # "cross" | "cuboid" | "sphere"; no default
    length_mm = 100.0        # cross and cuboid: along X
    width_mm = 25.0          #   of the bars; of the cuboid along Y
    height_mm = 25.0
    diameter_mm = 20.0       # sphere only, where it has no default
    centre_mm = [0, 0, 60]   # sphere only, where it has no default; artefact frame
    [probe]
    ball_radius_mm = 1.0
    repeatability_um = 0.0   # 1 σ; 0 = unknown, to be estimated
    tick_um = 0.0            # travel between two looks at the probe, the same at every feed
    length_mm = 150.0        # ball centre to the pivot of a rotary head; only a head uses it
    stem_radius_mm = 0.5     # for collision checks; default half the ball radius
    [resolution]
    linear_um = 0.1          # commands are rounded to these; recorded positions are not
    rotary_arcsec = 0.36
    [table]                  # for collision checks: a disc, its top at Z = 0 when A = 0
    radius_mm = 150.0
    thickness_mm = 30.0
    [plan]
    clearance_mm = 5.0       # from the surface to the ball where an approach starts
    overtravel_mm = 5.0      # how far behind the nominal contact an approach may search
    rapid_mm_min = 10000.0
    rotary_deg_min = 3600.0

The tables ``[turning]``, ``[servo]``, ``[ballbar]`` and ``[hybrid]`` belong to the sister machines,
which read them themselves; a file with one of them needs no ``[artefact]`` (its kind is then
"none"). Any other key is an error.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from numbers import Real
from os import PathLike
from typing import Any, ClassVar

import trunnion._core as _core
from trunnion.base.errors import InputError, UnknownNameError
from trunnion.files.toml import TomlText
from trunnion.setup.names import canonical_error_name

__all__ = [
    "Artefact",
    "AxisSetup",
    "Machine",
    "PlanSetup",
    "Probe",
    "Resolution",
    "Setup",
    "TableSetup",
    "read_setup",
]

AXES = ("X", "Y", "Z", "A", "B", "C")
ARTEFACT_KINDS = ("cross", "cuboid", "sphere")
SISTER_TABLES = ("turning", "servo", "ballbar", "hybrid")


class _EntryError(InputError):
    """A value that its key does not take; `keys` is its path below the table that was checked."""

    def __init__(self, message: str, keys: tuple[str | int, ...] = ()) -> None:
        super().__init__(message)
        self.keys = keys


class _UnknownEntryError(_EntryError, UnknownNameError):
    """A value that is no name of the list."""


def _fault(name: str, got: object, wanted: str, *below: str | int) -> _EntryError:
    return _EntryError(f"{name}: got {got!r}, wanted {wanted}", below)


# --- checks of one value; each returns the value in its final type


def _number(name: str, value: object, wanted: str = "a finite number") -> float:
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if math.isfinite(number):
            return number
    raise _fault(name, value, wanted)


def _positive(name: str, value: object) -> float:
    number = _number(name, value, "a finite number above 0")
    if number <= 0.0:
        raise _fault(name, value, "a finite number above 0")
    return number


def _not_negative(name: str, value: object) -> float:
    number = _number(name, value, "a finite number, 0 or above")
    if number < 0.0:
        raise _fault(name, value, "a finite number, 0 or above")
    return number


def _sense(name: str, value: object) -> int:
    if not isinstance(value, bool) and isinstance(value, Real) and value in (1, -1):
        return 1 if value == 1 else -1
    raise _fault(name, value, "1 or -1")


def _preset(name: str, value: object) -> str:
    if value in _core.presets():
        return str(value)
    raise _UnknownEntryError(f"{name}: got {value!r}, wanted one of {', '.join(_core.presets())}")


def _kind(name: str, value: object) -> str:
    if value in (*ARTEFACT_KINDS, "none"):
        return str(value)
    raise _fault(name, value, 'one of "cross", "cuboid", "sphere"')


def _point(name: str, value: object) -> tuple[float, float, float]:
    wanted = "three finite numbers [x, y, z]"
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise _fault(name, value, wanted)
    x, y, z = (_number(name, item, wanted) for item in value)
    return x, y, z


def _errors(name: str, value: object) -> dict[str, float]:
    if not isinstance(value, Mapping):
        raise _fault(name, value, "a table of location errors, µm and arcsec")
    errors: dict[str, float] = {}
    for spelling, size in value.items():
        try:
            canonical = canonical_error_name(spelling)
        except UnknownNameError as error:
            raise _EntryError(f"{name}: {error}", (spelling,)) from None
        if canonical in errors:
            raise _fault(f"{name}.{canonical}", spelling, "each error once", spelling)
        try:
            errors[canonical] = _number(f"{name}.{canonical}", size)
        except _EntryError as error:
            raise _EntryError(str(error), (spelling,)) from None
    return errors


def _checked(check: Callable[[str, object], object], default: object) -> Any:
    """Field of a part with its default and check; a default None passes unchecked."""
    return field(default=default, metadata={"check": check})


class _Part:
    """A table of the file. Values are checked and brought to their type when it is made."""

    table: ClassVar[str]

    def __post_init__(self) -> None:
        for item in fields(self):  # type: ignore[arg-type]
            value = getattr(self, item.name)
            check = item.metadata.get("check")
            if check is None or (value is None and item.default is None):
                continue
            try:
                value = check(f"{self.table}.{item.name}", value)
            except _EntryError as error:
                error.keys = (item.name, *error.keys)
                raise
            object.__setattr__(self, item.name, value)


# --- the parts


@dataclass(frozen=True)
class Machine(_Part):
    """Chain of axes and what is known of its location errors (µm, arcsec; part of the model)."""

    table: ClassVar[str] = "machine"
    preset: str = _checked(_preset, "trt-ca")
    errors: Mapping[str, float] = field(default_factory=dict, metadata={"check": _errors})

    def __post_init__(self) -> None:
        super().__post_init__()
        known = [name for name, _ in _core.Machine(self.preset, 1.0, []).location_errors]
        for name in self.errors:
            if name not in known:
                raise _UnknownEntryError(
                    f"machine.errors: got {name!r}, wanted an error that {self.preset} has: "
                    f"{', '.join(known)}",
                    ("errors", name),
                )


@dataclass(frozen=True)
class AxisSetup(_Part):
    """One axis. `sense` -1: the control counts it against the right-handed turn of the table."""

    table: ClassVar[str] = "axes"
    sense: int = _checked(_sense, 1)


@dataclass(frozen=True)
class Artefact(_Part):
    """What is touched, mm. `kind` is "cross", "cuboid" or "sphere" ("none" where nothing is).

    A sphere needs `diameter_mm` and `centre_mm` (artefact frame); they are None for the others.
    """

    table: ClassVar[str] = "artefact"
    kind: str = field(metadata={"check": _kind})
    length_mm: float = _checked(_positive, 100.0)
    width_mm: float = _checked(_positive, 25.0)
    height_mm: float = _checked(_positive, 25.0)
    diameter_mm: float | None = _checked(_positive, None)
    centre_mm: tuple[float, float, float] | None = _checked(_point, None)

    def __post_init__(self) -> None:
        super().__post_init__()
        for item in fields(self)[1:]:
            key, value = item.name, getattr(self, item.name)
            of_sphere = item.default is None
            if value is None and self.kind == "sphere":
                raise _EntryError(f"artefact.{key}: got none, wanted one: a sphere needs it")
            if value != item.default and of_sphere != (self.kind == "sphere"):
                raise _fault(
                    f"artefact.{key}", value, f"none: a {self.kind} has no such dimension", key
                )
        if self.kind == "cross" and self.width_mm >= self.length_mm:
            raise _fault(
                "artefact.width_mm",
                self.width_mm,
                f"less than artefact.length_mm = {self.length_mm:g}: a cross has arms",
                "width_mm",
            )


@dataclass(frozen=True)
class Probe(_Part):
    """Touch probe. `tick_um` is the travel between two looks at it; 0 σ means unknown.

    `length_mm` (ball centre to pivot) is used by a rotary head only. `stem_radius_mm` is for
    collision checks; None is half the ball radius: read it as `effective_stem_radius_mm`.
    """

    table: ClassVar[str] = "probe"
    ball_radius_mm: float = _checked(_positive, 1.0)
    repeatability_um: float = _checked(_not_negative, 0.0)
    tick_um: float = _checked(_not_negative, 0.0)
    length_mm: float = _checked(_positive, 150.0)
    stem_radius_mm: float | None = _checked(_positive, None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.effective_stem_radius_mm > self.ball_radius_mm:
            raise _fault(
                "probe.stem_radius_mm",
                self.stem_radius_mm,
                f"at most probe.ball_radius_mm = {self.ball_radius_mm:g}: the ball touches first",
                "stem_radius_mm",
            )

    @property
    def effective_stem_radius_mm(self) -> float:
        """Radius of the stem: as given, or half the ball radius."""
        given = self.stem_radius_mm
        return 0.5 * self.ball_radius_mm if given is None else given


@dataclass(frozen=True)
class Resolution(_Part):
    """What commands are rounded to; 0 = not rounded. Recorded positions are not rounded."""

    table: ClassVar[str] = "resolution"
    linear_um: float = _checked(_not_negative, 0.1)
    rotary_arcsec: float = _checked(_not_negative, 0.36)


@dataclass(frozen=True)
class TableSetup(_Part):
    """The rotary table as a disc, its top in the plane Z = 0 at A = 0, for collision checks."""

    table: ClassVar[str] = "table"
    radius_mm: float = _checked(_positive, 150.0)
    thickness_mm: float = _checked(_positive, 30.0)


@dataclass(frozen=True)
class PlanSetup(_Part):
    """How a plan moves: where an approach starts, how far it searches, at what rapid speeds."""

    table: ClassVar[str] = "plan"
    clearance_mm: float = _checked(_positive, 5.0)
    overtravel_mm: float = _checked(_positive, 5.0)
    rapid_mm_min: float = _checked(_positive, 10000.0)
    rotary_deg_min: float = _checked(_positive, 3600.0)


_PARTS: dict[str, type[_Part]] = {
    "machine": Machine,
    "artefact": Artefact,
    "probe": Probe,
    "resolution": Resolution,
    "table": TableSetup,
    "plan": PlanSetup,
}


@dataclass(frozen=True)
class Setup:
    """A whole set-up; see the module for every key, its unit and its default.

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
        for key, part in _PARTS.items():
            if not isinstance(getattr(self, key), part):
                raise _fault(key, getattr(self, key), f"a {part.__name__}", key)
        if not isinstance(self.axes, Mapping):
            raise _fault("axes", self.axes, "a mapping of axis name to AxisSetup", "axes")
        for name, axis in self.axes.items():
            if name not in AXES:
                wanted = f"an axis name, one of {', '.join(AXES)}"
                raise _fault("axes", name, wanted, "axes", name)
            if not isinstance(axis, AxisSetup):
                raise _fault(f"axes.{name}", axis, "an AxisSetup", "axes", name)
        for key in SISTER_TABLES:
            if not isinstance(getattr(self, key), Mapping):
                raise _fault(key, getattr(self, key), "a table", key)

    def sense(self, axis: str) -> int:
        """Return 1 or -1: the sense of an axis (1 unless the set-up says otherwise)."""
        return self.axes[axis].sense if axis in self.axes else 1

    def to_toml(self) -> str:
        """Return the set-up as the text of a ``setup.toml`` that reads back as this set-up."""
        tables: dict[str, Any] = {
            key: {
                item.name: value
                for item in fields(part)  # type: ignore[arg-type]
                if (value := getattr(getattr(self, key), item.name)) is not None
            }
            for key, part in _PARTS.items()
        }
        if self.artefact.kind == "sphere":
            for key in ("length_mm", "width_mm", "height_mm"):
                del tables["artefact"][key]
        tables["axes"] = {name: {"sense": axis.sense} for name, axis in self.axes.items()}
        tables |= {key: getattr(self, key) for key in SISTER_TABLES if getattr(self, key)}
        return "\n".join(line for line in _toml_lines(tables, ())).lstrip("\n") + "\n"


# --- files


def read_setup(path: str | PathLike[str]) -> Setup:
    """Read ``setup.toml``; see the module for its keys.

    Raises
    ------
    FileFormatError
        If the file is not TOML, has a key that nobody knows or a value that its key does not take;
        the message has file, line and column, what stood there and what is wanted.
    """
    file = TomlText.read(path)
    tables = {key: file.tables[key] for key in file.tables}
    for key, value in tables.items():
        if key not in (*_PARTS, "axes", *SISTER_TABLES):
            raise _unknown(file, (key,), (*_PARTS, "axes", *SISTER_TABLES))
        if not isinstance(value, Mapping):
            raise _wrong(file, (key,), "a table")
    sisters: dict[str, Any] = {key: tables[key] for key in SISTER_TABLES if key in tables}
    if "artefact" not in tables and sisters:
        tables["artefact"] = {"kind": "none"}
    if "kind" not in _table(tables, "artefact"):
        what = 'artefact.kind: missing, wanted kind = "cross", "cuboid" or "sphere"'
        raise file.error(("artefact", "kind"), f"{what} in a table [artefact]", at_value=False)
    built: dict[str, Any] = {
        key: _build(file, part, (key,), _table(tables, key)) for key, part in _PARTS.items()
    }
    axes = {}
    for name, axis in _table(tables, "axes").items():
        if name not in AXES:
            raise _unknown(file, ("axes", name), AXES)
        if not isinstance(axis, Mapping):
            raise _wrong(file, ("axes", name), "a table with the key sense")
        axes[name] = _build(file, AxisSetup, ("axes", name), axis)
    return Setup(axes=axes, **built, **sisters)


def _table(tables: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    table: Mapping[str, Any] = tables.get(key, {})
    return table


def _unknown(file: TomlText, keys: tuple[str, ...], known: tuple[str, ...]) -> Exception:
    what = f"{'.'.join(keys)}: unknown key, wanted one of {', '.join(known)}"
    return file.error(keys, what, at_value=False)


def _wrong(file: TomlText, keys: tuple[str, ...], wanted: str) -> Exception:
    what = f"{'.'.join(keys)}: got {file.written(keys)}, wanted {wanted}"
    return file.error(keys, what, at_value=True)


def _build(
    file: TomlText, part: type[_Part], keys: tuple[str, ...], values: Mapping[str, Any]
) -> Any:
    """Make a part from its table; its faults become errors of the file, with their place."""
    known = tuple(item.name for item in fields(part))  # type: ignore[arg-type]
    if values.get("kind") == "sphere":
        known = ("kind", "diameter_mm", "centre_mm")
    for key in values:
        if key not in known:
            raise _unknown(file, (*keys, key), known)
    try:
        return part(**values)
    except _EntryError as error:
        what = ".".join(keys) + str(error).removeprefix(part.table)  # axes.C, not axes
        raise file.error((*keys, *error.keys), what, at_value=True) from None


# --- writing


def _toml_lines(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    """Lines of a table: its own values, then its sub-tables under their headers."""
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    if path and (len(inner) < len(table) or not inner):
        yield f"\n[{'.'.join(_toml_key(key) for key in path)}]"
    for key, value in table.items():
        if key not in inner:
            yield f"{_toml_key(key)} = {_toml_value(value)}"
    for key, value in inner.items():
        if value or (path and path[0] in SISTER_TABLES):
            yield from _toml_lines(value, (*path, key))


def _toml_key(key: str) -> str:
    bare = key and key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else _toml_value(key)


def _toml_value(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return '"' + "".join(_toml_character(character) for character in value) + '"'
        case int():
            return str(value)
        case float():
            return repr(value)
        case list() | tuple():
            return "[" + ", ".join(_toml_value(item) for item in value) + "]"
        case Mapping():
            pairs = (f"{_toml_key(key)} = {_toml_value(item)}" for key, item in value.items())
            return "{" + ", ".join(pairs) + "}"
        case _:
            return str(value)  # date and time


def _toml_character(character: str) -> str:
    if character in ('"', "\\"):
        return "\\" + character
    if ord(character) < 0x20 or ord(character) == 0x7F:
        return f"\\u{ord(character):04x}"
    return character
