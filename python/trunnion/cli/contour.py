"""``trunnion contour``: simulate the five-axis contouring loop, diagnose an axis log."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.cli.command import Answer, Output, command, group_of, save_result
from trunnion.cli.diagnose import DIAGNOSED, diagnose_as
from trunnion.cli.given import sort_files
from trunnion.cli.schema import Printed
from trunnion.cli.values import named_values

if TYPE_CHECKING:
    from trunnion.base.report import Table
    from trunnion.contouring import ContourRun
    from trunnion.contouring import Path as ContourPath

CONTROLLERS = ("independent", "existing", "proposed")
FEEDS_MM_MIN = (1000.0, 3000.0)
FIGURES = {
    "contour_max_um": "contour, max µm",
    "contour_rms_um": "rms µm",
    "orientation_max_arcsec": "orientation, max arcsec",
}


class Run(TypedDict):
    """Figures of one run; None where the loop diverged."""

    feed_mm_min: float
    controller: str
    diverged: bool
    contour_max_um: float | None
    contour_rms_um: float | None
    orientation_max_arcsec: float | None


class Runs(TypedDict):
    """What `simulate` prints as JSON."""

    runs: list[Run]


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = group_of(
        app, "contour", "Five-axis contouring: simulate the loop, diagnose an axis log."
    )
    command(group, values=Printed(keys=Runs))(simulate)
    command(group, "diagnose", values=DIAGNOSED, reads=True)(diagnose_as("axislog"))


def simulate(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[PROGRAM] [SETUP]",
            help="part program (G1 G2 G3, tool-centre-point; else the paper's eq. (8)) and set-up "
            "(TOML) with a table \\[servo] (else the paper's Table 1)",
        ),
    ] = None,
    controller: Annotated[
        list[str] | None, typer.Option(help=f"{', '.join(CONTROLLERS)}; may be repeated")
    ] = None,
    feed_mm_min: Annotated[list[float] | None, typer.Option("--feed", help="mm/min")] = None,
    offset_mm: Annotated[
        tuple[float, float, float], typer.Option("--offset", help="place of the path, mm")
    ] = (0.0, 0.0, 0.0),
    decelerate: Annotated[bool, typer.Option(help="slow down at the end")] = False,
    normal_acceleration: Annotated[
        float, typer.Option(help="largest normal acceleration, mm/s²")
    ] = float("inf"),
    error: Annotated[
        list[str] | None, typer.Option(help="location error as it is, NAME=value (µm, arcsec)")
    ] = None,
    assumed: Annotated[
        list[str] | None, typer.Option(help="location error that the control knows, NAME=value")
    ] = None,
    noise_um: Annotated[float, typer.Option(min=0.0, help="noise of the log, linear axes")] = 0.0,
    noise_arcsec: Annotated[
        float, typer.Option(min=0.0, help="noise of the log, rotary axes")
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="of the noise")] = 0,
    output: Output = None,
) -> Answer:
    """Simulate runs along a path: contour and orientation errors; --output keeps an axis log."""
    programs, set_ups = sort_files(files or [], (0, 1), (0, 1), "part programs")
    contouring = tn.contouring
    servo = contouring.read_servo(set_ups[0]) if set_ups else contouring.Servo.paper()
    path = _path(programs, offset_mm)
    runs = [
        (
            feed,
            name,
            contouring.simulate(
                path,
                contouring.Feed(
                    feed, decelerate=decelerate, normal_acceleration_mm_s2=normal_acceleration
                ),
                controller=name,  # type: ignore[arg-type]
                servo=servo,
                errors=named_values("--error", error),
                assumed=named_values("--assumed", assumed),
            ),
        )
        for feed in feed_mm_min or FEEDS_MM_MIN
        for name in controller or CONTROLLERS
    ]
    shown: list[Any] = [_table(runs)]
    if output is not None:
        shown.append(_save_log(output, runs, noise_um, noise_arcsec, seed))
    return Answer({"runs": [_plain(*run) for run in runs]}, tuple(shown))


def _path(programs: list[Path], offset_mm: tuple[float, float, float]) -> ContourPath:
    """Return the path of the program, or the paper's."""
    if not programs:
        return tn.contouring.Path.paper(offset_mm=offset_mm)
    text = programs[0].read_text(encoding="utf-8")
    return tn.contouring.Path.from_program(text).shifted(offset_mm)


def _table(runs: list[tuple[float, str, ContourRun]]) -> Table:
    from trunnion.base.report import Table

    rows = [
        (
            f"{feed:g} mm/min, {name}",
            *("diverged" if run.diverged else run.figures[key] for key in FIGURES),
        )
        for feed, name, run in runs
    ]
    return Table.of("Errors of the tool tip and axis", ("", *FIGURES.values()), rows, digits=3)


def _plain(feed: float, name: str, run: ContourRun) -> dict[str, Any]:
    """Figures as plain values; null where the loop diverged."""
    figures = {k: v if math.isfinite(v) else None for k, v in run.figures.items()}
    return {"feed_mm_min": feed, "controller": name, "diverged": run.diverged, **figures}


def _save_log(
    file: Path,
    runs: list[tuple[float, str, ContourRun]],
    noise_um: float,
    noise_arcsec: float,
    seed: int,
) -> str:
    for feed, name, run in runs:
        if run.diverged:
            raise tn.InputError(f"{name} at {feed:g} mm/min: diverged; nothing of it is logged")
    logs = [
        run.axis_log(
            noise_um=noise_um,
            noise_arcsec=noise_arcsec,
            seed=seed + i,
            run=f"{name} {feed:g} mm/min",
        )
        for i, (feed, name, run) in enumerate(runs)
    ]
    return save_result(file, tn.AxisLog.concatenate(logs))
