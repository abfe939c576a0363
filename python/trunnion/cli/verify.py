"""``trunnion verify``: what corrections leave, by a ball on the table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import trunnion as tn
from trunnion.cli.command import Answer, Html, command
from trunnion.cli.given import one_set_up
from trunnion.cli.schema import Printed


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app, values=Printed("trunnion.compensation.verification:BallVerification"))(verify)


def verify(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="[BEFORE] AFTER SETUP",
            help="touches of a sphere on the table without the corrections and with them, of one "
            "plan (`trunnion touches`), and the set-up (TOML)",
        ),
    ],
    estimate: Annotated[
        Path | None,
        typer.Option(help="what the corrections were made from (JSON): gives the forecast"),
    ] = None,
    html: Html = None,
) -> Answer:
    """Compare where a ball on the table is found at every posture, before and after corrections."""
    data, file = one_set_up(files, (1, 2), "measurements")
    read, setup = [tn.read_touches(path) for path in data], tn.read_setup(file)
    found = tn.verify_ball(
        read[-1],
        setup,
        before=read[0] if len(read) == 2 else None,
        estimate=None if estimate is None else tn.read_estimate(estimate),
    )
    inputs = [] if estimate is None else [estimate]
    return Answer.of(found, data=[*read, *inputs], setup=setup).with_page(html)
