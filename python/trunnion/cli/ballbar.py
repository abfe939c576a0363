"""``trunnion ballbar``: ball-bar tests of three-axis and hybrid machines."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from trunnion.base.errors import InputError
from trunnion.cli import diagnose as diagnosis
from trunnion.cli.common import clean_errors, show_json
from trunnion.cli.hybrid import mechanism_of
from trunnion.data.ballbar import read_ballbar
from trunnion.hybrid import identifiability, identify_ballbar
from trunnion.setup import read_setup

__all__ = ["register"]

Data = Annotated[Path, typer.Argument(help="ball-bar lengths (CSV)")]
SetupFile = Annotated[
    Path | None, typer.Argument(help="set-up (TOML) with tables \\[ballbar] and \\[hybrid]")
]
Json = Annotated[bool, typer.Option("--json", help="print JSON instead of tables")]


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = typer.Typer(help="Ball-bar tests: diagnose, identify, plan.", no_args_is_help=True)
    group.command("diagnose")(clean_errors(diagnose))
    group.command("identify")(clean_errors(identify))
    group.command("plan")(clean_errors(plan))
    app.add_typer(group, name="ballbar")


def diagnose(
    data: Data,
    setup: SetupFile = None,
    html: Annotated[Path | None, typer.Option(help="write a page with pictures here")] = None,
    json_output: Json = False,
) -> None:
    """Say whether the machine's model explains the lengths, and if not, what is wrong, by name."""
    if setup is not None:
        read = read_setup(setup)
        if not read.ballbar and not read.hybrid:
            raise InputError(
                f"{setup}: got neither a table [ballbar] nor [hybrid], wanted one of them, or no "
                "set-up for a three-axis machine and a calibrated bar"
            )
    files = [data] if setup is None else [data, setup]
    diagnosis.diagnose(files, kind="ballbar", html=html, json_output=json_output)


def identify(
    data: Data,
    setup: SetupFile = None,
    sigma_um: Annotated[float | None, typer.Option(help="noise of a reading, 1 σ")] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="errors known beforehand to this, 1 σ, µm or arcsec; needs --sigma-um"),
    ] = None,
    json_output: Json = False,
) -> None:
    """Estimate the 17 errors of the hybrid machine."""
    found = identify_ballbar(
        read_ballbar(data), mechanism_of(setup), sigma_um=sigma_um, tolerance=tolerance
    )
    if json_output:
        show_json(found.to_dict())
        return
    console = Console(highlight=False)
    console.print(found.table().to_rich())
    for line in found.sentences():
        console.print(line)


def plan(
    data: Data,
    setup: SetupFile = None,
    sigma_um: Annotated[float, typer.Option(help="noise of a reading, 1 σ")] = 0.5,
    json_output: Json = False,
) -> None:
    """Say what readings at these poses of the hybrid machine can tell, before they are taken."""
    seen = identifiability(read_ballbar(data), mechanism_of(setup), sigma_um=sigma_um)
    if json_output:
        show_json(seen.to_dict())
        return
    Console(highlight=False).print(seen.summary())
