"""``trunnion levels``: straightness, twist and flatness from the angles of a level."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.cli.command import Answer, Html, command, group_of, save
from trunnion.cli.diagnose import DIAGNOSED, diagnose_as
from trunnion.cli.schema import Of, Printed


class Results(TypedDict, total=False):
    """What `results` prints as JSON: what the readings determine."""

    straightness: Annotated[Any, Of(("trunnion.data.flatness:Straightness",))]
    flatness: Annotated[Any, Of(("trunnion.data.flatness:Flatness",))]
    twist: Annotated[Any, Of(("trunnion.data.flatness:Twist",))]


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = group_of(app, "levels", "Levels along a line or on a grid: results, diagnose.")
    command(group, values=Printed(keys=Results), reads=True)(results)
    command(group, "diagnose", values=DIAGNOSED, reads=True)(diagnose_as("levels"))


def results(
    readings: Annotated[Path, typer.Argument(metavar="READINGS", help="angles of a level (CSV)")],
    html: Html = None,
) -> Answer:
    """Print straightness and twist of a line, or flatness and twist of a surface."""
    data = tn.read_levels(readings)
    found = data.results()
    if not found:
        count = len(data.stations[0])
        raise tn.DataError(
            f"{readings}: got {count} places with {' and '.join(data.components)}, expected at "
            "least 3 of a line, or 4 of a grid with along and across"
        )
    values = {type(one).__name__.lower(): one.to_dict() for one in found}
    said: list[Any] = list(found)
    for one in found:
        if html is None:
            break
        several = f"{html.stem}-{type(one).__name__.lower()}"
        name = html.with_stem(several) if len(found) > 1 else html
        said.append(save(name, partial(one.to_html, data=data)))
    return Answer(values, tuple(said), made_of={"data": data})
