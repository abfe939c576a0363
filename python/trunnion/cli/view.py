"""``trunnion view``: measurements, set-ups, estimates and programs in space, as one page."""

from __future__ import annotations

import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.cli.command import PAGE, Answer, command, is_program, save
from trunnion.cli.given import near_file
from trunnion.cli.schema import Printed

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


class Views(TypedDict):
    """What `view` prints as JSON."""

    page: str
    views: list[str]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app, values=Printed(keys=Views), reads=True)(view)


def view(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES",
            help="touches, a plan, points or a sweep (CSV), errors (JSON), a part program (.ngc), "
            "and the set-up (TOML) where it is needed",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="page to write")] = Path(
        "view.html"
    ),
    residuals: Annotated[
        bool, typer.Option("--residuals", help="identify the touches and draw their residuals")
    ] = False,
    dialect: Annotated[str, typer.Option(help="of part programs")] = "linuxcnc",
    open_: Annotated[bool, typer.Option("--open", help="open the page in a browser")] = False,
) -> Answer:
    """Write one page with views in space that one can turn; it works without a network."""
    for file in files:
        if not file.exists():
            raise tn.InputError(f"{file}: no such file or directory{near_file(file)}")
    set_ups = [file for file in files if file.suffix.lower() == ".toml"]
    if len(set_ups) > 1:
        names = ", ".join(map(str, set_ups))
        raise tn.InputError(f"files: got the set-ups {names}, expected at most one")
    setup = tn.read_setup(set_ups[0]) if set_ups else None
    others = [file for file in files if file not in set_ups]
    views = [
        (file.name, figure)
        for file in others
        for figure in _of_file(file, setup, residuals=residuals, dialect=dialect)
    ]
    if not others and setup is not None:
        views.append((set_ups[0].name, _of_setup(setup)))
    page = _page(views, ", ".join(file.name for file in files))
    said = save(output, lambda path: path.write_text(page, encoding="utf-8"), PAGE)
    if open_:
        webbrowser.open(output.resolve().as_uri())
    return Answer({"page": str(output), "views": [name for name, _ in views]}, (said,))


def _page(views: list[tuple[str, Figure]], title: str) -> str:
    from trunnion.plot.scenes.page import views_page

    return views_page(views, title)


def _of_setup(setup: tn.Setup) -> Figure:
    if setup.hybrid:
        from trunnion.hybrid import Mechanism

        return tn.plot.scene(Mechanism.from_setup(setup))
    return tn.plot.scene(setup)


def _of_file(
    file: Path, setup: tn.Setup | None, *, residuals: bool, dialect: str
) -> Iterator[Figure]:
    if is_program(file):
        text = file.read_text(encoding="utf-8", errors="surrogateescape")
        yield tn.plot.scene(tn.nc.Program.parse(text, dialect))
        return
    if file.suffix.lower() == ".json":
        yield _volume(file, _needed(setup, file))
        return
    data: Any = tn.read(file)
    if isinstance(data, tn.Levels):
        data = data.flatness()
    if not isinstance(data, tn.Touches):
        yield tn.plot.scene(data)
        return
    given = _needed(setup, file)
    if residuals:
        yield tn.plot.scene(tn.identify(data, given), data, given)
    else:
        yield tn.plot.scene(data, given)


def _needed(setup: tn.Setup | None, file: Path) -> tn.Setup:
    if setup is None:
        raise tn.InputError(f"{file}: got no set-up (.toml) beside it, expected one")
    return setup


def _volume(file: Path, setup: tn.Setup) -> Figure:
    """The error as estimated, and what the parameters of a control leave of it.

    Of errors that no compensation follows in their frame, the error alone.
    """
    known = tn.read_estimate(file)
    points = (7, 7, 5)
    before = tn.volumetric_error(setup, known, points=points)
    frame = known.control_frame
    if frame is not None and any(frame.hindrances(setup.control.centre_mm)):
        name = "left by the corrections" if frame.corrected else "as estimated"
        return tn.plot.scene(before, names=(name,))
    parameters = tn.cnc_parameters(setup, known)
    after = tn.volumetric_error(setup, known, compensation=parameters, points=points)
    names = ("as estimated", "after compensation by CNC parameters")
    return tn.plot.scene(before, after, names=names)
