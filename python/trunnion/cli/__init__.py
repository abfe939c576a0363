"""Command line: ``trunnion plan``, ``simulate``, ``estimate``, ...; one file a group of commands.

Grammar: ``trunnion COMMAND DATA... SETUP [options]``, data and set-up in either order.
"""

from __future__ import annotations

from typing import Annotated

import typer

from trunnion.cli import (
    ballbar,
    calibration,
    compare,
    compensate,
    contour,
    correct,
    demo,
    diagnose,
    hybrid,
    levels,
    positioning,
    program,
    read,
    rotary_test,
    schemas,
    start,
    sweep,
    turning,
    verify,
    view,
)
from trunnion.cli.command import Group

__all__ = ["app"]

app = typer.Typer(
    cls=Group,
    name="trunnion",
    help="Geometric accuracy of machine tools: plan, simulate, estimate, diagnose, compensate.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from trunnion._core import __version__

        typer.echo(f"trunnion {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    """Geometric accuracy of machine tools: plan, simulate, estimate, diagnose, compensate."""
    del version


GROUPS = (
    start,
    calibration,
    program,
    read,
    diagnose,
    compare,
    compensate,
    turning,
    contour,
    correct,
    verify,
    ballbar,
    positioning,
    levels,
    rotary_test,
    hybrid,
    sweep,
    view,
    demo,
    schemas,
)
for part in GROUPS:
    part.register(app)
