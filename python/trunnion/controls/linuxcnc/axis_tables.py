"""COMP_FILE tables of LinuxCNC: positioning errors of single joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import floats
from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

MAX_ROWS = 256
ARCSEC_PER_DEG = 3600.0
STEP_DEG = 5.0
"""Two waves a turn leave 0.4 % of their amplitude between nodes so far apart."""


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


@dataclass(frozen=True)
class AxisTables:
    """COMP_FILE by axis; ids of the effects that they hold; those left, with the reason."""

    files: Mapping[str, str]
    held: tuple[str, ...]
    left: Mapping[str, str]


def axis_tables(
    setup: Setup, effects: Mapping[str, Mapping[str, float]], letters: str, *, scales: bool
) -> AxisTables:
    """COMP_FILE by axis for what effects say of its positioning.

    `scales`: scales of X, Y, Z are put here, too (kinematics do not hold them).
    """
    tables: dict[str, str] = {}
    held: list[str] = []
    left: dict[str, str] = {}
    ranges, chain = setup.axis_ranges(), Chain(setup)
    senses = dict(zip("XYZ", chain.linear_senses(), strict=True))
    senses |= dict(zip(chain.letters, chain.senses, strict=True))
    for axis in "XYZ" + letters:
        mine = {k: v for k, v in effects.items() if _is_of(k, axis, scales=scales)}
        if not mine:
            continue
        limits = ranges.get(axis, (0.0, 360.0) if axis == "C" else None)
        if limits is None:
            key = "range_mm" if axis in "XYZ" else "range_deg"
            left |= dict.fromkeys(mine, f"its table needs [axes.{axis}] {key}")
            continue
        count = 2 if axis in "XYZ" else int(np.ceil((limits[1] - limits[0]) / STEP_DEG)) + 1
        if count > MAX_ROWS:
            left |= dict.fromkeys(
                mine, f"[axes.{axis}] range_deg needs {count} rows, LinuxCNC reads {MAX_ROWS}"
            )
            continue
        frame = np.linspace(*limits, count)
        sense = senses[axis]
        if axis in "XYZ":
            # Ranges are the ball's centre in the machine frame; joints count from their own zero.
            origin = (setup.control.centre_mm or (0.0, 0.0, 0.0))["XYZ".index(axis)]
            joint, error, width = origin + sense * frame, *_linear(mine, axis, sense * frame)
        else:
            joint, (error, width) = frame, _rotary(mine, axis, sense * frame)
            error = sense * error
        order = np.argsort(joint)
        joint, error = joint[order], error[order]
        held += mine
        tables[axis] = comp_file(joint, joint + error - width / 2, joint + error + width / 2)
    return AxisTables(tables, tuple(held), left)


def _is_of(effect: str, axis: str, *, scales: bool) -> bool:
    low = axis.lower()
    if axis in "XYZ":
        return effect == f"backlash_{low}" or (scales and effect == f"scale_{low}")
    turns = ("positioning", "positioning_2", "scale", "backlash")
    return effect in {f"{low}_{name}" for name in turns}


def _linear(
    effects: Mapping[str, Mapping[str, float]], axis: str, position: Floats
) -> tuple[Floats, float]:
    """Error at positions in the control's sense, mm, and width of the reversal."""
    ppm = effects.get(f"scale_{axis.lower()}", {}).get("ppm", 0.0)
    width = effects.get(f"backlash_{axis.lower()}", {}).get("b_um", 0.0)
    return 1e-6 * ppm * position, 1e-3 * width


def _rotary(
    effects: Mapping[str, Mapping[str, float]], axis: str, turn_deg: Floats
) -> tuple[Floats, float]:
    """Error of a rotary axis at turns of the machine's sense, degrees, and its reversal."""
    low, c = axis.lower(), np.radians(turn_deg)
    error = np.zeros_like(c)
    for n, name in ((1, f"{low}_positioning"), (2, f"{low}_positioning_2")):
        wave = effects.get(name, {})
        error += wave.get(f"a{n}_arcsec", 0.0) * (np.cos(n * c) - 1.0)
        error += wave.get(f"b{n}_arcsec", 0.0) * np.sin(n * c)
        error += wave.get("k_arcsec", 0.0) * np.sin(c)
    error += effects.get(f"{low}_scale", {}).get("k_arcsec", 0.0) * turn_deg / 90.0
    width = effects.get(f"{low}_backlash", {}).get("b_arcsec", 0.0)
    return error / ARCSEC_PER_DEG, width / ARCSEC_PER_DEG
