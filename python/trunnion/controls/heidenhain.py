"""Heidenhain: kinematics table old and new, *.COM tables of axes and their assignment *.CMA.

Columns of *.COM and *.CMA: technical manual of the MANUALplus 620, pages 716 and 718. Counts of
entries: iTNC 530 HSCI, pages 680 and 686.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trunnion.base.arguments import checked
from trunnion.compensation.machine import Known, MachineErrors
from trunnion.controls.axis_tables import AxisTable, AxisTables, axis_tables
from trunnion.controls.files import ControlFiles, Setting
from trunnion.controls.forecast import control_files, known_errors, left_between, table_settings
from trunnion.controls.screws import Side, Step, check_directions, steps, turned_round
from trunnion.controls.stated import Need, lines, take
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

MAX_ROWS = 256
PLACES = 6
CHAIN = Need(
    "chain_sign", ("1", "-1"),
    "1: the kinematics table leads from the machine to the work table (and to the tool), each step "
    "moving the frame, -1: the other way",
)  # fmt: skip
COM = Need(
    "com_sign", ("1", "-1"),
    "1: *.COM takes the error (actual less set position), -1: the correction",
)  # fmt: skip


@checked
def heidenhain_files(
    setup: Setup,
    estimate: Known,
    *,
    stated: Mapping[str, str] | None = None,
    any_size: bool = False,
    seed: int = 0,
) -> ControlFiles:
    """Values for Heidenhain controls: kinematics old and new, *.COM and *.CMA tables.

    Parameters
    ----------
    setup, estimate
        The machine (any axes along X, Y and Z) with `[control] centre_mm`, for a head `pivot_mm`,
        and what a measurement says of it.
    stated
        `chain_sign`; with scale, squareness or positioning also `com_sign`: the public
        documentation does not say them.
    any_size
        Write location errors beyond 2 mm or 1°, too.
    seed
        Of the draws for the interval.

    Raises
    ------
    InputError
        Something that must be stated is not; an oblique axis; no `centre_mm`, no `pivot_mm`.
    DataError
        An error that the measurement does not identify.
    """
    control = "Heidenhain"
    known = known_errors(setup, estimate, any_size=any_size)
    check_directions(setup, control)
    found = axis_tables(setup, known.effects, max_rows=MAX_ROWS, scales=True, squareness=True)
    rotary = Chain(setup).letters
    needs = ((CHAIN,) if rotary else ()) + ((COM,) if found.tables else ())
    said = take(control, stated, needs)
    by_file = _kinematics(setup, known, int(said.get("chain_sign", "1")))
    settings = [one for listed in by_file.values() for one in listed]
    files = {
        **{name: _text(listed, said) for name, listed in by_file.items()},
        **_com(found, int(said.get("com_sign", "1"))),
    }
    where = {t.name: f"{t.over.lower()}.com" for t in found.tables}
    count = sum(1 for one in settings if one.name.split()[1] in "XYZABC")
    notes = (
        ()
        if not rotary
        else (
            f"The kinematics table gets {count} entries (X, Y, Z, A, B, C); a control takes 50 in "
            "COORD, steps of zero can be left out.",
            "The tool direction is not corrected.",
        )
    )
    return control_files(
        setup, estimate, known, control, files,
        [*settings, *table_settings(found.tables, where)], known.only(found.held),
        reasons=found.left, between=left_between(found.tables, 0.5 * 10.0**-PLACES),
        notes=notes, seed=seed,
    )  # fmt: skip


def _kinematics(setup: Setup, known: MachineErrors, sign: int) -> dict[str, list[Setting]]:
    """Kinematics of the sides of the table and of the tool that have axes, by file."""
    sides = Chain(setup).sides.values()
    made = {}
    if "table" in sides:
        made["kinematics.csv"] = _steps(setup, known, sign, "kinematics.csv", "table")
    if "head" in sides:
        made["kinematics_head.csv"] = _steps(setup, known, sign, "kinematics_head.csv", "head")
    return made


def _steps(setup: Setup, known: MachineErrors, sign: int, where: str, side: Side) -> list[Setting]:
    mirror = turned_round(setup)
    before, after = (
        [replace(step, value=step.value * mirror[step.key]) for step in steps(setup, each, side)]
        for each in (MachineErrors(), known)
    )
    pairs = list(zip(before, after, strict=True))
    if sign < 0:
        pairs.reverse()
    made = []
    for number, (old, new) in enumerate(pairs, start=1):
        unit = "" if new.is_axis else "mm" if new.key in "XYZ" else "deg"
        what = f"axis {new.key}" if new.is_axis else new.key
        made.append(
            Setting(
                f"{number} {what}", where, unit,
                old.value if new.is_axis else sign * old.value,
                new.value if new.is_axis else sign * new.value,
                _meaning(new), "" if new.is_axis else f"along or right-handed about +{new.key}",
                _why(old, new),
            )
        )  # fmt: skip
    return made


def _meaning(step: Step) -> str:
    if step.is_axis:
        return "rotary axis; the value is its sense"
    return "shift" if step.key in "XYZ" else "fixed turn"


def _why(old: Step, new: Step) -> str:
    same = new.is_axis or abs(new.value - old.value) < 1e-12
    return "" if same else "less what the axis that carries it has already"


def _text(settings: Sequence[Setting], said: Mapping[str, str]) -> str:
    rows = [
        *lines(said, "#"),
        "# each row moves the frame of the rows before; mm, degrees",
        "step,old,new",
        *(f"{s.name},{s.old:.{PLACES + 3}f},{s.new:.{PLACES + 3}f}" for s in settings),
    ]
    return "\n".join(rows) + "\n"


def _com(found: AxisTables, sign: int) -> dict[str, str]:
    """One *.COM for each axis that moves, a column for each axis that it displaces; *.CMA."""
    groups: dict[str, list[AxisTable]] = {}
    for table in found.tables:
        groups.setdefault(table.over, []).append(table)
    files = {f"{over.lower()}.com": _columns(tables, sign) for over, tables in groups.items()}
    if files:
        names = " ".join(f"{over.lower()}.com" for over in groups)
        files["config.cma"] = f"NR {' '.join(groups)} ACTIVE\n0 {names} *\n"
    return files


def _columns(tables: Sequence[AxisTable], sign: int) -> str:
    own = next((t for t in tables if t.width), None)
    head = ["NR", "AXISPOS", *(t.of for t in tables), *(["BACKLASH"] if own else [])]
    columns = [tables[0].nodes, *(sign * t.forward for t in tables)]
    if own is not None:
        columns.append(sign * own.reverse)
    rows = np.column_stack(columns)
    body = (f"{i} " + " ".join(f"{v:.{PLACES}f}" for v in row) for i, row in enumerate(rows))
    return "\n".join([" ".join(head), *body]) + "\n"
