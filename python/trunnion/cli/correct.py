"""``trunnion correct``: a part program for a machine with errors."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

import trunnion as tn
from trunnion.cli.command import PROGRAM, Answer, Output, command, save
from trunnion.cli.given import one_set_up
from trunnion.cli.schema import Printed

if TYPE_CHECKING:
    from trunnion.controls.part_program import Coordinates


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app, values=Printed("trunnion.controls.part_program:CorrectedProgram"))(correct)


def correct(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="PROGRAM ERRORS SETUP",
            help="part program (LinuxCNC, mill), what `trunnion estimate --json` writes or errors "
            "by name (JSON), and the set-up (TOML)",
        ),
    ],
    output: Output = None,
    given: Annotated[
        str, typer.Option(help="X Y Z of the program: axes, or tcp (the tool point on the table)")
    ] = "axes",
    written: Annotated[
        str | None, typer.Option(help="X Y Z of the result: axes or tcp", show_default="as given")
    ] = None,
    origin_mm: Annotated[
        tuple[float, float, float],
        typer.Option(help="zero of the program in the machine frame, X Y Z"),
    ] = (0.0, 0.0, 0.0),
    tolerance_um: Annotated[float, typer.Option(help="of the tool point on feed moves")] = 2.0,
    any_size: Annotated[
        bool, typer.Option("--any-size", help="take errors beyond 2 mm or 1 degree, too")
    ] = False,
) -> Answer:
    """Rewrite a part program so that the machine with its errors makes the part as programmed."""
    from trunnion.controls import correct_program

    (program, errors), file = one_set_up(files, (2, 2), "program and errors")
    if program.suffix.lower() == ".json":
        program, errors = errors, program
    try:
        text = program.read_text(encoding="utf-8")
        made = correct_program(
            tn.read_setup(file),
            tn.read_estimate(errors),
            text,
            given=cast("Coordinates", given),
            written=cast("Coordinates | None", written),
            origin_mm=origin_mm,
            tolerance_um=tolerance_um,
            any_size=any_size,
        )
    except tn.ProgramError as error:
        raise tn.ProgramError(f"{program}: {error}") from None
    except UnicodeDecodeError as error:
        raise tn.ProgramError(f"{program}: {error}; expected UTF-8 text") from None
    if output is None:
        return Answer(made, (made.text.rstrip("\n"),))
    write = partial(Path.write_text, data=made.text, encoding="utf-8")
    return Answer.of(made, save(output, write, PROGRAM))
