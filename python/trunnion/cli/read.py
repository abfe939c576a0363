"""``trunnion read``: what a file is taken for, and its data as a file of this package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.base.errors import InputError
from trunnion.cli.command import Answer, Output, command, save_result
from trunnion.cli.schema import Printed


class Rows(TypedDict):
    """What `read` prints as JSON beside what it recognised."""

    rows: int


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app, values=Printed("trunnion.files.recognised:Recognised", Rows), reads=True)(read)


def said_of(data: Any) -> tuple[Any, ...]:
    """Return what is worth saying of how a file was read: nothing for a file of this package."""
    recognised = getattr(data, "recognised", None)
    return () if recognised is None or recognised.as_written else (recognised,)


def read(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="measured data of any format")],
    column: Annotated[
        list[str] | None,
        typer.Option(
            help='column of the kind = channel of the file: "x_cmd_mm=Ref \\[m]", or a number',
            show_default=False,
        ),
    ] = None,
    kind: Annotated[str, typer.Option(help="kind of data; by default found from the columns")] = "",
    period_s: Annotated[
        float | None, typer.Option(help="time between two samples, where the file does not say")
    ] = None,
    output: Output = None,
) -> Answer:
    """Say what a file is taken for; with --output, write its data as a file of this package."""
    data = tn.read(
        file,
        columns=_mapping(column),
        kind=kind or None,
        period_s=period_s,
    )
    shown: list[Any] = [repr(data), data.recognised]
    if output is not None:
        shown.append(save_result(output, data))
    return Answer({"rows": len(data), **data.recognised.to_dict()}, tuple(shown))


def _mapping(texts: list[str] | None) -> dict[str, str | float] | None:
    """Return ``["x_cmd_mm=Ref [m]", "turn_deg=180.0"]`` as columns of `tn.read`.

    What is a number with a decimal point is a value; "1" is a channel where there is one.
    """
    if not texts:
        return None
    found: dict[str, str | float] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name or not value or name in found:
            raise InputError(f"column: got {text!r}, expected COLUMN=CHANNEL, each column once")
        try:
            found[name] = float(value) if "." in value else value
        except ValueError:
            found[name] = value
    return found
