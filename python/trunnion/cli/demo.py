"""``trunnion demo``: the main job from end to end on what comes with the package."""

from __future__ import annotations

from typing import TypedDict

import typer

from trunnion.cli.command import Answer, command
from trunnion.cli.schema import Printed


class Sections(TypedDict):
    """What `demo` prints as JSON."""

    sections: list[str]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app, values=Printed(keys=Sections))(demo)


def demo() -> Answer:
    """Show the main job: from touches to the eight errors of a tilting rotary table."""
    from trunnion.demo import sections

    found = [section + "\n" for section in sections()]
    return Answer({"sections": found}, tuple(found))
