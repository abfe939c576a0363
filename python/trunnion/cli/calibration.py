"""``trunnion plan``, ``simulate``, ``estimate``, ``observe``: the main job on files."""

from __future__ import annotations

import contextlib
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypedDict, cast

import typer

import trunnion as tn
from trunnion.base.input import listed_numbers
from trunnion.cli.command import (
    LOG,
    PROGRAM,
    Answer,
    Html,
    Output,
    check_log,
    check_outputs,
    command,
    is_program,
    save,
    save_result,
)
from trunnion.cli.given import one_set_up
from trunnion.cli.program import LogFile, ProbeLog, read_log, save_program
from trunnion.cli.schema import Of, Printed
from trunnion.cli.values import Angles, named_values, names

if TYPE_CHECKING:
    from trunnion.data.touches import Touches
    from trunnion.probing.result import IdentificationResult
    from trunnion.setup import Setup

__all__ = ["register"]

ClosedForm: TypeAlias = Literal["printed", "separating"]
METHODS = ("separating", "printed", "least-squares")

SetupFile = Annotated[Path, typer.Argument(help="set-up (TOML)", metavar="SETUP")]
PlanAndSetup = Annotated[
    list[Path],
    typer.Argument(
        metavar="[PLAN] SETUP",
        help="plan or touches (CSV; the paper's plan if absent) and the set-up (TOML)",
    ),
]


class Planned(TypedDict):
    """What `plan` prints as JSON."""

    touches: int
    minutes: float
    columns: list[str]
    notes: list[str]


class Simulated(TypedDict):
    """What `simulate` prints as JSON."""

    touches: int
    columns: list[str]


_FORMS = Annotated[Any, Of(("trunnion.probing.result:ClosedFormResult",))]
_FIT = Annotated[Any, Of(("trunnion.probing.result:IdentificationResult",))]
Estimates = TypedDict(
    "Estimates", {"separating": _FORMS, "printed": _FORMS, "least-squares": _FIT}, total=False
)


C_DEG, TILT_DEG = "0,90,180,270", "90,-90"
"""Positions of the paper's plan."""


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    command(app, values=Printed(keys=Planned))(plan)
    command(app, values=Printed(keys=Simulated), reads=True)(simulate)
    command(app, values=Printed(keys=Estimates), reads=True)(estimate)
    seen = Printed("trunnion.probing.observability:Observability")
    command(app, values=seen, reads=True)(observe)


def plan(
    setup: SetupFile,
    output: Output = None,
    program: Annotated[
        Path | None, typer.Option(help="write the probing cycle as a LinuxCNC program")
    ] = None,
    log: LogFile = "touches.log",
    c: Angles = C_DEG,
    tilt: Annotated[str, typer.Option(help="positions of A or B, degrees")] = TILT_DEG,
    feeds: Annotated[str, typer.Option(help="feeds of the approaches, mm/min")] = "600",
    both_senses: Annotated[bool, typer.Option(help="approach positions from both senses")] = False,
    repeats: Annotated[int, typer.Option(help="how often all of it is done")] = 1,
    every_pose: Annotated[
        bool, typer.Option(help="every position of --tilt at every one of --c")
    ] = False,
    for_: Annotated[
        str,
        typer.Option("--for", help="location errors to identify, EA0A,EB0C; chooses the angles"),
    ] = "",
    criterion: Annotated[
        Literal["A", "D"], typer.Option(help="of --for: least sum of variances, or determinant")
    ] = "A",
    max_minutes: Annotated[float | None, typer.Option(help="of --for: longest program")] = None,
    max_touches: Annotated[int | None, typer.Option(help="of --for: most touches")] = None,
) -> Answer:
    """Plan the touches of a measurement; the paper's 72 unless angles or --for are given."""
    from trunnion.machine.chain import Chain

    made = tn.read_setup(setup)
    chain = Chain(made)
    angles = {
        chain.turning: listed_numbers("--c", c),
        chain.tilting: listed_numbers("--tilt", tilt),
    }
    bounds = (criterion != "A", max_minutes is not None, max_touches is not None)
    several = len(listed_numbers("--feeds", feeds)) > 1
    chosen = (c != C_DEG, tilt != TILT_DEG, both_senses, repeats != 1, every_pose, several)
    _check_options(bool(for_), chosen if for_ else bounds)
    if for_:
        (feed,) = listed_numbers("--feeds", feeds)
        planned = tn.plan_for(
            made,
            names(for_),
            criterion=criterion,
            max_minutes=max_minutes,
            max_touches=max_touches,
            feed_mm_min=feed,
        )
    else:
        turns, tilts = (angles[x] if x else [] for x in (chain.turning, chain.tilting))
        planned = tn.plan(
            made,
            positions_deg=[(t, c) for t in tilts for c in turns if c] if every_pose else (),
            feeds_mm_min=listed_numbers("--feeds", feeds),
            both_senses=both_senses,
            repeats=repeats,
            **{f"{x.lower()}_deg": values for x, values in angles.items() if x},  # type: ignore[arg-type]
        )
    return _planned(planned, made, output, program, log, (output or setup).name)


