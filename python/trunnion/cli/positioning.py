"""``trunnion positioning``: accuracy and repeatability of an axis by ISO 230-2."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.cli.command import CORRECTIONS, Answer, Html, command, group_of, save
from trunnion.cli.diagnose import DIAGNOSED, diagnose_as
from trunnion.cli.read import said_of
from trunnion.cli.schema import Of, Printed
from trunnion.cli.values import named_values

Stops = Annotated[Path, typer.Argument(metavar="STOPS", help="stops of the axis (CSV)")]


class Further(TypedDict, total=False):
    """What `results` prints as JSON beside the results."""

    conformity: Annotated[Any, Of(("trunnion.base.conformity:Conformity",))]
    compensationtable: Annotated[Any, Of(("trunnion.data.iso230_2:CompensationTable",))]


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = group_of(
        app, "positioning", "Positioning by ISO 230-2: results, instruments, diagnose."
    )
    command(
        group,
        values=(
            Printed("trunnion.data.iso230_2:Iso2302", Further),
            Printed("trunnion.data.iso230_2:Iso2302Rotary", Further),
        ),
        reads=True,
    )(results)
    compared = Printed("trunnion.models.instruments:InstrumentComparison")
    command(group, values=compared, reads=True)(instruments)
    command(group, "diagnose", values=DIAGNOSED, reads=True)(diagnose_as("positioning"))


def results(
    stops: Stops,
    instrument: Annotated[
        str | None, typer.Option(help="another instrument on the same stops: its column's NAME")
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(help="NAME=VALUE, such as accuracy_um=20: pass or fail by ISO 14253-1"),
    ] = None,
    standard_uncertainty: Annotated[
        float, typer.Option(min=0.0, help="of instrument, alignment and temperature, µm or arcsec")
    ] = 0.0,
    table: Annotated[bool, typer.Option(help="print the corrections of each target")] = False,
    comp_file: Annotated[
        Path | None, typer.Option(help="write the corrections as a COMP_FILE of LinuxCNC")
    ] = None,
    turns: Annotated[
        int,
        typer.Option(
            min=0, max=1000, help="of a rotary axis: repeat the COMP_FILE so many turns either way"
        ),
    ] = 0,
    html: Html = None,
) -> Answer:
    """Print reversal, repeatability, systematic deviation and accuracy of an axis."""
    data = tn.read_positioning(stops)
    found = (data if instrument is None else data.instrument(instrument)).iso230_2()
    more: list[Any] = []
    if tolerance:
        limits = named_values("--tolerance", tolerance)
        more.append(found.conformity(standard_uncertainty=standard_uncertainty, **limits))
    if table:
        more.append(found.compensation_table())
    values = found.to_dict()
    values |= {type(one).__name__.lower(): one.to_dict() for one in more}
    read = said_of(data)
    said = (*more[:1], *read, found, *more[1:]) if tolerance else (*read, found, *more)
    if comp_file is not None:
        from trunnion.controls import measured_comp_file

        text = measured_comp_file(found.compensation_table(), turns=turns)
        said = (
            *said,
            save(comp_file, lambda path: path.write_text(text, encoding="utf-8"), CORRECTIONS),
        )
    if html is not None:
        limits = {j.name: j.tolerance for j in more[0].judged} if tolerance else {}
        # The page has one U a figure, the terminal that of the scatter and what is judged by.
        std = {k: math.hypot(v, standard_uncertainty) for k, v in found.std_errors.items()}
        report = partial(replace(found, std_errors=std).to_html, data=data, tolerance=limits)
        said = (*said, save(html, report))
    return Answer(values, said, made_of={"data": data})


def instruments(
    stops: Stops,
) -> Answer:
    """Say of each cause whether it is the axis' or an instrument's, of several on one move."""
    data = tn.read_positioning(stops)
    return Answer.of(tn.whose_error(data), data=data)
