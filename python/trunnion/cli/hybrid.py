"""``trunnion hybrid``: sensitivities of the hybrid parallel machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from trunnion.base.errors import InputError
from trunnion.cli.common import clean_errors, numbers, show_json
from trunnion.hybrid import PAPER_ERRORS, Mechanism, cube_study
from trunnion.setup import read_setup

__all__ = ["register"]

SetupFile = Annotated[
    Path | None, typer.Argument(help="set-up (TOML) with a table \\[hybrid]; default: the example")
]
Json = Annotated[bool, typer.Option("--json", help="print JSON instead of tables")]


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = typer.Typer(
        help="The hybrid parallel machine: 2-UPR + SPR legs, two-axis wrist.", no_args_is_help=True
    )
    group.command("sensitivity")(clean_errors(sensitivity))
    group.command("cube")(clean_errors(cube))
    app.add_typer(group, name="hybrid")


def mechanism_of(setup: Path | None) -> Mechanism:
    """The machine of a set-up file; without a file the example.

    Raises
    ------
    InputError
        A set-up file that does not say the machine's dimensions.
    """
    if setup is None:
        return Mechanism()
    read = read_setup(setup)
    if not read.hybrid:
        raise InputError(
            f"{setup}: got no table [hybrid] or an empty one, wanted the machine's dimensions "
            "there, or no set-up for the example"
        )
    return Mechanism.from_setup(read)


def _exactly(what: str, text: str, count: int) -> list[float]:
    values = numbers(what, text)
    if len(values) != count:
        raise InputError(f"{what}: got {text!r}, wanted {count} numbers with commas between")
    return values


def sensitivity(
    setup: SetupFile = None,
    joints: Annotated[str, typer.Option(help="L1,L2,L3 in mm, q4,q5 in degrees")] = "",
    tip: Annotated[
        str,
        typer.Option(help="instead: tool point x,y,z in mm, tool vertical; default: home point"),
    ] = "",
    parameters: Annotated[
        str, typer.Option(help="errors by name, with commas; default: the 17 of the paper")
    ] = "",
    json_output: Json = False,
) -> None:
    """Show how each error moves the tool at one pose, and the over-constraint there."""
    machine = mechanism_of(setup)
    if joints and tip:
        raise InputError("pose: got --joints and --tip, wanted one of them")
    if joints:
        pose = _exactly("--joints", joints, 5)
    else:
        point = _exactly("--tip", tip, 3) if tip else list(machine.home_mm)
        pose = list(machine.inverse(point)[0])
    names = [part.strip() for part in parameters.split(",") if part.strip()]
    found = machine.sensitivity(pose, names or PAPER_ERRORS)
    if json_output:
        show_json(found.to_dict())
        return
    console = Console(highlight=False)
    console.print(found.table().to_rich())
    console.print(machine.constraint(pose).summary())


def cube(
    setup: SetupFile = None,
    side_mm: Annotated[float, typer.Option(help="side of the cube")] = 200.0,
    centre: Annotated[str, typer.Option(help="x,y,z in mm; default: home point")] = "",
    amount: Annotated[float, typer.Option(help="size of each error, µm or arcsec")] = 10.0,
    json_output: Json = False,
) -> None:
    """Show what each of the 17 errors does to a cube of tool points (section 3 of the paper)."""
    machine = mechanism_of(setup)
    middle = _exactly("--centre", centre, 3) if centre else list(machine.home_mm)
    study = cube_study(machine, side_mm=side_mm, centre_mm=middle, amount=amount)
    if json_output:
        show_json(study.to_dict())
        return
    console = Console(highlight=False)
    console.print(study.table().to_rich())
    console.print(study.summary().splitlines()[-1])
