"""The probing cycle of a plan as a program for LinuxCNC.

What moves, in which order and how long it takes is in `trunnion.probing.cycle`, the text in
`trunnion.probing.linuxcnc`. The program runs with its work offset in the origin of the machine
frame (centre of the table top), in mm, with tool length compensation to the centre of the ball.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import trunnion._core as _core
from trunnion.base.checks import instance
from trunnion.base.errors import DataError, InputError
from trunnion.base.units import Floats
from trunnion.data.linuxcnc_log import plan_hash
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain, standing_artefact
from trunnion.nc import Program
from trunnion.probing.cycle import Cycle, Step
from trunnion.probing.linuxcnc import program_text
from trunnion.probing.model import TouchModel
from trunnion.setup import Setup

DECIMALS = 4
MAX_NAMED = 10
"""Touches that a message names."""
FILE_NAME = re.compile(r"[^()#%;,\x00-\x1f\x7f-\U0010ffff]{1,150}")


@dataclass(frozen=True, eq=False)
class ProbingProgram:
    """A probing program for LinuxCNC.

    Attributes
    ----------
    cycle
        What it does: steps, levels and speeds.
    """

    cycle: Cycle

    def __repr__(self) -> str:
        return f"<ProbingProgram: {len(self.cycle.steps)} touches, {self.seconds / 60:.1f} min>"

    def text(self) -> str:
        """Return the program as it stands in its file."""
        return program_text(self.cycle)

    @cached_property
    def moves(self) -> Program:
        """The moves of the program one after the other, without checks, for :func:`nc.follow`.

        A touch ends at the end of its search; where touches are made twice, the first pass and the
        way back are between these ends and are left out.
        """
        return Program.from_blocks("linuxcnc", self.cycle.blocks())

    @property
    def time_s(self) -> Floats:
        """When each touch triggers, s after the first cycle start; pauses are not in it, (n,)."""
        return self.cycle.times()[0]

    @property
    def seconds(self) -> float:
        """How long the program takes without pauses, s."""
        return self.cycle.times()[1]

    @property
    def plan_hash(self) -> str:
        """What the log names the plan by."""
        return self.cycle.plan_hash


def probing_program(
    plan: Touches,
    setup: Setup,
    log: str = "touches.log",
    *,
    name: str = "plan",
    start_at: int = 1,
    dry_run: bool = False,
    feed_mm_min: float | None = None,
) -> ProbingProgram:
    """Write a plan as a LinuxCNC probing program.

    Before the first move the program checks what it can of the control's state (`[control]` of the
    set-up) and stops with a message if it is not as planned. Each touch is a call of one
    subroutine: across above everything, down to the start by G38.3, which stops on contact, the
    approach through the expected contact to the overtravel of the set-up, and back up. With
    `slow_feed_mm_min` in `[plan]` it touches twice, the second time at that feed. Before a rotary
    axis turns, the probe rises above all that swings; where the plan expects an axis to come from
    another sense than that of its last turn, the axis overshoots by 5°. Paths are exact (G61).

    Parameters
    ----------
    plan
        Touches to make, on a machine with its rotary axes under the table. Without starts, the
        approaches begin at the clearance of the set-up.
    log
        File that the control appends the touches to, with the plan's hash and a number each.
    name
        Of the plan, for the header and the log.
    start_at
        Number of the first touch, from 1, to go on with a run that was stopped (``#<_from>``).
    dry_run
        Make all moves but the approaches, and log nothing (``#<_dry>``).
    feed_mm_min
        Feed of the approaches where the plan has none.

    Raises
    ------
    DataError
        A plan without feeds, and none given; a touch that ball and stem cannot make, or that finds
        nothing, with the artefact anywhere within its tolerance.
    InputError
        A machine with a rotary axis in its head: the way between touches would not be along Z;
        a name of the log that LinuxCNC cannot take; a first touch that the plan does not have.
    """
    instance("plan", plan, Touches, "Touches, as plan or read_touches gives them")
    instance("setup", setup, Setup, "a Setup, as read_setup gives it")
    if setup.machine.preset == "table-c-head-b":
        raise InputError(
            "probing program: got machine table-c-head-b, expected one with its rotary axes under "
            "the table"
        )
    if FILE_NAME.fullmatch(log) is None:
        raise InputError(
            f"log: got {log!r}, expected a file name of printable ASCII without ( ) # % ; ,"
        )
    if isinstance(start_at, bool) or not isinstance(start_at, int) or start_at < 1:
        raise InputError(f"start_at: got {start_at!r}, expected the number of a touch, from 1")
    if start_at > len(plan):
        raise InputError(f"start_at: got {start_at}, expected a touch of the plan's {len(plan)}")
    ready = _with_starts(plan, setup, feed_mm_min)
    _check_clear(ready, setup)
    swing, levels = safe_levels(ready, setup)
    cycle = Cycle(
        setup=setup,
        letters=tuple(Chain(setup).letters),
        name=re.sub(r"[^A-Za-z0-9._-]", "_", name)[:60] or "plan",
        plan_hash=plan_hash(plan),
        log=log,
        swing=_up(swing),
        steps=_steps(ready, setup, levels),
        start_at=start_at,
        dry_run=dry_run,
    )
    return ProbingProgram(cycle)


def _with_starts(plan: Touches, setup: Setup, feed: float | None) -> Touches:
    """Return the plan with starts and feeds."""
    added: dict[str, Floats] = {}
    if plan.feed_mm_min is None:
        if feed is None:
            raise DataError("plan: got no column feed_mm_min, expected it, or a feed_mm_min given")
        added["feed_mm_min"] = np.full(len(plan), float(feed))
    if plan.start_mm is None:
        starts = plan.position_mm - setup.plan.clearance_mm * plan.direction
        added |= {f"start_{axis}_mm": starts[:, i] for i, axis in enumerate("xyz")}
    return plan.with_columns(**added) if added else plan


def _check_clear(plan: Touches, setup: Setup) -> None:
    """Refuse a plan of another set-up, or of no planner, that runs into something."""
    chain, starts = Chain(setup), plan.start_mm
    assert starts is not None
    found = _core.blocked_moves(
        chain.machine(),
        standing_artefact(setup),
        TouchModel(setup).moves(plan, from_start=True),
        np.linalg.norm(plan.position_mm - starts, axis=1) + setup.plan.overtravel_mm,
        ball_radius_mm=setup.probe.ball_radius_mm,
        stem_radius_mm=setup.probe.effective_stem_radius_mm,
        stem_length_mm=setup.probe.length_mm,
        clearance_mm=setup.plan.clearance_mm,
        table_radius_mm=setup.table.radius_mm,
        table_thickness_mm=setup.table.thickness_mm,
    )
    if found:
        which = ", ".join(str(row + 1) for row in found[:MAX_NAMED])
        more = f" and {len(found) - MAX_NAMED} more" if len(found) > MAX_NAMED else ""
        artefact = setup.artefact
        raise DataError(
            f"plan: got touches that run into something or find nothing with the artefact within "
            f"{artefact.tolerance_mm:g} mm and {artefact.tolerance_deg:g} deg of its place: number "
            f"{which}{more}; expected a plan of this set-up (artefact, place, tolerance, table, "
            "probe, clearance)"
        )


def _steps(plan: Touches, setup: Setup, levels: Floats) -> tuple[Step, ...]:
    starts, feeds = plan.start_mm, plan.feed_mm_min
    assert starts is not None
    assert feeds is not None
    ends = plan.position_mm + setup.plan.overtravel_mm * plan.direction
    rotary: Mapping[str, Floats] = plan.rotary_deg
    senses = plan.rotary_dir
    steps = []
    for row in range(len(plan)):
        angles = {x.upper(): _round(float(values[row])) for x, values in rotary.items()}
        sense = {x: int(senses[x.lower()][row]) if x.lower() in senses else 0 for x in angles}
        start = tuple(_round(float(v)) for v in starts[row])
        steps.append(
            Step(
                angles=angles,
                senses=sense,
                start=start,
                contact=tuple(float(v) for v in plan.position_mm[row]),
                end=tuple(_round(float(v)) for v in ends[row]),
                level=max(_up(float(levels[row])), start[2]),
                feed=float(feeds[row]),
            )
        )
    return tuple(steps)


def _round(value: float) -> float:
    return float(round(value, DECIMALS)) + 0.0


def _up(value: float) -> float:
    return float(np.ceil(value * 1e4 - 1e-6)) / 1e4


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
