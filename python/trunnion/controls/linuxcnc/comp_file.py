"""COMP_FILE tables of LinuxCNC: positioning errors of single joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import floats, whole
from trunnion.base.errors import InputError
from trunnion.controls.axis_tables import AxisTables
from trunnion.controls.linuxcnc.present import MM
from trunnion.data.iso230_2 import CompensationTable
from trunnion.setup import Setup

COMP = "comp_{}.txt"
"""Name of the file of a table."""
MAX_ROWS = 256
TURN_DEG = 360.0


@checked
def comp_file(nominal: ArrayLike, forward: ArrayLike, reverse: ArrayLike) -> str:
    """COMP_FILE of type 0: nominal position, actual position forward and in reverse.

    Parameters
    ----------
    nominal
        Positions of the joint, ascending, mm or degrees, shape (n,); at most 256.
    forward, reverse
        Where the joint really is when it is sent there in the positive and in the negative sense.

    Notes
    -----
    LinuxCNC stops reading at the first line that is not three numbers, so the file has no comments.
    BACKLASH of the joint is ignored while it has a COMP_FILE: the difference of the columns is it.

    Raises
    ------
    InputError
        More rows than LinuxCNC reads, positions that do not ascend, columns of different length.
    """
    columns = [floats("nominal", nominal), floats("forward", forward), floats("reverse", reverse)]
    rows = {column.shape for column in columns}
    if len(rows) != 1 or columns[0].ndim != 1:
        raise InputError(f"COMP_FILE: got columns of shapes {rows}, expected one length")
    if not 2 <= len(columns[0]) <= MAX_ROWS:
        raise InputError(f"COMP_FILE: got {len(columns[0])} rows, expected 2 to {MAX_ROWS}")
    if not np.all(np.diff(columns[0]) > 0):
        raise InputError("COMP_FILE: got positions that do not ascend, expected ascending ones")
    lines = [" ".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def comp_lines(coordinates: str, tables: AxisTables) -> list[str]:
    """Lines of the INI file that load the tables; `coordinates`: letters of the joints."""
    lines = []
    for table in tables.tables:
        section = f"[JOINT_{coordinates.index(table.over)}]"
        lines += [section, f"COMP_FILE = {COMP.format(table.name)}", "COMP_FILE_TYPE = 0"]
    return lines


def table_files(setup: Setup, tables: AxisTables, name: str) -> dict[str, str]:
    """COMP_FILE of each table in units of the machine; `name` with a place for the table's."""
    files = {}
    for table in tables.tables:
        unit = MM[setup.control.linear_units] if table.unit == "mm" else 1.0
        columns = (table.nodes, table.nodes + table.forward, table.nodes + table.reverse)
        files[name.format(table.name)] = comp_file(*(column / unit for column in columns))
    return files


@checked
def measured_comp_file(table: CompensationTable, *, turns: int = 0) -> str:
    """COMP_FILE of a measured axis: corrections by target and direction of approach.

    Parameters
    ----------
    table
        Of a positioning measurement: ``iso230_2().compensation_table()``; targets are positions of
        the joint as LinuxCNC counts them.
    turns
        Of a rotary axis that is not wrapped: repeat the table over so many turns to either side, as
        a Pocket NC needs it for B.

    Raises
    ------
    InputError
        Turns of a linear axis; more rows than LinuxCNC reads: fewer turns or fewer targets.
    """
    rotary = table.unit == "arcsec"
    whole("turns", turns, 0)
    if turns and not rotary:
        raise InputError(f"turns: got {turns} for an axis in mm, expected 0")
    size = 1 / 3600.0 if rotary else 1e-3
    columns = np.column_stack([table.targets, table.forward * size, table.backward * size])
    if turns:
        columns = columns[columns[:, 0] < columns[0, 0] + TURN_DEG - 1e-9]
        offsets = TURN_DEG * np.arange(-turns, turns + 1)
        count = len(columns) * len(offsets)
        if count > MAX_ROWS:
            most = MAX_ROWS // len(offsets)
            raise InputError(
                f"turns: got {turns} either way with {len(columns)} targets a turn, {count} rows, "
                f"expected at most {MAX_ROWS}: {most} targets a turn, or a wrapped axis "
                "(WRAPPED_ROTARY) and no turns"
            )
        columns = np.concatenate([columns + np.array([offset, 0.0, 0.0]) for offset in offsets])
    nominal, forward, backward = columns.T
    return comp_file(nominal, nominal - forward, nominal - backward)
