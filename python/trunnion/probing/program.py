"""The probing cycle of a plan as a program for LinuxCNC.

The program runs with the work offset in the origin of the machine frame (centre of the table top),
in mm, with tool length compensation to the centre of the ball. `PROBEOPEN` logs one line a touch,
which :func:`trunnion.read_probe_log` reads together with the plan.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import trunnion._core as _core
from trunnion.base.errors import DataError, InputError
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain, standing_artefact
from trunnion.nc import Program
from trunnion.setup import Setup

BACK_OFF_DEG = 5.0

Block = str | Sequence[tuple[str, float]]


def probing_program(plan: Touches, setup: Setup, log: str = "touches.log") -> Program:
    """Write a plan as a LinuxCNC probing program.

    Each approach is a G38.2 move from its start, through the expected contact, to the overtravel
    of the set-up. Between touches the probe retracts to the start, rises along Z above everything
    on the table, crosses, and comes down; before a rotary axis turns it rises above all that
    swings. Where the plan wants an axis to come from a sense that the straight way does not have,
    the axis overshoots by 5°.

    Parameters
    ----------
    plan
        A plan with starts (from :func:`trunnion.plan`), on a machine with its rotary axes under the
        table.
    log
        File that the control writes the touches to.

    Raises
    ------
    DataError
        A plan without starts or feeds.
    InputError
        A machine with a rotary axis in its head: the way between touches would not be along Z.
    """
    starts = plan.start_mm
    if starts is None or plan.feed_mm_min is None:
        raise DataError("plan: got no starts or feeds, expected the plan of trunnion.plan")
    chain = Chain(setup)
    if setup.machine.preset == "table-c-head-b":
        raise InputError(
            "probing program: got machine table-c-head-b, expected one with its rotary axes under "
            "the table"
        )
    swing, levels = safe_levels(plan, setup)
    ends = plan.position_mm + setup.plan.overtravel_mm * plan.direction
    blocks: list[Block] = [
        "Touches of a rotary table with an artefact; origin: centre of the table top",
        [("G", 21), ("G", 90), ("G", 94)],
        [("G", 0), ("Z", swing)],
        f"PROBEOPEN {log}",
    ]
    at: dict[str, float] = {}
    for row in range(len(plan)):
        angles = {letter: float(plan.rotary_deg[letter.lower()][row]) for letter in chain.letters}
        if angles != at:
            blocks.append([("G", 0), ("Z", swing)])
            blocks.extend(_turns(plan, row, at, angles))
            at = angles
        level = levels[row]
        x, y, z = (float(value) for value in starts[row])
        blocks.append([("G", 0), ("X", x), ("Y", y)])
        blocks.append([("G", 0), ("Z", level)])
        blocks.append([("G", 0), ("Z", z)])
        end = [(axis, float(value)) for axis, value in zip("XYZ", ends[row], strict=True)]
        blocks.append([("G", 38.2), *end, ("F", float(plan.feed_mm_min[row]))])
        blocks.append([("G", 0), ("X", x), ("Y", y), ("Z", z)])
        blocks.append([("G", 0), ("Z", level)])
    blocks.extend([[("G", 0), ("Z", swing)], "PROBECLOSE", [("M", 2)]])
    return Program.from_blocks("linuxcnc", blocks)


def safe_levels(
    plan: Touches, setup: Setup
) -> tuple[float, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Z above all that swings, and Z above everything at each row's posture, mm."""
    chain = Chain(setup)
    return _core.safe_levels(
        chain.machine(),
        standing_artefact(setup),
        chain.to_machine(plan.rotary_deg, len(plan)),
        ball_radius_mm=setup.probe.ball_radius_mm,
        clearance_mm=setup.plan.clearance_mm,
        table_radius_mm=setup.table.radius_mm,
        table_thickness_mm=setup.table.thickness_mm,
    )


def _turns(
    plan: Touches, row: int, at: dict[str, float], to: dict[str, float]
) -> list[Sequence[tuple[str, float]]]:
    """Rotary moves to a position, with an overshoot where the expected sense needs one."""
    overshoot: list[tuple[str, float]] = []
    for letter, angle in to.items():
        senses = plan.rotary_dir.get(letter.lower())
        sense = 0 if senses is None else int(senses[row])
        way = angle - at.get(letter, 0.0)
        if sense and way * sense <= 0 and (way != 0 or not at):
            overshoot.append((letter, angle - sense * BACK_OFF_DEG))
    moves: list[Sequence[tuple[str, float]]] = []
    if overshoot:
        moves.append([("G", 0), *overshoot])
    moves.append([("G", 0), *to.items()])
    return moves