BY_ANGLES = ("--c", "--tilt", "--both-senses", "--repeats", "--every-pose", "several --feeds")
BY_ERRORS = ("--criterion", "--max-minutes", "--max-touches")


def _check_options(for_: bool, given: tuple[bool, ...]) -> None:
    """Refuse options of the other way to plan: by angles, or by the errors to identify."""
    options = BY_ANGLES if for_ else BY_ERRORS
    wrong = [name for name, is_given in zip(options, given, strict=True) if is_given]
    if wrong:
        got = ", ".join(wrong)
        raise tn.InputError(
            f"plan: got {got} with --for, expected --for alone: it chooses the angles"
            if for_
            else f"plan: got {got} without --for, expected --for with the errors to identify"
        )


def _planned(
    planned: Touches, made: Setup, output: Path | None, program: Path | None, log: str, name: str
) -> Answer:
    """Write what was asked for, and say what was planned."""
    from trunnion.probing.design import missing_positions
    from trunnion.probing.notes import plan_notes
    from trunnion.probing.steps import taken_by_offset

    if output is not None and is_program(output):
        raise tn.InputError(
            f"--output: got {output}, whose ending is that of a program, for the plan; expected "
            f"plan.csv, say, and --program {output.name} for the program"
        )
    if program is not None:  # before anything is written
        check_outputs(program, what=PROGRAM)
        check_log(log)
    shown = []
    minutes = 0.0 if planned.time_s is None else float(planned.time_s[-1]) / 60
    if output is not None:
        shown.append(save_result(output, planned))
    if program is not None:
        cycle = tn.probing_program(planned, made, log, name=name)
        shown.append(save_program(program, cycle))
        minutes = cycle.seconds / 60
    notes = plan_notes(planned, made)
    values = {
        "touches": len(planned),
        "minutes": minutes,
        "columns": list(planned.columns),
        "notes": list(notes),
    }
    if not shown:
        for note in (*taken_by_offset(planned, made), *missing_positions(planned, made)):
            warnings.warn(note, UserWarning, stacklevel=1)
        return Answer(values, (planned.to_csv().rstrip("\n"),))
    said = f"{len(planned)} touches, about {minutes:.1f} min of moves."
    return Answer(values, (said, *notes, *shown))


def simulate(
    files: PlanAndSetup,
    output: Output = None,
    error: Annotated[
        list[str] | None, typer.Option(help="true location error, EX0C=15 (µm or arcsec)")
    ] = None,
    placement: Annotated[
        list[str] | None, typer.Option(help="true placement, dx_um=50 or rc_arcsec=60")
    ] = None,
    effect: Annotated[
        list[str] | None, typer.Option(help="true effect, drift_z.rate_um_h=5")
    ] = None,
    noise_um: Annotated[float, typer.Option(help="repeatability of the probe, 1 σ")] = 0.0,
    tick_um: Annotated[
        float | None, typer.Option(help="tick of the trigger; the set-up's if absent")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="of the noise")] = None,
    probe_log: Annotated[
        Path | None,
        typer.Option(help="write what the plan's LinuxCNC program would log"),
    ] = None,
) -> Answer:
    """Simulate a measurement on a machine with errors."""
    setup, plan = _plan_and_set_up(files)
    effects: dict[str, dict[str, float]] = {}
    for name, value in named_values("--effect", effect).items():
        owner, dot, parameter = name.partition(".")
        if not dot:
            raise tn.UnknownNameError(f"--effect: got {name!r}, expected effect.parameter=number")
        effects.setdefault(owner, {})[parameter] = value
    measured = tn.simulate(
        plan,
        setup,
        errors=named_values("--error", error),
        placement=named_values("--placement", placement),
        effects=effects,
        noise_um=noise_um,
        tick_um=tick_um,
        seed=seed,
    )
    values = {"touches": len(measured), "columns": list(measured.columns)}
    if probe_log is not None:
        from trunnion.data.linuxcnc_log import probe_log_of

        log = probe_log_of(plan, measured, "simulated")
        said = save(probe_log, lambda path: path.write_text(log, encoding="utf-8"), LOG)
        more = () if output is None else (save_result(output, measured),)
        return Answer(values, (f"{len(measured)} touches", said, *more))
    if output is None:
        return Answer(values, (measured.to_csv().rstrip("\n"),))
    return Answer(values, (f"{len(measured)} touches", save_result(output, measured)))


