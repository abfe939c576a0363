"""``trunnion rotary-test``: R-tests and ball-bar tests of rotary axes (ISO 10791-6)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict

import typer

import trunnion as tn
from trunnion.base.input import listed_numbers
from trunnion.cli.calibration import SetupFile
from trunnion.cli.command import Answer, Html, Output, command, group_of, save_result
from trunnion.cli.diagnose import DIAGNOSED, diagnose_as
from trunnion.cli.given import one_set_up
from trunnion.cli.schema import Printed
from trunnion.cli.values import Angles, exactly

Readings = Annotated[
    list[Path],
    typer.Argument(metavar="READINGS SETUP", help="readings (CSV), and the set-up (TOML)"),
]


class Planned(TypedDict):
    """What `plan` prints as JSON."""

    positions: int
    columns: list[str]


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = group_of(
        app, "rotary-test", "R-tests and ball-bar tests of rotary axes: plan, identify, diagnose."
    )
    command(group, values=Printed(keys=Planned))(plan)
    found = Printed("trunnion.probing.rotary_test:RotaryTestIdentification")
    command(group, values=found, reads=True)(identify)
    command(group, "diagnose", values=DIAGNOSED, reads=True)(diagnose_as("rotarytest"))


def plan(
    setup: SetupFile,
    ball: Annotated[str, typer.Option(help="centre of the ball on the table, x,y,z in mm")],
    output: Output = None,
    turn: Angles = "0:330:30",
    tilt: Annotated[str, typer.Option(help="positions of the axis that tilts, degrees")] = "0",
    bar: Annotated[
        str, typer.Option(help="of a ball-bar: from the ball to the tool's point, x,y,z in mm")
    ] = "0,0,0",
    frame: Annotated[
        Literal["machine", "work"], typer.Option(help="in which the bar points")
    ] = "machine",
) -> Answer:
    """Plan the positions at which the tool follows a ball, for every tilt all turns."""
    import numpy as np

    from trunnion.machine.chain import Chain

    made = tn.read_setup(setup)
    chain = Chain(made)
    tilts, turns = np.meshgrid(
        listed_numbers("--tilt", tilt), listed_numbers("--turn", turn), indexing="ij"
    )
    angles = {chain.tilting: tilts.ravel(), chain.turning: turns.ravel()}
    planned = tn.plan_rotary_test(
        made,
        exactly("--ball", ball, 3),
        {letter: values for letter, values in angles.items() if letter},
        bar_mm=exactly("--bar", bar, 3),
        frame=frame,
    )
    said: list[Any] = [f"{len(planned)} positions"]
    if output is not None:
        said.append(save_result(output, planned))
    return Answer({"positions": len(planned), "columns": list(planned.columns)}, tuple(said))


def identify(files: Readings, html: Html = None) -> Answer:
    """Estimate location errors; [rotary_test] of the set-up says where the ball stands."""
    data, setup = one_set_up(files, (1, 1), "readings")
    readings = tn.read_rotary_test(data[0])
    known = tn.read_setup(setup)
    fit = tn.identify_rotary_test(readings, known)
    return Answer(fit.to_dict(), (fit,), made_of={"data": readings, "setup": known}).with_page(html)
