"""The probing cycle of a plan as a program for LinuxCNC.

What moves, in which order and how long it takes is in `trunnion.probing.cycle`, the text in
`trunnion.probing.linuxcnc`. The program runs with its work offset in the origin of the machine
frame (centre of the table top), in mm, with tool length compensation to the centre of the ball.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError, FileFormatError, InputError
from trunnion.base.units import Floats
from trunnion.data.frame import ControlFrame, Frame
from trunnion.data.linuxcnc_log import logged_frame, logged_touches, plan_hash
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.nc import Program
from trunnion.probing.cycle import Cycle
from trunnion.probing.linuxcnc import program_text
from trunnion.probing.linuxcnc_state import ROUNDED_DEG
from trunnion.probing.notes import check_feeds
from trunnion.probing.on_table import on_table
from trunnion.probing.steps import (
    check_clear,
    check_feeds_recorded,
    cycle_of,
    taken_by_offset,
    with_starts,
)
from trunnion.setup import Setup
from trunnion.setup.control import WORK_OFFSETS, ControlSetup

LONGEST_NAME = 150
FILE_NAME = re.compile(rf"(?! )[^()#%;,\x00-\x1f\x7f-\U0010ffff]{{1,{LONGEST_NAME}}}(?<! )")


@dataclass(frozen=True, eq=False)
class ProbingProgram:
    """A probing program for LinuxCNC.

    Attributes
    ----------
    cycle
        What it does: steps, levels and speeds.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> program = tn.probing_program(tn.plan(setup)[:4], setup)
    >>> round(program.seconds)
    31
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


@checked
def probing_program(
    plan: Touches,
    setup: Setup,
    log: str = "touches.log",
    *,
    name: str = "plan",
    start_at: int = 1,
    dry_run: bool = False,
    feed_mm_min: float | None = None,
    corrected: bool = False,
    tcp: bool = False,
    continues: str | PathLike[str] | None = None,
) -> ProbingProgram:
    """Write a plan as a LinuxCNC probing program.

    Before the first move the program checks what it can of the control's state (`[control]` of the
    set-up), stops with a message if it is not as planned, and asks (M0). It goes to the artefact
    by moves that stop on contact and touches it once from above: a top that is not where it is
    planned stops the program before anything turns. Each touch is a call of one
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
        Feed of the approaches, mm/min, of a plan without the column `feed_mm_min`.
    corrected
        Measure with the corrections on (``corrected_on`` of `[control]`, M430): what an
        identification then finds is what they leave.
    tcp
        Make the approaches with tool centre point control on (``tcp_on`` of `[control]`, M428), the
        way between them without (``tcp_off``): a ball on the table must then be at one place
        whatever A and C are (:func:`verify_ball`). The log is in the table's frame, and is read by
        :func:`read_table_log`.
    continues
        Log of the runs that this one continues, with `start_at`: before it moves, the program then
        compares its work offset and tool length with theirs, to 0.1 µm, and stops if they differ.
        Without it, it compares them with those of the plan's last run since the control was
        started; if there was none it says what to compare, and asks.

    Raises
    ------
    DataError
        A plan without feeds, and none given, or with several beside `slow_feed_mm_min`, at which
        all would be recorded; a touch that ball and stem cannot make, or that finds
        nothing, with the artefact anywhere within its tolerance; a feed at which the ball goes on
        behind the contact by more than the overtravel; a move beyond the range of an axis
        in the set-up; an axis "not turned" that turns before in the order of the plan.
    InputError
        A machine with a rotary axis in its head: the way between touches would not be along Z;
        a name of the log that LinuxCNC cannot take; a first touch that the plan does not have;
        `tcp` with `corrected`, or without ``tcp_on`` and ``tcp_off``; `continues` from touch 1.
    FileFormatError
        `continues` is not a log of this plan that says work offset and tool length.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> program = tn.probing_program(tn.plan(setup), setup)
    >>> print(program.text().splitlines()[1])
    (machine trt-ca, cross, ball radius 1 mm, clearance 5 mm)
    """
    chain = Chain(setup)
    if "head" in chain.sides.values():
        raise InputError(
            f"probing program: got {chain.name}, expected one with its rotary axes under the table"
        )
    _check_log(log)
    if isinstance(start_at, bool) or not isinstance(start_at, int) or start_at < 1:
        raise InputError(f"start_at: got {start_at!r}, expected the number of a touch, from 1")
    if start_at > len(plan):
        raise InputError(f"start_at: got {start_at}, expected a touch of the plan's {len(plan)}")
    ready = with_starts(plan, setup, feed_mm_min)
    check_clear(ready, setup)
    if ready.feed_mm_min is not None:
        check_feeds_recorded(ready.feed_mm_min.tolist(), setup)
        check_feeds(ready.feed_mm_min.tolist(), setup)
    frame = _frame(setup, corrected=corrected, tcp=tcp)
    named = on_table(plan, setup) if tcp else plan
    if continues is not None and start_at == 1:
        raise InputError(
            "continues: got it with start_at = 1, which begins a new measurement; expected a "
            "later start_at, the touch from which the runs of that log are continued"
        )
    cycle = replace(
        cycle_of(ready, setup),
        name=_in_a_comment(name) or "plan",
        plan_hash=plan_hash(named),
        log=log,
        start_at=start_at,
        dry_run=dry_run,
        frame=frame,
        notes=tuple(taken_by_offset(ready, setup)),
        frame_before={}
        if continues is None
        else _frame_before(continues, named, frame, setup.control),
    )
    if start_at > 1:
        cycle = _with_measured(cycle, named, continues)
    _check_senses(plan, cycle)
    cycle.check_ranges()
    return ProbingProgram(cycle)


