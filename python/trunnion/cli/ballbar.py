"""``trunnion ballbar``: ball-bar tests of three-axis and hybrid machines."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.cli.command import Answer, command, group_of, save
from trunnion.cli.diagnose import DIAGNOSED, diagnose_as
from trunnion.cli.given import sort_files
from trunnion.cli.hybrid import mechanism_of
from trunnion.cli.schema import Of, Printed

Lengths = Annotated[
    list[Path],
    typer.Argument(
        metavar="LENGTHS [SETUP]",
        help="ball-bar lengths (CSV), and the set-up (TOML) with tables \\[ballbar] and \\[hybrid]",
    ),
]


class Circles(TypedDict):
    """What `results` prints as JSON."""

    circles: list[Annotated[Any, Of(("trunnion.data.iso230_4:Iso2304",))]]


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = group_of(
        app, "ballbar", "Ball-bar tests: results by ISO 230-4, diagnose, identify, plan."
    )
    command(group, "diagnose", values=DIAGNOSED, reads=True)(diagnose_as("ballbar"))
    command(group, values=Printed(keys=Circles), reads=True)(results)
    command(group, values=Printed("trunnion.hybrid.identify:BallbarIdentification"), reads=True)(
        identify
    )
    seen = Printed("trunnion.hybrid.identifiability:Identifiability")
    command(group, values=seen, reads=True)(plan)


def results(
    files: Lengths,
    html: Annotated[
        Path | None, typer.Option(help="write a page with the polar plot here, one a circle")
    ] = None,
) -> Answer:
    """Evaluate circles by ISO 230-4: circular deviation G, hysteresis H, radial deviation F."""
    data, set_ups = sort_files(files, (1, 1), (0, 1), "lengths")
    setup = _stated(set_ups)
    lengths = tn.read_ballbar(data[0])
    circles = tn.iso230_4(lengths)
    shown: list[Any] = [*circles]
    if html is not None:
        for circle in circles:
            name = html if len(circles) == 1 else html.with_stem(f"{html.stem}-{circle.setup}")
            shown.append(save(name, partial(circle.to_html, data=lengths, setup=setup)))
    values = {"circles": [circle.to_dict() for circle in circles]}
    return Answer(values, tuple(shown), made_of={"data": lengths, "setup": setup})


def _stated(set_ups: list[Path]) -> tn.Setup | None:
    """Return the set-up, where one is given."""
    return tn.read_setup(set_ups[0]) if set_ups else None


def identify(
    files: Lengths,
    sigma_um: Annotated[float | None, typer.Option(help="noise of a reading, 1 σ")] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="errors known beforehand to this, 1 σ, µm or arcsec; needs --sigma-um"),
    ] = None,
) -> Answer:
    """Estimate the 17 errors of the hybrid machine."""
    data, set_ups = sort_files(files, (1, 1), (0, 1), "lengths")
    lengths = tn.read_ballbar(data[0])
    found = tn.hybrid.identify_ballbar(
        lengths, mechanism_of(set_ups), sigma_um=sigma_um, tolerance=tolerance
    )
    return Answer.of(found, data=lengths, setup=_stated(set_ups))


def plan(
    files: Lengths,
    sigma_um: Annotated[float, typer.Option(help="noise of a reading, 1 σ")] = 0.5,
) -> Answer:
    """Say what readings at these poses of the hybrid machine can determine."""
    data, set_ups = sort_files(files, (1, 1), (0, 1), "lengths")
    lengths = tn.read_ballbar(data[0])
    found = tn.hybrid.identifiability(lengths, mechanism_of(set_ups), sigma_um=sigma_um)
    return Answer.of(found, data=lengths, setup=_stated(set_ups))
