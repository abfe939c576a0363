"""``trunnion program``, ``touches``: from a plan to the machine and back."""

from __future__ import annotations

import contextlib
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

import trunnion as tn
from trunnion.base.call import COMMAND
from trunnion.base.output import write_text
from trunnion.cli.command import PROGRAM, Answer, Output, check_log, command, save, save_result
from trunnion.cli.given import one_set_up, sort_files
from trunnion.cli.schema import Printed

if TYPE_CHECKING:
    from trunnion.data.touches import Touches
    from trunnion.probing.program import ProbingProgram
    from trunnion.setup import Setup

LogFile = Annotated[str, typer.Option(help="file the control appends the touches to")]
ProbeLog = Annotated[
    Path | None,
    typer.Option(help="log of a probing program; the data are then the plan that it came from"),
]


class Programmed(TypedDict):
    """What `program` prints as JSON; `ranges`: lowest and highest position of each axis."""

    touches: int
    minutes: float
    plan_hash: str
    ranges: dict[str, list[float]]


class Measured(TypedDict):
    """What `touches` prints as JSON."""

    touches: int
    planned: int
    columns: list[str]
    notes: list[str]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    command(app, values=Printed(keys=Programmed))(program)
    command(app, values=Printed(keys=Measured))(touches)


def program(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="PLAN SETUP", help="plan (CSV) and the set-up (TOML)"),
    ],
    output: Output = None,
    log: LogFile = "touches.log",
    start_at: Annotated[
        int, typer.Option("--from", min=1, help="first touch, to go on with a run that was stopped")
    ] = 1,
    dry_run: Annotated[bool, typer.Option(help="all moves but the approaches")] = False,
    feed: Annotated[
        float | None, typer.Option(help="of the approaches, mm/min, of a plan without feed_mm_min")
    ] = None,
    corrected: Annotated[
        bool, typer.Option(help="measure with the corrections on (M430): what they leave")
    ] = False,
    tcp: Annotated[
        bool, typer.Option("--tcp", help="touch with tool centre point control on (M428)")
    ] = False,
    continues: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG", help="of the runs to go on with: the program compares its frame with it"
        ),
    ] = None,
) -> Answer:
    """Write the LinuxCNC program that measures a plan."""
    plans, file = one_set_up(files, (1, 1), "plans")
    check_log(log)
    plan = tn.read_touches(plans[0])
    if start_at > len(plan):
        raise tn.InputError(f"--from: got {start_at}, expected a touch of the plan's {len(plan)}")
    if continues is not None and start_at == 1:
        raise tn.InputError(
            f"--continues {continues}: got it without --from, or --from 1, which begins a new "
            "measurement; expected --from N too, the touch from which the runs of that log go on"
        )
    if tcp and corrected:
        raise tn.InputError("--tcp: got it with --corrected, expected one of them")
    made = tn.probing_program(
        plan,
        tn.read_setup(file),
        log,
        name=plans[0].name,
        start_at=start_at,
        dry_run=dry_run,
        feed_mm_min=feed,
        corrected=corrected,
        tcp=tcp,
        continues=continues,
    )
    from trunnion.probing.notes import fast_approaches

    for note in fast_approaches([step.feed for step in made.cycle.steps], made.cycle.setup):
        warnings.warn(note, UserWarning, stacklevel=1)
    for note in made.cycle.said_before():
        warnings.warn(note, UserWarning, stacklevel=1)
    if output is None:
        return Answer(_values(made), (made.text().rstrip("\n"),))
    return Answer(_values(made), (_said(made), save_program(output, made)))


def save_program(path: Path, made: ProbingProgram) -> str:
    """Write a program, and say so."""
    return save(path, lambda draft: write_text(draft, made.text()), PROGRAM)


def _values(made: ProbingProgram) -> dict[str, object]:
    cycle = made.cycle
    return {
        "touches": len(cycle.steps) - cycle.start_at + 1,
        "minutes": made.seconds / 60,
        "plan_hash": made.plan_hash,
        "ranges": {axis: list(values) for axis, values in cycle.ranges().items()},
    }


def _said(made: ProbingProgram) -> str:
    ranges = made.cycle.ranges()
    spans = ", ".join(f"{axis} {low:g} to {high:g}" for axis, (low, high) in ranges.items())
    many = len(made.cycle.steps) - made.cycle.start_at + 1
    return f"{many} touches, about {made.seconds / 60:.1f} min without pauses. Ranges: {spans}."


