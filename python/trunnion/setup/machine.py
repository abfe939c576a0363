"""``[machine]`` and ``[axes.X]``: which axes a machine has and where they are."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import trunnion._core as _core
from trunnion.base.checks import entry, named, positive, within
from trunnion.base.errors import InputError, UnknownNameError
from trunnion.base.frozen import FrozenMapping
from trunnion.base.units import unit_of
from trunnion.setup.fields import COORDINATE, Choice, Number, Part, Sign, Vector, key
from trunnion.setup.machines import CHAIN, DIRECTION, Description, check_error, presets
from trunnion.setup.names import canonical_error_name

DEFAULT_PRESET = "trt-ca"
ANGLE = Number(-1e5, 1e5)
MAX_ERROR = {"µm": 1e5, "arcsec": 648_000.0}
"""Location errors beyond a tenth of a metre or half a turn are typos."""


@dataclass(frozen=True)
class _LocationErrors:
    """Location errors by name, in any spelling."""

    words: str = "a table of location errors, µm and arcsec"
    positive: bool = False

    def __call__(self, what: str, value: Any) -> FrozenMapping[float]:
        errors: dict[str, float] = {}
        for spelling, size in named(what, value, self.words).items():
            with entry(spelling):
                name = _canonical(what, spelling)
                if name in errors:
                    raise InputError(f"{what}.{name}: got {spelling!r}, expected each error once")
                limit = MAX_ERROR[unit_of(name)]
                full = f"{what}.{name}"
                if self.positive:
                    positive(full, size)
                errors[name] = within(full, size, -limit, limit, unit_of(name))
        return FrozenMapping(errors)


def _canonical(what: str, spelling: str) -> str:
    try:
        return canonical_error_name(spelling)
    except UnknownNameError as error:
        raise UnknownNameError(f"{what}: {error}") from None


@dataclass(frozen=True)
class Machine(Part):
    """Chain of axes and what is known of its location errors (µm, arcsec; part of the model).

    The chain is that of a `preset` (``trt-ca`` unless said; docs/explanation/conventions.md) or a
    kinematic code of ISO 10791-6, from the workpiece over the bed to the tool: `chain` =
    ``[w C' A' b X Y Z (C) t]``. Where its axes are not along X, Y, Z or not through the origin, the
    tables ``[axes.A]`` say so (`AxisSetup`). `table_normal` is that of the table top, on which the
    artefact stands, at zero of all axes.

    `errors` are part of the nominal model: results are totals that include them, a plan goes by
    them.
    `tolerance`: of location errors by name, above 0; a diagnosis
    states biases in units of it.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.Machine("trt-ca", errors={"EX0C": 12.5}).errors["EX0C"]
    12.5
    """

    table: ClassVar[str] = "machine"
    preset: str | None = key(None, Choice(tuple(presets())), "machine by name; else trt-ca")
    errors: Mapping[str, float] = key(FrozenMapping({}), _LocationErrors(), "errors known before")
    tolerance: Mapping[str, float] = key(
        FrozenMapping({}), _LocationErrors(positive=True), "tolerances of location errors"
    )
    chain: str | None = key(None, CHAIN, "axes from workpiece to tool, instead of a preset")
    table_normal: tuple[float, float, float] | None = key(
        None, DIRECTION, "of the table top at zero of all axes; else Z, or the preset's"
    )

    def __post_init__(self) -> None:
        """Check every field, and that the machine has these errors."""
        super().__post_init__()
        if self.preset is None and self.chain is None:
            object.__setattr__(self, "preset", DEFAULT_PRESET)
        if self.preset is not None and self.chain is not None:
            raise self.refuse("chain", f"none beside preset = {self.preset!r}: give one of the two")
        with entry("table_normal"):
            machine = self.description().core(1.0)
        # Which components are redundant depends on the directions of the axes: `Setup` checks it.
        self.check_errors(machine, dict(machine.redundant_errors))

    @property
    def name(self) -> str:
        """Name of the preset, or the kinematic code."""
        return self.preset or self.chain or DEFAULT_PRESET

    def description(self) -> Description:
        """Return where the axes are, without what ``[axes.X]`` says."""
        if self.preset is None:
            known = Description(chain=self.chain or "")
        else:
            known = presets()[self.preset]
        return (
            known if self.table_normal is None else replace(known, table_normal=self.table_normal)
        )

    def check_errors(self, machine: _core.Machine, allowed: Container[str] = ()) -> None:
        """Refuse errors and tolerances that a machine has not, but for those that are allowed."""
        for table in ("errors", "tolerance"):
            for name in getattr(self, table):
                with entry(table, name):
                    if name in allowed:
                        continue
                    check_error(f"machine.{table} of {self.name}", name, machine)


@dataclass(frozen=True)
class AxisSetup(Part):
    """One axis. `sense` -1: the control counts it against the right-handed turn of the table.

    `point_mm` says where a rotary axis nominally is: any point of it at zero of all axes, in the
    machine frame, whose origin is the centre of the table top, on the axis of the table. A
    trunnion whose A axis lies 30 mm below the table top and 5 mm towards +Y has (0, 5, -30). The
    axes of a head go through the pivot at (0, 0, probe.length_mm) unless they have a point. Linear
    axes are along X, Y, Z of the machine frame: these directions define it.

    `direction` is that of a rotary axis at zero of all axes, of any length, where it is not along
    the X, Y or Z of its letter: a nutating axis at 45° in the YZ plane has (0, 1, 1).

    A plan or program with a move beyond `range_mm` (linear axes: the ball's centre in the machine
    frame) or `range_deg` (rotary axes: as the control counts) is refused.

    Examples
    --------
    >>> import trunnion as tn
    >>> axis = tn.AxisSetup(point_mm=(0.0, 5.0, -30.0))
    >>> tn.Setup(tn.Artefact("cross"), axes={"A": axis}).axis_points()
    {'A': (0.0, 5.0, -30.0)}
    """

    table: ClassVar[str] = "axes"
    sense: int = key(1, Sign(), "-1: the control counts the axis the other way round")
    point_mm: tuple[float, float, float] | None = key(
        None, Vector(3, COORDINATE), "nominal point of a rotary axis; else through the origin"
    )
    range_mm: tuple[float, float] | None = key(
        None, Vector(2, COORDINATE), "lowest and highest position of a linear axis, machine frame"
    )
    range_deg: tuple[float, float] | None = key(
        None, Vector(2, ANGLE), "lowest and highest position of a rotary axis"
    )
    direction: tuple[float, float, float] | None = key(
        None, DIRECTION, "of a rotary axis at zero; else along X, Y or Z, or the preset's"
    )
