"""``trunnion contour``: simulate the five-axis contouring loop, diagnose an axis log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

import trunnion.contouring as contouring
import trunnion.nc as nc
from trunnion.base.errors import InputError
from trunnion.cli.common import clean_errors, named_values, say, show_diagnosis, show_json
from trunnion.data.axis_log import read_axis_log
from trunnion.models.kinds import diagnose as diagnose_data
from trunnion.setup import read_setup

__all__ = ["register"]

app = typer.Typer(
    no_args_is_help=True, help="Five-axis contouring: simulate the loop, diagnose an axis log."
)
CONTROLLERS = ("independent", "existing", "proposed")


def register(parent: typer.Typer) -> None:
    """Add the group to the application."""
    parent.add_typer(app, name="contour")


@app.command("simulate")
@clean_errors
def simulate(
    setup: Annotated[
        Path | None, typer.Option(help="set-up with a table \\[servo]; else the paper's Table 1")
    ] = None,
    program: Annotated[
        Path | None,
        typer.Option(help="part program (G1 G2 G3, tool-centre-point); else the paper's eq. (8)"),
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
        float, typer.Option(help="largest normal acceleration, mm/s^2")
    ] = float("inf"),
    error: Annotated[
        list[str] | None, typer.Option(help="location error as it is, NAME=value (um, arcsec)")
    ] = None,
    believed: Annotated[
        list[str] | None, typer.Option(help="location error that the control knows, NAME=value")
    ] = None,
    axis_log: Annotated[
        Path | None, typer.Option("--log", help="write the runs as an axis log (CSV) here")
    ] = None,
    noise_um: Annotated[float, typer.Option(help="noise of the log, linear axes")] = 0.0,
    noise_arcsec: Annotated[float, typer.Option(help="noise of the log, rotary axes")] = 0.0,
    seed: Annotated[int, typer.Option(help="of the noise")] = 0,
    json_output: Annotated[
        bool, typer.Option("--json", help="print JSON instead of a table")
    ] = False,
) -> None:
    """Simulate runs along a path and report true contour and orientation errors."""
    servo = contouring.Servo.paper()
    if setup is not None:
        servo = contouring.read_servo(setup)
    if program is None:
        path = contouring.Path.paper(offset_mm=offset_mm)
    else:
        text = program.read_text(encoding="utf-8")
        path = contouring.Path.from_program(nc.Program.parse(text, "linuxcnc")).shifted(offset_mm)
    runs = []
    for feed in feed_mm_min or [1000.0, 3000.0]:
        for name in controller or CONTROLLERS:
            run = contouring.simulate(
                path,
                contouring.Feed(
                    feed,
                    decelerate=decelerate,
                    normal_acceleration_mm_s2=normal_acceleration,
                ),
                controller=name,  # type: ignore[arg-type]
                servo=servo,
                errors=named_values("--error", error or []),
                believed=named_values("--believed", believed or []),
            )
            runs.append((feed, name, run))
    if axis_log is not None:
        _write_log(axis_log, runs, noise_um, noise_arcsec, seed)
    if json_output:
        show_json([_plain(feed, name, run) for feed, name, run in runs])
        return
    shown = Table("feed mm/min", "controller", "contour max µm", "rms µm", "orientation arcsec")
    for feed, name, run in runs:
        f = run.figures
        keys = ("contour_max_um", "contour_rms_um", "orientation_max_arcsec")
        told = ["diverged"] * 3 if run.diverged else [f"{f[key]:.3f}" for key in keys]
        shown.add_row(f"{feed:g}", name, *told)
    Console(highlight=False).print(shown)
    if axis_log is not None:
        say(f"axis log: {axis_log}")


def _plain(feed: float, name: str, run: contouring.ContourRun) -> dict[str, Any]:
    """Figures as plain values; null where the loop diverged."""
    figures = {k: v if np.isfinite(v) else None for k, v in run.figures.items()}
    return {"feed_mm_min": feed, "controller": name, "diverged": run.diverged, **figures}


def _write_log(
    file: Path,
    runs: list[tuple[float, str, contouring.ContourRun]],
    noise_um: float,
    noise_arcsec: float,
    seed: int,
) -> None:
    for feed, name, run in runs:
        if run.diverged:
            raise InputError(f"--log: {name} at {feed:g} mm/min diverged; nothing of it is logged")
    logs = [
        run.axis_log(
            noise_um=noise_um,
            noise_arcsec=noise_arcsec,
            seed=seed + i,
            run=f"{name} {feed:g} mm/min",
        )
        for i, (feed, name, run) in enumerate(runs)
    ]
    type(logs[0]).concatenate(logs).to_csv(file)


@app.command("diagnose")
@clean_errors
def diagnose(
    files: Annotated[
        list[Path], typer.Argument(help="axis log (CSV) and the set-up (TOML) with \\[servo]")
    ],
    html: Annotated[Path | None, typer.Option(help="write a page with pictures here")] = None,
    json_output: Annotated[
        bool, typer.Option("--json", help="print JSON instead of a table")
    ] = False,
) -> None:
    """Say what in the servo model an axis log contradicts, by name."""
    setups = [f for f in files if f.suffix.lower() == ".toml"]
    logs = [f for f in files if f.suffix.lower() != ".toml"]
    if len(setups) != 1 or len(logs) != 1:
        raise InputError(
            f"files: got {len(logs)} logs and {len(setups)} set-ups, wanted one axis log and one "
            "set-up (.toml)"
        )
    contouring.read_servo(setups[0])  # a fault of the table with its place
    d = diagnose_data(read_axis_log(logs[0]), read_setup(setups[0]))
    show_diagnosis(d, html=html, json_output=json_output)
