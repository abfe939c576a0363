"""Corrections in the terms of a Pocket NC: homing offsets and tables of its axes.

Its pocketnckins turn about the machine's zero, through which both axes go: B carries the table and
A carries B. They have no parameter, so the zero itself is moved to where the axes are, by
HOME_OFFSET in CalibrationOverlay.inc, which its Settings merge into the INI file.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.compensation.machine import MachineErrors
from trunnion.compensation.parameters import CncParameters, cnc_parameters
from trunnion.controls.axis_tables import AxisTables
from trunnion.controls.files import Setting
from trunnion.controls.links import links, table_centre
from trunnion.controls.linuxcnc.comp_file import table_files
from trunnion.controls.linuxcnc.made import Made
from trunnion.controls.linuxcnc.present import MM, Present
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

KINS = "pocketnckins"
OVERLAY = "CalibrationOverlay.inc"
SHOWN_UM = 0.05
APART_MM = 1e-3
"""How far the nominal axes may be from the machine's zero."""


def check_pocketnc(setup: Setup) -> None:
    """Raise InputError for a machine whose nominal axes do not meet in the machine's zero."""
    place = table_centre(setup) + Chain(setup).linear_senses() * _nominal(setup)
    if np.abs(place).max() > APART_MM:
        said = ", ".join(f"{value:g}" for value in place)
        raise InputError(
            f"{KINS}: got axes that meet in ({said}) mm of the machine coordinates, expected "
            "(0, 0, 0), about which they turn: [control] centre_mm and [axes.A] point_mm"
        )


def pocketnc(
    setup: Setup, known: MachineErrors, tables: AxisTables, now: Present
) -> tuple[CncParameters, Made]:
    """Homing offsets that put the machine's zero on both axes, and their zeros; tables as they are.

    known: Without what the tables hold.

    Raises InputError: no present HOME_OFFSET to start from.
    """
    found = cnc_parameters(setup, known)
    centres = dict(found.centres_um)
    # One zero for both axes: half of what A and B lie apart is left to each.
    middle = 0.5 * (centres["EZ0A"] + centres["EZ0B"])
    apart = abs(centres["EZ0B"] - centres["EZ0A"])
    centres |= {"EZ0A": middle, "EZ0B": middle}
    found = replace(found, centres_um=centres)
    shift = 1e-3 * np.array([centres["EX0B"], centres["EY0A"], middle])
    # Readings at which the axes are at their true zero.
    turns = [found.zeros_arcsec[letter] / 3600.0 for letter in "AB"]
    moves = [*(Chain(setup).linear_senses() * shift), *turns]
    homes = list(_homes(setup, moves, now))
    sections = {one.name.partition(" ")[0]: [f"HOME_OFFSET={one.new:.6f}"] for one in homes}
    comp = table_files(setup, tables, "{}.comp")
    for table in tables.tables:
        lines = sections[f"[JOINT_{'XYZAB'.index(table.over)}]"]
        lines += [] if table.over in "AB" else [f"COMP_FILE={table.name}.comp"]
        lines.append("COMP_FILE_TYPE=0")
    overlay = "\n".join("\n".join([name, *lines, ""]) for name, lines in sections.items())
    left = (
        (f"EZ0B - EZ0A ({apart:.1f} µm: {KINS} has one zero for both axes)",)
        if apart > SHOWN_UM
        else ()
    )
    notes = (
        f"Take the lines of {OVERLAY} over into the machine's own, a.comp and b.comp into the "
        "folder beside it; home the machine, measure tools again, run sign_test.ngc.",
    )
    return found, Made({OVERLAY: overlay, **comp}, tuple(homes), found, notes, left)


def _nominal(setup: Setup) -> Floats:
    """Where the nominal axes come nearest to each other: x, z of B and y of A; mm."""
    a, b = links(setup).table
    if abs(b.offset[2]) > APART_MM:
        raise InputError(
            f"{KINS}: got A and B {abs(b.offset[2]):g} mm apart in Z, expected axes that meet"
        )
    return np.array([a.offset[0] + b.offset[0], a.offset[1], a.offset[2]])


def _homes(setup: Setup, moves: Iterable[float], now: Present) -> Iterable[Setting]:
    """HOME_OFFSET of each joint: what is subtracted from all its readings."""
    units = setup.control.linear_units
    for joint, (letter, move) in enumerate(zip("XYZAB", moves, strict=True)):
        section = f"JOINT_{joint}"
        old = now.keys.get((section, "HOME_OFFSET"))
        if old is None:
            raise InputError(
                f"[{section}] HOME_OFFSET: got no present value, expected one: --present with the "
                f"machine's {OVERLAY} and PocketNC.ini"
            )
        linear = letter in "XYZ"
        yield Setting(
            f"[{section}] HOME_OFFSET", OVERLAY, units if linear else "deg", old,
            old - (move / MM[units] if linear else move),
            f"zero of {letter} on the axes" if linear else f"zero of {letter}",
            "a larger offset makes every reading larger",
        )  # fmt: skip
