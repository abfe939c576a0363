"""Corrections in the terms of kinematics that know no tilts: xyzac-trt-kins and the like."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from trunnion.base.errors import InputError
from trunnion.compensation.machine import MachineErrors
from trunnion.compensation.parameters import CncParameters, cnc_parameters
from trunnion.controls.axis_tables import AxisTables, axis_tables
from trunnion.controls.files import Setting
from trunnion.controls.forecast import left_between, table_settings
from trunnion.controls.linuxcnc.comp_file import COMP, MAX_ROWS, comp_lines, table_files
from trunnion.controls.linuxcnc.made import HAL, INI, Made
from trunnion.controls.linuxcnc.pocketnc import KINS, check_pocketnc, pocketnc
from trunnion.controls.linuxcnc.present import MM, Present
from trunnion.controls.screws import table_letters
from trunnion.machine.chain import Chain
from trunnion.setup import Setup
from trunnion.setup.control import WORK_OFFSETS

STOCK = {"AC": "xyzac-trt-kins", "BC": "xyzbc-trt-kins", "AB": KINS}


def check_stock(setup: Setup) -> None:
    """Raise InputError for a machine that none of them holds."""
    letters = table_letters(setup, "kinematics that come with LinuxCNC")
    if letters == "AB":
        check_pocketnc(setup)
        return
    if len(set(Chain(setup).senses.tolist())) > 1:
        raise InputError(
            f"{STOCK[letters]}: got axes of different senses, expected one: it has one pin for both"
        )
    other = [f"axes.{x}.sense" for x in "XYZ" if Chain(setup).sense_of(x) < 0]
    if other:
        raise InputError(
            f"{STOCK[letters]}: got {', '.join(other)} = -1, expected 1: it turns about axes that "
            "count as those of the machine frame; --kinematics component holds this machine"
        )


def stock(setup: Setup, known: MachineErrors, now: Present) -> Made:
    """Corrections for kinematics that know no tilts: parameters, and tables of single axes."""
    tables = axis_tables(setup, known.effects, max_rows=MAX_ROWS, scales=True, squareness=False)
    rest = {k: v for k, v in known.effects.items() if k not in tables.held}
    remaining = replace(known, effects=rest)
    if Chain(setup).letters == "AB":
        found, made = pocketnc(setup, remaining, tables, now)
        names = "{}.comp"
    else:
        found, made = _rotation_points(setup, remaining, tables, now)
        names = COMP
    kins = STOCK[Chain(setup).letters]
    left = tuple(
        f"{row.name} ({row.share_left:.0%} stays: {kins} has no direction of an axis)"
        for row in found.removable
        if row.share_left > 0.02
        and abs(_size(remaining, row.name)) > 0
        and row.name.partition(".")[0] not in tables.left
    )
    settings = table_settings(tables.tables, {t.name: names.format(t.name) for t in tables.tables})
    return replace(
        made,
        settings=(*made.settings, *settings),
        left_out=(*left, *made.left_out),
        reasons=tables.left,
        between=left_between(tables.tables, 1e-6),
        remaining=remaining,
    )


def _rotation_points(
    setup: Setup, known: MachineErrors, tables: AxisTables, now: Present
) -> tuple[CncParameters, Made]:
    """Rotation points, offsets and zeros for the kinematics that come with LinuxCNC.

    The C axis goes through the rotation point; the tilting axis lies `offset` from it.

    known: Without what the tables hold.
    """
    letters = Chain(setup).letters
    kins = STOCK[letters]
    unit = setup.control.linear_units
    found = cnc_parameters(setup, known)
    shift = found.centres_um
    tilt = letters[0]
    across = "Y" if tilt == "A" else "X"
    centre = np.array(setup.control.centre_mm or (0.0, 0.0, 0.0))
    point = setup.axis_points().get(tilt, (0.0, 0.0, 0.0))
    moved = {axis: shift.get(f"E{axis}0C", 0.0) for axis in "XY"} | {
        "Z": shift.get(f"EZ0{tilt}", 0.0)
    }
    pins = {
        "x-rot-point": centre[0] + 1e-3 * moved["X"],
        "y-rot-point": centre[1] + 1e-3 * moved["Y"],
        "z-rot-point": centre[2],
        f"{across.lower()}-offset": point["XYZ".index(across)]
        + 1e-3 * (shift.get(f"E{across}0{tilt}", 0.0) - moved[across]),
        "z-offset": point[2] + 1e-3 * moved["Z"],
    }
    settings = [
        Setting(
            f"{kins}.{pin}", HAL, unit, now.pins.get(f"{kins}.{pin}"), float(value) / MM[unit],
            "rotation point" if "rot" in pin else "tilting axis less rotation point",
            f"towards +{pin[0].upper()} of the machine", _absorbed(known, shift, pin[0].upper()),
        )
        for pin, value in pins.items()
    ]  # fmt: skip
    homes = _homes(letters, found.zeros_arcsec, now)
    offset = centre + 1e-3 * np.array([moved[axis] for axis in "XYZ"])
    number = WORK_OFFSETS.index(setup.control.wcs) + 1
    work = f"G10 L2 P{number} X{offset[0]:.4f} Y{offset[1]:.4f} Z{offset[2]:.4f}"
    hal = [f"setp {one.name} {one.new:.6f}" for one in settings]
    senses = set(Chain(setup).senses.tolist())
    ini = _joined(homes) + "\n".join([*comp_lines("XYZ" + letters, tables), ""])
    files = {
        HAL: "\n".join(hal) + "\n",
        INI: ini,
        **table_files(setup, tables, COMP),
        "work_offset.ngc": f"({setup.control.wcs} to the table as estimated)\nG21\n{work}\nM2\n",
    }
    directions = (
        f"{kins} of LinuxCNC 2.10 has a pin conventional-directions: "
        f"{'true' if senses == {-1} else 'false'} for this set-up."
    )
    if senses == {-1}:
        directions += " Without it the kinematics count the other way, and no number here is right."
    unknown = [one.name for one in homes if one.old is None]
    notes = [directions, "Home the rotary axes after a change of HOME_OFFSET; run sign_test.ngc."]
    if unknown:
        said = ", ".join(unknown)
        notes.append(f"{said}: the present value is not known (--present) and taken as 0.")
    return found, Made(files, tuple(settings + homes), found, tuple(notes))


def _absorbed(known: MachineErrors, shift: Mapping[str, float], axis: str) -> str:
    """Return what of a centre is the estimate, and what absorbs part of the tilts."""
    parts = [
        f"{name} {known.errors.get(name, 0.0):+.1f} µm, tilts "
        f"{value - known.errors.get(name, 0.0):+.1f} µm"
        for name, value in shift.items()
        if name[1] == axis and abs(value - known.errors.get(name, 0.0)) > 0.05
    ]
    return "; ".join(parts)


def _homes(letters: str, zeros_arcsec: Mapping[str, float], now: Present) -> list[Setting]:
    """Offsets of homing with the zeros of the rotary axes: they add to the present ones."""
    homes = []
    for i, letter in enumerate(letters):
        section = f"JOINT_{3 + i}"
        for key in ("HOME_OFFSET", "HOME"):
            old = now.keys.get((section, key))
            new = (old or 0.0) - zeros_arcsec[letter] / 3600.0
            said = f"zero of {letter}, subtracted"
            sign = "a larger offset turns the axis back"
            homes.append(Setting(f"[{section}] {key}", INI, "deg", old, new, said, sign))
    return homes


def _size(known: MachineErrors, name: str) -> float:
    effect, _, parameter = name.partition(".")
    return known.effects.get(effect, {}).get(parameter, 0.0) or known.errors.get(name, 0.0)


def _joined(homes: Iterable[Setting]) -> str:
    """Keys under their sections."""
    sections: dict[str, list[str]] = {}
    for one in homes:
        section, _, key = one.name.partition(" ")
        sections.setdefault(section, []).append(f"{key} = {one.new:.6f}")
    return "\n".join("\n".join([section, *lines]) for section, lines in sections.items()) + "\n"
