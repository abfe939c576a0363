"""``trunnion hybrid``: sensitivities of the hybrid parallel machine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import trunnion as tn
from trunnion.cli.command import Answer, command, group_of
from trunnion.cli.schema import Printed
from trunnion.cli.values import exactly, names

if TYPE_CHECKING:
    from trunnion.hybrid import Mechanism

SetupFile = Annotated[
    Path | None,
    typer.Argument(
        metavar="[SETUP]", help="set-up (TOML) with a table \\[hybrid]; default: the example"
    ),
]


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = group_of(
        app, "hybrid", "The hybrid parallel machine: 2-UPR + SPR legs, two-axis wrist."
    )
    command(group, values=Printed("trunnion.hybrid.results:Sensitivity"))(sensitivity)
    command(group, values=Printed("trunnion.hybrid.cube:CubeStudy"))(cube)


def mechanism_of(set_ups: Sequence[Path]) -> Mechanism:
    """Return the machine of a set-up file; without a file the example.

    Raises InputError: a set-up file that does not say the machine's dimensions.
    """
    if not set_ups:
        return tn.hybrid.Mechanism()
    read = tn.read_setup(set_ups[0])
    if not read.hybrid:
        raise tn.InputError(
            f"{set_ups[0]}: got no table [hybrid] or an empty one, expected the machine's "
            "dimensions there, or no set-up for the example"
        )
    return tn.hybrid.Mechanism.from_setup(read)


def sensitivity(
    setup: SetupFile = None,
    joints: Annotated[str, typer.Option(help="L1,L2,L3 in mm, q4,q5 in degrees")] = "",
    tip: Annotated[
        str,
        typer.Option(help="instead: tool point x,y,z in mm, tool vertical; default: home point"),
    ] = "",
    parameters: Annotated[
        str, typer.Option(help="errors by name, with commas; default: all 17")
    ] = "",
) -> Answer:
    """Show how each error moves the tool at one pose, and the over-constraint there."""
    machine = mechanism_of([setup] if setup else [])
    if joints and tip:
        raise tn.InputError("pose: got --joints and --tip, expected one of them")
    if joints:
        pose = exactly("--joints", joints, 5)
    else:
        point = exactly("--tip", tip, 3) if tip else list(machine.home_mm)
        pose = list(machine.inverse(point)[0])
    found = machine.sensitivity(pose, names(parameters) or tn.hybrid.PAPER_ERRORS)
    return Answer(found, (found.table(), *machine.constraint(pose).sentences()))


def cube(
    setup: SetupFile = None,
    side_mm: Annotated[float, typer.Option(help="side of the cube")] = 200.0,
    centre: Annotated[str, typer.Option(help="x,y,z in mm; default: home point")] = "",
    amount: Annotated[float, typer.Option(help="size of each error, µm or arcsec")] = 10.0,
) -> Answer:
    """Show what each of the 17 errors does to a cube of tool points (section 3 of the paper)."""
    machine = mechanism_of([setup] if setup else [])
    middle = exactly("--centre", centre, 3) if centre else list(machine.home_mm)
    study = tn.hybrid.cube_study(machine, side_mm=side_mm, centre_mm=middle, amount=amount)
    return Answer.of(study)