def _in_a_comment(name: str) -> str:
    """Return a name as comments and logs of LinuxCNC may have it."""
    return re.sub(r"[^A-Za-z0-9._-]", "_", name)[:60]


def _check_log(log: str) -> None:
    """Refuse names that LinuxCNC cannot open: it says so on its terminal alone, and goes on."""
    if FILE_NAME.fullmatch(log) is None:
        raise InputError(
            f"log: got {log!r}, expected a file name of printable ASCII without ( ) # % ; , of at "
            f"most {LONGEST_NAME} characters, and no blank at its ends"
        )
    if log.startswith("~"):
        raise InputError(
            f"log: got {log!r}, expected the folder in full: LinuxCNC does not know ~, and the "
            "touches would be in no file"
        )
    if log.rstrip("/") != log or Path(log).name in ("", "..") or Path(log).is_dir():
        raise InputError(
            f"log: got {log!r}, a folder, expected a file: LinuxCNC could not open it, and the "
            f"touches would be in no file (did you mean {Path(log) / 'touches.log'}?)"
        )


def _frame(setup: Setup, *, corrected: bool, tcp: bool) -> Frame:
    if not tcp:
        return "corrected" if corrected else "machine"
    if corrected:
        raise InputError("tcp: got it with corrected, expected one of them")
    for name in ("tcp_on", "tcp_off"):
        if not getattr(setup.control, name):
            raise InputError(
                f"control.{name}: not given, expected the line that switches tool centre point "
                f"control {name[4:]}: approaches are made with it, turns without"
            )
    return "table"


def _frame_before(
    log: str | PathLike[str], plan: Touches, frame: Frame, control: ControlSetup
) -> Mapping[str, float]:
    """Return the numbers of the frame of the runs in a log, by the names of the program.

    plan: As the log knows it.

    Those that a program of this set-up refuses are refused here: it could never start.
    """
    said = logged_frame(log, plan)
    wcs, mode = said.pop("wcs"), said.pop("mode", frame)
    if faults := list(_not_as_set_up(ControlFrame.of_words(said), wcs, mode, frame, control)):
        raise InputError(f"continues: got runs {'; and '.join(faults)}")
    number = WORK_OFFSETS.index(wcs) + 1
    return {"wcs": float(number), **{name: float(value) for name, value in said.items()}}


def _not_as_set_up(
    known: ControlFrame, wcs: str, mode: str, frame: Frame, control: ControlSetup
) -> Iterator[str]:
    """Say what of the frame of runs before a program of this set-up refuses, all of it."""
    if wcs != control.wcs:
        yield f"in {wcs}, expected {control.wcs} as in the set-up"
    elif control.centre_mm is not None and known.place_mm is not None:
        off = np.abs(np.subtract(known.place_mm, control.centre_mm))
        if off.max() > control.centre_tolerance_mm:
            both = (known.place_mm, control.centre_mm)
            at, stated = (", ".join(f"{v:.10g}" for v in place) for place in both)
            yield (
                f"with {control.wcs} at [{at}], expected it within "
                f"{control.centre_tolerance_mm:g} mm of control.centre_mm = [{stated}] of the "
                "set-up: was it changed since?"
            )
    for letter, turned in known.turned_deg.items():
        if abs(turned) > control.rotary_offset_deg + ROUNDED_DEG:
            yield (
                f"with {letter} shifted by {turned:g} deg, expected at most "
                f"control.rotary_offset_deg = {control.rotary_offset_deg:g} of the set-up"
            )
    if mode != frame:
        yield f"with other kinematics ({mode}) than this one ({frame}), expected the same"


def _with_measured(cycle: Cycle, plan: Touches, continues: str | PathLike[str] | None) -> Cycle:
    """Return a cycle that knows which touches a log has; without one, that `log` has if it is here.

    plan: As the log knows it.
    """
    if continues is not None:
        measured = logged_touches(continues, plan)
    elif Path(cycle.log).is_file():
        try:
            measured = logged_touches(cycle.log, plan)
        except FileFormatError:  # of another plan, or none: nothing is known of this one
            return cycle
    else:
        return cycle
    name = _in_a_comment(Path(cycle.log if continues is None else continues).name)
    return replace(cycle, measured=measured, measured_in=name)


def _check_senses(plan: Touches, cycle: Cycle) -> None:
    """Refuse "not turned" of an axis that has turned before, as in a plan in another order."""
    at = dict.fromkeys(cycle.letters, 0.0)
    turned: set[str] = set()
    for number, step in enumerate(cycle.steps, start=1):
        turned |= {letter for letter, angle in step.angles.items() if angle != at[letter]}
        at |= step.angles
        for letter in sorted(turned):
            column = f"{letter.lower()}_dir"
            if column in plan.columns and step.senses[letter] == 0:
                raise DataError(
                    f"plan, touch {number}: got {column} 0 (not turned), but {letter} turns "
                    "before it in this order; expected the sense of that turn, 1 or -1 (was the "
                    f"plan sorted again?), or a plan without {column}"
                )