def read_log(log: Path, plan: Touches, setup: Setup | None) -> Touches:
    """Read the log of a plan's program; with a set-up, at the times of that program."""
    from trunnion.probing.on_table import is_table_log

    if setup is not None and is_table_log(log, plan, setup):
        return tn.read_table_log(log, plan, setup)
    if setup is not None and plan.feed_mm_min is not None:
        # No program for this machine, or the set-up has changed since: the plan's own times.
        with contextlib.suppress(tn.InputError, tn.DataError):
            plan = plan.with_columns(time_s=tn.probing_program(plan, setup).time_s)
    return tn.read_probe_log(log, plan, setup)


def touches(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="PLAN LOG [SETUP]",
            help="plan (CSV), the log of its probing program, and the set-up (TOML), by which the "
            "times of the touches are those of the program, not of the plan",
        ),
    ],
    after: Annotated[
        Path | None,
        typer.Option(
            help="touches that these follow, the artefact left as it is (of diagnose --next): both "
            "are written, as one measurement"
        ),
    ] = None,
    pause: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="s from the last touch of --after to the first of these, where their plan begins "
            "its times anew",
        ),
    ] = None,
    output: Output = None,
) -> Answer:
    """Write the touches that a probing program logged, as data for every other command."""
    if pause is not None and after is None:
        raise tn.InputError("--pause: got it without --after, expected both")
    (plan, log), set_ups = sort_files(files, (2, 2), (0, 1), "plan and log")
    if plan.suffix.lower() == ".log":
        plan, log = log, plan
    planned = tn.read_touches(plan)
    setup = tn.read_setup(set_ups[0]) if set_ups else None
    measured = read_log(log, planned, setup)
    notes = measured.recognised.notes if measured.recognised else ()
    logged, missing = len(measured), _missing(planned, measured)
    if after is not None:
        first, doubts = _before(after, planned, setup)
        notes = (*doubts, *notes)
        measured = _following(first, measured, planned, pause)
    values = {
        "touches": len(measured),
        "planned": len(planned),
        "columns": list(measured.columns),
        "notes": list(notes),
    }
    if output is None:
        return Answer(values, (*(f"# {note}" for note in notes), measured.to_csv().rstrip("\n")))
    said = f"{logged} of {len(planned)} planned touches{missing}"
    return Answer(values, (*notes, said, save_result(output, measured)))


def _before(
    path: Path, planned: tn.Touches, setup: Setup | None
) -> tuple[tn.Touches, tuple[str, ...]]:
    """Read touches that others follow, and say what is likely wrong with them; refuse a plan.

    In one file with the others nothing would show that it was one.
    """
    import numpy as np

    from trunnion.probing.identify import mistakes_of
    from trunnion.probing.mistakes import PLANNED, PLANNED_UM

    first = tn.read_touches(path)
    said = () if setup is None else mistakes_of(first, setup)
    same = first.position_mm.shape == planned.position_mm.shape
    off_mm = np.abs(first.position_mm - planned.position_mm) if same else np.inf
    if PLANNED in said or np.max(off_mm) < 1e-3 * PLANNED_UM:
        raise tn.DataError(
            f"--after {path}: got touches that all lie exactly where they were planned, expected "
            "what was measured before: is this the plan?"
        )
    return first, tuple(f"{path.name}: {text}" for text in said)


def _following(
    first: tn.Touches, measured: tn.Touches, planned: tn.Touches, pause_s: float | None
) -> tn.Touches:
    """Return touches and those that follow them, by the clock of a plan that runs on.

    pause_s: Between them, of a plan whose times begin anew; None: not stated.
    """
    at, before = measured.time_s, first.time_s
    if at is None or before is None:
        if pause_s is not None:
            raise tn.InputError("--pause: got touches without time_s, expected times before it")
        return first.followed_by(measured)
    start = at if planned.time_s is None else planned.time_s
    begin = max(start.min(), at.min()) if pause_s is None else before.max() + pause_s
    if begin < before.max():
        raise tn.InputError(
            f"--after: got touches whose times begin anew ({at.min():.6g} s, those before end at "
            f"{before.max():.6g} s), expected those of a plan whose times run on, as diagnose "
            "--next writes it; or state how long the control stood between them: "
            f"{COMMAND.get()} --pause SECONDS"
        )
    return first.followed_by(measured.with_columns(time_s=at + (begin - at.min())))


def _missing(planned: tn.Touches, measured: tn.Touches) -> str:
    """Say which touches of a plan were not read from its log, and how its program goes on."""
    from trunnion.data.linuxcnc_runs import spans

    touches = None if measured.origin is None else measured.origin.touch
    there = set() if touches is None else set(touches.tolist())
    numbers = [number for number in range(1, len(planned) + 1) if number not in there]
    if not numbers:
        return ""
    rest = numbers == list(range(numbers[0], len(planned) + 1))
    how = f"; the program goes on with #<_from> = {numbers[0]}" if rest and numbers[0] > 1 else ""
    return f"; not among them: {spans(numbers)}{how}"
