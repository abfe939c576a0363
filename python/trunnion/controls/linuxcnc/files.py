"""What LinuxCNC loads to correct a machine, and a test of the signs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeAlias

from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.compensation.machine import Known, MachineErrors
from trunnion.controls.axis_tables import AxisTables, axis_tables
from trunnion.controls.files import ControlFiles, Setting
from trunnion.controls.forecast import (
    SIGNS,
    control_files,
    known_errors,
    left_between,
    table_settings,
)
from trunnion.controls.links import table_centre
from trunnion.controls.linuxcnc.comp_file import COMP, MAX_ROWS, comp_lines, table_files
from trunnion.controls.linuxcnc.kinematics import (
    PIVOT,
    component,
    held,
    is_conventional,
    joint_letters,
    pin_values,
)
from trunnion.controls.linuxcnc.linear_map import linear_map
from trunnion.controls.linuxcnc.made import HAL, INI, Made
from trunnion.controls.linuxcnc.present import Present, read_present
from trunnion.controls.linuxcnc.sign_test import sign_test
from trunnion.controls.linuxcnc.stock import STOCK, check_stock, stock
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

NAME = "trunnionkins"
Kinematics: TypeAlias = Literal["component", "stock"]


@checked
def linuxcnc_files(
    setup: Setup,
    estimate: Known,
    *,
    kinematics: Kinematics = "component",
    present: Iterable[str | Path] = (),
    any_size: bool = False,
    seed: int = 0,
) -> ControlFiles:
    """Files that correct a machine under LinuxCNC.

    Parameters
    ----------
    setup
        Machine, and ``[control] centre_mm``: where the table is in machine coordinates.
    estimate
        What a measurement says of the machine, or location errors by name (µm, arcsec).
    kinematics
        "component": a kinematics component that knows every location error, scale and squareness.
        "stock": what xyzac-trt-kins, xyzbc-trt-kins or (A carries B) the pocketnckins of a Pocket
        NC can hold: rotation points or the machine's zero, offsets, zeros, tables of single axes.
    present
        .hal, .ini and .inc files of the machine as it was when it was measured: old values beside
        the new ones, and offsets of homing are added to theirs.
    any_size
        Write location errors beyond 2 mm or 1°, too.
    seed
        Of the draws for the interval.

    Raises
    ------
    InputError
        A machine that cannot be held; no `centre_mm`; errors that are not plausible.
    DataError
        An error that the measurement does not identify.
    """
    choose("kinematics", kinematics, ("component", "stock"))
    if kinematics == "stock":
        check_stock(setup)
    known = known_errors(setup, estimate, any_size=any_size)
    now = read_present(present)
    now.check_units(setup)
    own = kinematics == "component"
    made = _component(setup, known, now) if own else stock(setup, known, now)
    return control_files(
        setup, estimate, known,
        f"LinuxCNC with {NAME if own else STOCK[Chain(setup).letters]}",
        {**made.files, **({"sign_test.ngc": sign_test(setup)} if Chain(setup).letters else {})},
        made.settings, made.held, left_out=made.left_out, reasons=made.reasons, notes=made.notes,
        between=made.between, remaining=made.remaining, seed=seed,
    )  # fmt: skip


def _component(setup: Setup, known: MachineErrors, now: Present) -> Made:
    letters = joint_letters(setup)
    grid, no_map = linear_map(setup, known)
    mapped = grid.effects if grid is not None else ()
    mine = replace(held(setup, known), own=tuple(x for x in known.own if x.id in mapped))
    tables = axis_tables(setup, known.effects, max_rows=MAX_ROWS, scales=False, squareness=False)
    pins = pin_values(setup, mine)
    settings = [
        Setting(
            f"{NAME}.{pin}", HAL, _unit(pin), now.pins.get(f"{NAME}.{pin}"), value,
            "pivot of the head to the gauge line" if pin == PIVOT else "total",
            SIGNS.get(pin[1:2].upper(), "") if pin[2:3] == "0" else "",
        )
        for pin, value in pins.items()
        if value or now.pins.get(f"{NAME}.{pin}")
    ]  # fmt: skip
    for axis, place in zip("xyz", table_centre(setup).tolist(), strict=True):
        pin = f"{NAME}.{axis}-rot-point"
        settings.append(Setting(pin, HAL, "mm", now.pins.get(pin), place, "nominal table centre"))
    comp = table_files(setup, tables, COMP)
    hal = [
        "# Pins of the kinematics component: after the line that loads it.",
        *(f"setp {one.name} {one.new:.6f}" for one in settings),
        f"setp {NAME}.conventional-directions {int(is_conventional(setup))}",
        "# Unless your configuration nets these pins already, under names of its own:",
        f"net trunnion-tool-offset motion.tooloffset.z => {NAME}.tool-offset",
        "net trunnion-kins-type motion.analog-out-03 => motion.switchkins-type",
    ]
    files = {
        f"{NAME}.comp": component(setup, mine, grid),
        HAL: "\n".join(hal) + "\n",
        INI: _ini(NAME, letters, tables),
        **{f"{code}remap.ngc": _remap(code, kind) for code, kind in _CODES},
        **comp,
    }
    notes = (
        f"1. sudo halcompile --install {NAME}.comp",
        f"2. Take the lines of {INI} over into your INI file; load {HAL} after the kinematics.",
        "3. Run sign_test.ngc: it says where a mark of the table, or the tool point, must be seen.",
        "M428: tool centre point. M429: identity, for probing and homing. M430: programs for the "
        "machine without errors. The work offset stays as it is.",
    )
    ids = {*mine.effects, *tables.held}
    return Made(
        files,
        (
            *settings,
            *([] if grid is None else [grid.setting(f"{NAME}.comp")]),
            *table_settings(tables.tables, {t.name: COMP.format(t.name) for t in tables.tables}),
        ),
        replace(mine, effects=known.only(ids).effects),
        notes=notes,
        reasons={**tables.left, **no_map},
        between={
            **left_between(tables.tables, 1e-6),
            **({} if grid is None else {"xyz map": grid.left_um}),
        },
    )


def _unit(pin: str) -> str:
    """Unit that ends the name of a pin."""
    return "mm" if pin == PIVOT else pin.rpartition("-")[2].replace("um", "µm")


_CODES = (("428", 0), ("429", 1), ("430", 2))


def _remap(code: str, kind: int) -> str:
    """M-code that switches the kinematics, and waits until they are."""
    return f"o<{code}remap> sub\nM66 L0 E0\nM68 E3 Q{kind}\nM66 L0 E0\no<{code}remap> endsub\nM2\n"


def _ini(kins: str, letters: str, tables: AxisTables) -> str:
    lines = ["[KINS]", f"KINEMATICS = {kins}", f"JOINTS = {3 + len(letters)}", "[RS274NGC]"]
    lines += [f"REMAP = M{code} modalgroup=10 ngc={code}remap" for code, _ in _CODES]
    lines += comp_lines("XYZ" + letters, tables)
    return "\n".join(lines) + "\n"
