"""What the tables of a set-up say of one another: none contradicts another or is for nothing."""

from __future__ import annotations

from dataclasses import replace
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from trunnion.base.checks import entry
from trunnion.base.errors import InputError
from trunnion.setup.fields import keys_of
from trunnion.setup.write import PROCESS_TABLES

if TYPE_CHECKING:
    from trunnion.setup.machine import AxisSetup
    from trunnion.setup.parts import Setup


def check(setup: Setup) -> None:
    """Refuse a set-up with tables that do not go together, or with a process that is not valid."""
    _check_axes(setup)
    for axis, given in setup.axes.items():
        _check_range(axis, given)
    _check_control(setup)
    _check_probe(setup)
    for name, reader in PROCESS_TABLES.items():
        if getattr(setup, name):
            resolve_name(reader)(setup)


def _check_control(setup: Setup) -> None:
    """Refuse a key of `[control]` for what the machine has not."""
    control, machine = setup.control, setup.description().core(setup.probe.length_mm)
    usual = keys_of(type(control))["centre_tolerance_mm"].default
    with entry("control"):
        if control.pivot_mm is not None and "head" not in machine.sides:
            raise control.refuse("pivot_mm", f"none: machine {setup.machine.name} has no head")
        if control.centre_mm is None and control.centre_tolerance_mm != usual:
            raise control.refuse("centre_mm", "the place that centre_tolerance_mm is about")


def _check_probe(setup: Setup) -> None:
    """Refuse to state where the ball stands where an axis turns it: it then stands elsewhere."""
    probe = setup.probe
    if "head" not in setup.description().core(probe.length_mm).sides:
        return
    with entry("probe"):
        for name in ("offset_std_um", "length_std_um"):
            if getattr(probe, name):
                raise probe.refuse(name, f"0: machine {setup.machine.name} turns the probe")


def _check_axes(setup: Setup) -> None:
    """Refuse axes that the machine has not, and what an axis cannot have."""
    letters = setup.machine.description().core(1.0).letters
    for axis, given in setup.axes.items():
        with entry("axes", axis):
            if axis not in "XYZ" and axis not in letters:
                has = ", ".join("XYZ" + letters)
                raise InputError(
                    f"axes.{axis}: got an axis that machine {setup.machine.name} has not, "
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
                    _check_line(setup, axis, name)
    with entry("machine"):
        setup.machine.check_errors(setup.description().core(setup.probe.length_mm))


def _check_line(setup: Setup, axis: str, name: str) -> None:
    """Let the core refuse the direction or, with its direction, the point of one axis."""
    known, given = setup.machine.description(), setup.axes[axis]
    if given.direction is not None:
        known = replace(known, directions={**known.directions, axis: given.direction})
    if name == "point_mm" and given.point_mm is not None:
        known = replace(known, points_mm={**known.points_mm, axis: given.point_mm})
    known.core(setup.probe.length_mm)


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
