"""``trunnion plan``, ``simulate``, ``estimate``, ``observe``: the main job on files."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated, Any

import typer

from trunnion.base.errors import InputError, TrunnionError, UnknownNameError
from trunnion.cli.common import clean_errors, named_values, numbers, say, show_json
from trunnion.data.linuxcnc_log import read_probe_log
from trunnion.data.touches import Touches, read_touches
from trunnion.probing.closed_form import closed_form
from trunnion.probing.identify import identify
from trunnion.probing.observability import observability
from trunnion.probing.plan import plan as make_plan
from trunnion.probing.program import probing_program
from trunnion.probing.result import IdentificationResult
from trunnion.probing.simulate import simulate as simulate_plan
from trunnion.setup import Setup, read_setup

__all__ = ["register"]

METHODS = ("separating", "printed", "least-squares")

SetupFile = Annotated[Path, typer.Argument(help="set-up file (TOML)", metavar="SETUP")]
TouchFile = Annotated[Path, typer.Argument(help="touches (CSV)", metavar="TOUCHES")]
Json = Annotated[bool, typer.Option("--json", help="print JSON instead of tables")]
PlanFile = Annotated[
    Path | None,
    typer.Option("--plan", help="plan or touches (CSV); the paper's plan if absent"),
]
Angles = Annotated[str, typer.Option(help="0,90,180 or first:last:step, degrees")]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command("plan")(clean_errors(plan))
    app.command("simulate")(clean_errors(simulate))
    app.command("estimate")(clean_errors(estimate))
    app.command("observe")(clean_errors(observe))


def plan(
    setup: SetupFile,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="write the plan as CSV")
    ] = None,
    program: Annotated[
        Path | None, typer.Option(help="write the probing cycle as a LinuxCNC program")
    ] = None,
    log: Annotated[str, typer.Option(help="file the control logs touches to")] = "touches.log",
    c: Angles = "0,90,180,270",
    tilt: Annotated[str, typer.Option(help="positions of A or B, degrees")] = "90,-90",
    feeds: Annotated[str, typer.Option(help="feeds of the approaches, mm/min")] = "600",
    both_senses: Annotated[bool, typer.Option(help="approach positions from both senses")] = False,
    repeats: Annotated[int, typer.Option(help="how often all of it is done")] = 1,
    json_output: Json = False,
) -> None:
    """Plan the touches of a measurement; the paper's 72 unless told otherwise."""
    made = _plan(read_setup(setup), c, tilt, feeds, both_senses, repeats)
    if output is not None:
        made.to_csv(output)
    if program is not None:
        program.write_text(probing_program(made, read_setup(setup), log).text(), encoding="utf-8")
    minutes = 0.0 if made.time_s is None else float(made.time_s[-1]) / 60
    if json_output:
        show_json({"touches": len(made), "minutes": minutes, "columns": list(made.columns)})
    elif output is None and program is None:
        say(made.to_csv())
    else:
        say(f"{len(made)} touches, about {minutes:.1f} min of moves.")


def _plan(setup: Setup, c: str, tilt: str, feeds: str, both_senses: bool, repeats: int) -> Touches:
    angles: dict[str, Any] = {"c_deg": numbers("--c", c)}
    letter = "a_deg" if setup.machine.preset == "trt-ca" else "b_deg"
    angles[letter] = numbers("--tilt", tilt)
    return make_plan(
        setup,
        feeds_mm_min=numbers("--feeds", feeds),
        both_senses=both_senses,
        repeats=repeats,
        **angles,
    )


def simulate(
    setup: SetupFile,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="write the touches as CSV")
    ] = None,
    touches: Annotated[
        Path | None,
        typer.Option("--plan", help="plan or touches (CSV); the paper's plan if absent"),
    ] = None,
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
) -> None:
    """Simulate a measurement on a machine with errors."""
    made = read_setup(setup)
    planned = make_plan(made) if touches is None else read_touches(touches)
    effects: dict[str, dict[str, float]] = {}
    for name, value in named_values("--effect", effect or []).items():
        owner, dot, parameter = name.partition(".")
        if not dot:
            raise UnknownNameError(f"--effect: got {name!r}, wanted effect.parameter=number")
        effects.setdefault(owner, {})[parameter] = value
    measured = simulate_plan(
        planned,
        made,
        errors=named_values("--error", error or []),
        placement=named_values("--placement", placement or []),
        effects=effects,
        noise_um=noise_um,
        tick_um=tick_um,
        seed=seed,
    )
    if output is None:
        say(measured.to_csv())
    else:
        measured.to_csv(output)
        say(f"{len(measured)} touches written to {output}")


def estimate(
    setup: SetupFile,
    touches: TouchFile,
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
    probe_log: Annotated[
        Path | None,
        typer.Option(help="LinuxCNC probe log; TOUCHES is then the plan it came from"),
    ] = None,
    per_position: Annotated[
        bool, typer.Option(help="also the paper's estimates at every A and C")
    ] = False,
    json_output: Json = False,
) -> None:
    """Estimate the location errors from touches."""
    made = read_setup(setup)
    data = read_touches(touches)
    if probe_log is not None:
        data = read_probe_log(probe_log, data)
    chosen = [part.strip() for part in effects.split(",") if part.strip()]
    results: dict[str, IdentificationResult] = {}
    if method is None:
        method = "least-squares"
        with contextlib.suppress(TrunnionError):
            results["separating"] = closed_form(data, made, "separating")
    methods = [part.strip() for part in method.split(",")]
    if chosen and "least-squares" not in methods:
        raise InputError(
            f"--effects: got {', '.join(chosen)}, wanted none: only least-squares estimates effects"
        )
    for name in methods:
        if name not in METHODS:
            raise UnknownNameError(f"--method: got {name!r}, wanted one of {', '.join(METHODS)}")
        if name == "least-squares":
            results[name] = identify(data, made, chosen)
        else:
            results[name] = closed_form(
                data, made, "printed" if name == "printed" else "separating"
            )
    if json_output:
        show_json({name: result.to_dict() for name, result in results.items()})
        return
    for result in results.values():
        say(result.summary() + "\n")
    if per_position:
        for table in closed_form(data, made).per_position.tables():
            say(table.text())


def observe(
    setup: SetupFile,
    touches: Annotated[
        Path | None,
        typer.Option("--plan", help="plan or touches (CSV); the paper's plan if absent"),
    ] = None,
    effects: Annotated[str, typer.Option(help="effects to estimate as well")] = "",
    noise_um: Annotated[
        float | None, typer.Option(help="standard deviation of one reading")
    ] = None,
    json_output: Json = False,
) -> None:
    """Tell what a plan can see, before anything is measured."""
    made = read_setup(setup)
    planned = make_plan(made) if touches is None else read_touches(touches)
    chosen = [part.strip() for part in effects.split(",") if part.strip()]
    seen = observability(planned, made, chosen, noise_um=noise_um)
    if json_output:
        show_json(seen.to_dict())
    else:
        say(seen.summary())
