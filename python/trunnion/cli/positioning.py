"""``trunnion positioning``: accuracy and repeatability of an axis by ISO 230-2."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import trunnion as tn
from trunnion.cli.command import Answer, command
from trunnion.cli.diagnose import diagnose_as


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = typer.Typer(help="Positioning by ISO 230-2: results, diagnose.", no_args_is_help=True)
    command(group)(results)
    command(group, "diagnose")(diagnose_as("positioning"))
    app.add_typer(group, name="positioning")


def results(
    stops: Annotated[Path, typer.Argument(metavar="STOPS", help="stops of the axis (CSV)")],
    instrument: Annotated[
        str | None, typer.Option(help="another instrument on the same stops: its column's NAME")
    ] = None,
) -> Answer:
    """Print reversal, repeatability, systematic deviation and accuracy of an axis."""
    data = tn.read_positioning(stops)
    return Answer.of((data if instrument is None else data.instrument(instrument)).iso230_2())
