"""``trunnion schema``: what a command prints with ``--json``."""

from __future__ import annotations

from typing import Annotated, Any, TypedDict

import typer

from trunnion.cli.command import COMMANDS, SCHEMA_VERSION, Answer, command
from trunnion.cli.schema import Printed

Form = TypedDict("Form", {"$schema": str, "title": str, "$defs": dict[str, Any]})


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app, values=Printed(keys=Form))(schema)


def schema(
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[COMMAND]", help="as typed: diagnose, or positioning results"),
    ] = None,
) -> Answer:
    """Print the JSON Schema of what a command prints with --json; without a command, list them."""
    from trunnion.base.checks import choose
    from trunnion.cli.schema import schema as schema_of

    if not words:
        title = f"--json, version {SCHEMA_VERSION}: of {', '.join(COMMANDS)}"
        return Answer({"$schema": "", "title": title, "$defs": {}}, tuple(COMMANDS))
    known = COMMANDS[choose("command", " ".join(words), COMMANDS)]
    forms = known.values if isinstance(known.values, tuple) else (known.values,)
    answer = Answer(schema_of(known.name, SCHEMA_VERSION, forms))
    return Answer(answer.values, (answer.json(),))
