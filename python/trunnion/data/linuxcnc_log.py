"""The probe log of LinuxCNC, read together with the plan whose program wrote it.

Between ``(PROBEOPEN file)`` and ``(PROBECLOSE)`` LinuxCNC writes one line a probing move: nine
numbers ``X Y Z A B C U V W`` with six decimals, without names. They are in the program's unit (mm
under G21, which the programs of a plan set) and in the program's coordinate system, offsets and
tool length taken off: the program has to run with its origin at that of the machine frame.

LinuxCNC leaves a line out when all nine numbers are exactly those of the touch before. The log is
then shorter than the plan and is refused, because which touch is lacking would be a guess.
"""

import re
from os import PathLike
from pathlib import Path

import numpy as np

from trunnion.base.errors import FileFormatError
from trunnion.base.units import Floats
from trunnion.data.touches import ROTARY_AXES, Touches
from trunnion.files.columns import parse_number
from trunnion.files.text import decode

NAMES = ("X", "Y", "Z", "A", "B", "C", "U", "V", "W")

ROTARY_TOLERANCE_DEG = 0.001
"""How far a logged rotary position may be from the planned one: ten steps of 0.36 arcsec."""

DISTANCE_MM = 5.0
"""How far a touch may be from the planned one; the contract's limit for touches off the surface."""


def read_probe_log(path: str | PathLike[str], plan: Touches) -> Touches:
    """Read the log of a plan's probing program: the plan with the recorded positions in it.

    Parameters
    ----------
    path
        Log written between PROBEOPEN and PROBECLOSE, mm and deg, one line a touch in the order of
        the program. Blank lines and lines that begin with ``#`` are skipped.
    plan
        The plan that the program came from. Everything but the recorded position is taken from it,
        commanded rotary positions and `time_s` (where planned) too.

    Raises
    ------
    FileFormatError
        If a line is not nine finite numbers, there are not as many as planned touches, a rotary
        position differs from the plan's by more than 0.001 deg, an axis that the plan lacks is not
        at 0, or a touch is more than 5 mm from the planned one. The message names line and column.
    """
    name = str(path)
    lines = decode(name, Path(path).read_bytes()).split("\n")
    numbers = [i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] != "#"]
    logged = np.array([_parsed(name, i, lines[i]) for i in numbers]).reshape(-1, len(NAMES))
    _same_number(name, numbers, len(lines), len(plan))

    def refuse(row: int, column: str, got: str, expected: str) -> None:
        line = numbers[row]
        at = _starts(lines[line])[NAMES.index(column)]
        raise FileFormatError(
            f"{name}:{line + 1}:{at + 1}: {column} (touch {row}): got {got}, expected {expected}"
        )

    planned = _planned_joints(plan)
    bad = np.abs(logged - planned) > ROTARY_TOLERANCE_DEG
    bad[:, :3] = False
    for row, column in np.argwhere(bad)[:1].tolist():
        letter = NAMES[column]
        there = letter.lower() in plan.rotary_deg
        why = "as planned" if there else f"as the plan has no {letter} axis"
        expected = f"{planned[row, column]:.6f} (to {ROTARY_TOLERANCE_DEG:g}), {why}"
        refuse(row, letter, f"{logged[row, column]:.6f}", expected)

    distance = np.linalg.norm(logged[:, :3] - plan.position_mm, axis=1)
    for row in np.flatnonzero(distance > DISTANCE_MM)[:1].tolist():
        x, y, z = plan.position_mm[row].tolist()
        got = f"a touch {distance[row]:.3f} mm from the planned one"
        expected = f"at most {DISTANCE_MM:g} mm from ({x:.3f}, {y:.3f}, {z:.3f})"
        refuse(row, "X", got, expected)
    x_mm, y_mm, z_mm = logged[:, :3].T
    return Touches(plan.columns).with_columns(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm)


def _parsed(name: str, index: int, line: str) -> list[float]:
    fields = line.split()
    if len(fields) != len(NAMES):
        raise FileFormatError(
            f"{name}:{index + 1}:{_starts(line)[min(len(fields), len(NAMES)) - 1] + 1}: got "
            f"{len(fields)} fields, expected nine numbers: {' '.join(NAMES)}"
        )
    values = []
    for column, (field, at) in enumerate(zip(fields, _starts(line), strict=True)):
        value = parse_number(field)
        if value is None or not np.isfinite(value):
            raise FileFormatError(
                f"{name}:{index + 1}:{at + 1}: {NAMES[column]}: got {field[:60]!r}, expected a "
                "finite number"
            )
        values.append(value)
    return values


def _starts(line: str) -> list[int]:
    return [match.start() for match in re.finditer(r"\S+", line)]


def _same_number(name: str, numbers: list[int], end: int, planned: int) -> None:
    if len(numbers) == planned:
        return
    if len(numbers) > planned:
        line, why = numbers[planned] + 1, ""
    else:
        line = numbers[-1] + 1 if numbers else end
        why = (
            "; LinuxCNC writes no line for a touch at exactly the position of the one before, and"
            " a G38.2 that touches nothing ends the program"
        )
    raise FileFormatError(
        f"{name}:{line}:1: got {len(numbers)} touches, expected {planned}, one for each touch of "
        f"the plan{why}"
    )


def _planned_joints(plan: Touches) -> Floats:
    """Return what the log should say, in its columns; X, Y and Z as planned, absent axes 0."""
    planned = np.zeros((len(plan), len(NAMES)))
    planned[:, :3] = plan.position_mm
    for axis in ROTARY_AXES:
        if axis in plan.rotary_deg:
            planned[:, NAMES.index(axis.upper())] = plan.rotary_deg[axis]
    return planned
