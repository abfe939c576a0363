"""Command line: ``trunnion plan``, ``simulate``, ``estimate``, ... one file a group of commands."""

from __future__ import annotations

import typer

from trunnion.cli import ballbar, calibration, contour, demo, diagnose, hybrid, turning
from trunnion.cli.common import clean_errors
from trunnion.cli.compensate import compensate
from trunnion.cli.sweep import sweep_command

__all__ = ["app"]

app = typer.Typer(
    name="trunnion",
    help="Geometric accuracy of machine tools: plan, simulate, estimate, diagnose, compensate.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

# --- trunnion (paper 000)
calibration.register(app)
app.command("compensate")(clean_errors(compensate))
demo.register(app)

# --- diagnosis
diagnose.register(app)

# --- turning (paper 001)
app.add_typer(turning.app, name="turning")

# --- hybrid machine and ball-bar (paper 004)
hybrid.register(app)
ballbar.register(app)

# --- sweeps
app.command("sweep")(clean_errors(sweep_command))

# --- contouring (paper 003)
contour.register(app)