def _plan_and_set_up(files: list[Path]) -> tuple[Setup, Touches]:
    """Return the set-up and the plan among the files; the paper's plan if there is none."""
    plans, file = one_set_up(files, (0, 1), "plans")
    setup = tn.read_setup(file)
    return setup, tn.read_touches(plans[0]) if plans else tn.plan(setup)


def estimate(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="TOUCHES SETUP", help="touches (CSV) and the set-up (TOML)"),
    ],
    method: Annotated[
        str | None,
        typer.Option(
            help="separating, printed or least-squares (comma-separated); by default "
            "least-squares, and separating where the touches are the paper's"
        ),
    ] = None,
    effects: Annotated[
        str, typer.Option(help="effects to estimate by least squares, comma-separated")
    ] = "",
    probe_log: ProbeLog = None,
    per_position: Annotated[
        bool, typer.Option(help="also the paper's estimates at every A and C")
    ] = False,
    html: Html = None,
) -> Answer:
    """Estimate the location errors from touches; --output keeps the estimate as JSON.

    --html writes the report of the most general estimate: one page with the evidence.
    """
    measured, file = one_set_up(files, (1, 1), "touches")
    setup = tn.read_setup(file)
    data = tn.read_touches(measured[0])
    if probe_log is not None:
        data = read_log(probe_log, data, setup)
    results = _estimates(data, setup, method, names(effects))
    notes = data.recognised.notes if probe_log is not None and data.recognised else ()
    shown: list[object] = [*notes, *(f"{result.summary()}\n" for result in results.values())]
    if per_position:
        shown += tn.closed_form(data, setup).per_position.tables()
    made_of = {"data": data, "setup": setup}
    best = results.get("least-squares") or next(iter(results.values()))
    return Answer(results, tuple(shown), made_of=made_of).with_page(html, best)


def _estimates(
    data: Touches, setup: Setup, method: str | None, effects: list[str]
) -> dict[str, IdentificationResult]:
    """Return the result of each method, by name."""
    results: dict[str, IdentificationResult] = {}
    if method is None:
        method = "least-squares"
        with contextlib.suppress(tn.TrunnionError):
            results["separating"] = tn.closed_form(data, setup, "separating")
    methods = names(method)
    if effects and "least-squares" not in methods:
        raise tn.InputError(
            f"--effects: got {', '.join(effects)}, expected none: only least-squares estimates "
            "effects"
        )
    for name in methods:
        if name == "least-squares":
            results[name] = tn.identify(data, setup, effects)
        elif name in METHODS:
            results[name] = tn.closed_form(data, setup, cast("ClosedForm", name))
        else:
            raise tn.UnknownNameError(
                f"--method: got {name!r}, expected one of {', '.join(METHODS)}"
            )
    return results


def observe(
    files: PlanAndSetup,
    effects: Annotated[str, typer.Option(help="effects to estimate as well")] = "",
    noise_um: Annotated[
        float | None, typer.Option(help="standard deviation of one reading")
    ] = None,
) -> Answer:
    """Say what a plan can determine, before anything is measured."""
    setup, planned = _plan_and_set_up(files)
    found = tn.observability(planned, setup, names(effects), noise_um=noise_um)
    return Answer.of(found, data=planned, setup=setup)
