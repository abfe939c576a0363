"""``trunnion compare``: what changed between measurements of one machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import trunnion as tn
from trunnion.cli.command import Answer, Html, command
from trunnion.cli.given import sort_files
from trunnion.cli.schema import Printed

LEVEL = 0.05
"""Chance that anything is said to have changed wrongly, unless --level is given."""


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(
        app,
        values=(
            Printed("trunnion.models.changes:MachineComparison"),
            Printed("trunnion.reference.comparison:Comparison"),
        ),
        reads=True,
    )(compare)


def compare(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="BEFORE [AFTER] [MORE] [SETUP]",
            help="measured data (CSV) or estimates (JSON) of one kind in order of time, and the "
            "set-up (TOML) where the kind of data needs one; touches alone: by every method",
        ),
    ],
    dates: Annotated[
        str, typer.Option(help="of each, separated by commas: 2026-01-31,2026-06-30")
    ] = "",
    level: Annotated[
        float, typer.Option(help="chance that anything is said to have changed wrongly")
    ] = LEVEL,
    html: Html = None,
) -> Answer:
    """Say what changed between measurements of one machine, and what did not.

    Of one file of touches: closed forms, least squares and CasADi side by side.
    """
    data, set_ups = sort_files(files, (1, 1000), (0, 1), "measurements")
    setup = tn.read_setup(set_ups[0]) if set_ups else None
    if len(data) == 1:
        _only_of_several(dates, level, html)
        touches = _read(data[0])
        found = _methods(data[0], touches, setup)
        return Answer.of(found, data=touches, setup=setup)
    when = [part.strip() for part in dates.split(",")] if dates else None
    names = None if when else [path.stem for path in data]
    if names is not None and len(set(names)) < len(names):
        names = [str(path) for path in data]
    read = [_read(path) for path in data]
    found = tn.compare(*read, setup=setup, dates=when, names=names, level=level)
    return Answer.of(found, data=read, setup=setup).with_page(html)


def _only_of_several(dates: str, level: float, html: Path | None) -> None:
    """Refuse options that one measurement has no use for."""
    for name, given in (("dates", dates), ("level", level != LEVEL), ("html", html)):
        if given:
            raise tn.InputError(
                f"--{name}: got it with one measurement, expected it with two or more to compare"
            )


def _methods(path: Path, touches: Any, setup: tn.Setup | None) -> Any:
    """Estimate location errors from one measurement by every method."""
    if not isinstance(touches, tn.Touches) or setup is None:
        what = type(touches).__name__ if setup is not None else "no set-up (TOML)"
        raise tn.InputError(
            f"{path}: got one file and {what}, expected two measurements to compare, or touches "
            "with their set-up to estimate from by every method"
        )
    return tn.compare_methods(touches, setup)


def _read(path: Path) -> Any:
    if path.suffix.lower() == ".json":
        return tn.read_estimate(path)
    return tn.read(path)
