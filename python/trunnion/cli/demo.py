"""``trunnion demo``: the main job from end to end on what comes with the package."""

from __future__ import annotations

import typer

from trunnion.cli.common import clean_errors, say
from trunnion.demo import sections

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("demo")(clean_errors(demo))


def demo() -> None:
    """Show the main job: from touches to the eight errors of a tilting rotary table."""
    for section in sections():
        say(section + "\n")
