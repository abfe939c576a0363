"""``trunnion turning``: probe path, correction and diagnosis of a turned part, on files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict, cast

import typer

import trunnion as tn
from trunnion.cli.command import PROGRAM, Answer, Output, check_outputs, command, group_of, save
from trunnion.cli.diagnose import DIAGNOSED, diagnose_as
from trunnion.cli.given import sort_files
from trunnion.cli.schema import Printed

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

    from trunnion.nc import Program
    from trunnion.turning.correction import Rule
    from trunnion.turning.profile import Blocks, Follows

ProgramFile = Annotated[Path, typer.Argument(metavar="PROGRAM", help="finishing program")]
Dialect = Annotated[str, typer.Option(help="dialect of the program")]
Holds = Annotated[str, typer.Option(help="what it holds: contour, nose-centre or tip")]
Nose = Annotated[float, typer.Option(help="radius of the nose, mm")]
FeedInForce = Annotated[float | None, typer.Option(help="feed in force before the program")]
Codes = Annotated[
    list[str] | None,
    typer.Option("--machine-code", help="a code of this machine that moves no axis, as G4503"),
]
Picture = Annotated[Path | None, typer.Option(help="write a picture here")]


class Text(TypedDict):
    """What `path` prints as JSON beside the path."""

    program: str


def register(app: typer.Typer) -> None:
    """Add the group to the application."""
    group = group_of(
        app,
        "turning",
        "Probe a turned part, correct its finishing program, explain its diameter error.",
    )
    command(group, values=Printed("trunnion.turning.profile:Finishing"))(finish)
    command(group, values=Printed("trunnion.turning.probing:ProbePath", Text))(path)
    command(group, values=Printed("trunnion.turning.correction:Correction"), reads=True)(correct)
    command(group, "diagnose", values=DIAGNOSED, reads=True)(diagnose_as("diameters"))


def _codes(codes: list[str] | None) -> list[tuple[str, float]]:
    out = []
    for code in codes or []:
        try:
            out.append((code[:1].upper(), float(code[1:])))
        except ValueError:
            raise tn.InputError(f"machine code: got {code!r}, expected one as G4503") from None
    return out


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the file's name before the line and column of a program's fault."""
    try:
        yield
    except tn.ProgramError as error:
        raise tn.ProgramError(f"{path}: {error}") from None
    except UnicodeDecodeError as error:
        got = f"byte {error.object[error.start]:#04x} at {error.start}"
        raise tn.ProgramError(f"{path}: got {got}, expected UTF-8 text") from None


def _read(path: Path, dialect: str) -> Program:
    return tn.nc.Program.parse(path.read_text(encoding="utf-8"), dialect)


def _written(program: Program, output: Path | None) -> str:
    """Write the program, or return its text where there is no file to write to."""
    text = program.text()
    if output is None:
        return text.rstrip("\n")
    return save(output, lambda path: path.write_text(text, encoding="utf-8"), PROGRAM)


def finish(
    shape: Annotated[
        Path,
        typer.Argument(
            help="input points of the part (CSV): z_mm, x_mm (radius), type (1 to 8), radius_mm"
        ),
    ],
    dialect: Dialect = "linuxcnc-lathe",
    follows: Holds = "contour",
    nose_mm: Nose = 0.0,
    feed: Annotated[float, typer.Option(help="mm a revolution")] = 0.1,
    speed_m_min: Annotated[float, typer.Option(help="cutting speed")] = 200.0,
    face: Annotated[bool, typer.Option(help="cut the first line, the face, too")] = True,
    steepest_fall: Annotated[float, typer.Option(help="largest -dx/dz the tool follows")] = 0.6,
    access_z_mm: Annotated[
        list[float] | None, typer.Option(help="where the tool may plunge behind a fall")
    ] = None,
    output: Output = None,
    picture: Picture = None,
) -> Answer:
    """Write the finishing program of a part from the points of its shape."""
    _check_picture(picture)
    profile = tn.turning.read_shape(shape)
    head, tail = _frame(dialect, speed_m_min, follows)
    made = profile.finishing(
        dialect,
        follows=cast("Follows", follows),
        nose_mm=nose_mm,
        first_element=0 if face else 1,
        steepest_fall=steepest_fall,
        access_z_mm=access_z_mm or (),
        feed=feed,
        head=head,
        tail=tail,
    )
    saved = _saved(picture, lambda: tn.plot.plot_profile(profile).figure)
    return Answer(made, (made, *saved, _written(made.program, output)))


def _frame(dialect: str, speed_m_min: float, follows: str) -> tuple[Blocks, Blocks]:
    """Blocks before and after the contour: modes, spindle, compensation of the nose; the end."""
    from trunnion.base.checks import within

    if dialect == "paper-um":
        return [], []
    within("speed_m_min", speed_m_min, 1e-3)
    linuxcnc = dialect == "linuxcnc-lathe"
    nose = follows == "contour"
    head: list[list[tuple[str, float]]] = []
    if linuxcnc:
        head.append([("G", 7), ("G", 18), ("G", 21), ("G", 90)])
    head.append([("G", 96), *([("D", 3000.0)] if linuxcnc else []), ("S", speed_m_min), ("M", 3)])
    head.append([("G", 95 if linuxcnc else 99)])
    if nose and not linuxcnc:
        head.append([("G", 42)])
    tail = [[("G", 40)]] if nose and not linuxcnc else []
    return head, [*tail, [("M", 5)], [("M", 2 if linuxcnc else 30)]]


def path(
    program: ProgramFile,
    dialect: Dialect = "linuxcnc-lathe",
    follows: Holds = "contour",
    nose_mm: Nose = 0.0,
    feed: FeedInForce = None,
    machine_code: Codes = None,
    ball_diameter_mm: Annotated[float, typer.Option(help="ball of the probe, mm")] = 3.175,
    contact_angle_deg: Annotated[float, typer.Option(help="full angle of its cone, deg")] = 89.0,
    body_diameter_mm: Annotated[float, typer.Option(help="its body, mm")] = 4.9,
    allowance_mm: Annotated[float, typer.Option(help="still on the part, mm")] = 0.5,
    chuck_radius_mm: Annotated[float | None, typer.Option(help="radius over its jaws")] = None,
    chuck_face_mm: Annotated[float, typer.Option(help="Z of the face of its jaws")] = 0.0,
    no_chuck: Annotated[bool, typer.Option("--no-chuck", help="none to keep clear of")] = False,
    probe_feed: Annotated[float, typer.Option(help="measuring feed, mm/min")] = 120.0,
    output: Output = None,
    picture: Picture = None,
) -> Answer:
    """Lay out the probe's path along the part of a finishing program; write the probe program."""
    from trunnion.base.checks import within
    from trunnion.turning.profile import LOWEST_FEED

    within("--probe-feed", probe_feed, LOWEST_FEED)
    _check_picture(picture)
    with _naming(program):
        profile = tn.turning.Profile.from_program(
            _read(program, dialect),
            follows=cast("Follows", follows),
            nose_mm=nose_mm,
            feed=feed,
            machine_codes=_codes(machine_code),
        )
    found = tn.turning.probe_path(
        profile,
        tn.turning.TurningProbe(ball_diameter_mm, contact_angle_deg, body_diameter_mm),
        allowance_mm=allowance_mm,
        chuck_radius_mm=_chuck(chuck_radius_mm, no_chuck),
        chuck_face_mm=chuck_face_mm,
    )
    linuxcnc = dialect == "linuxcnc-lathe"
    per_minute = ("G", 94) if linuxcnc else ("G", 98)
    # No radius of a nose, and no corner that is rounded off: the ball would leave its path.
    modes = [("G", 7), ("G", 18), ("G", 21), ("G", 40), ("G", 61), ("G", 90)]
    safe: Blocks = [[("M", 5)], modes if linuxcnc else [("G", 40)]]
    plain = dialect == "paper-um"
    head = [] if plain else [*safe, [per_minute]]
    tail = [] if plain else [[("M", 2 if linuxcnc else 30)]]
    written = found.program(dialect, feed=probe_feed, head=head, tail=tail)
    saved = _saved(picture, lambda: tn.plot.plot_probe_path(found).figure)
    values = found.to_dict() | {"program": written.text()}
    return Answer(values, (found, *saved, _written(written, output)))


def _chuck(radius_mm: float | None, no_chuck: bool) -> float:
    """Radius of the chuck; 0 where the user says that there is none."""
    if (radius_mm is None) != no_chuck:
        got = "neither" if radius_mm is None else "both"
        raise tn.InputError(
            f"chuck: got {got} of --chuck-radius-mm and --no-chuck, expected one: unless it keeps "
            "clear of the jaws, the probe measures down to the last line of the part and runs its "
            "body into them"
        )
    return radius_mm or 0.0


def correct(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIAMETERS PROGRAM",
            help="diameters of one pass (CSV) and the finishing program, in either order",
        ),
    ],
    dialect: Dialect = "linuxcnc-lathe",
    rule: Annotated[str, typer.Option(help="bounded, paper, every-window or mid-run")] = "bounded",
    unit_um: Annotated[float, typer.Option(help="smallest correction, µm on the diameter")] = 1.0,
    bound_um: Annotated[float, typer.Option(help="left beyond half a unit, rule bounded")] = 1.0,
    window: Annotated[int, typer.Option(help="readings averaged")] = 5,
    look_ahead: Annotated[bool, typer.Option(help="start corner takes the first block's k")] = True,
    follows: Holds = "contour",
    nose_mm: Nose = 0.0,
    feed: FeedInForce = None,
    machine_code: Codes = None,
    output: Output = None,
    picture: Picture = None,
) -> Answer:
    """Correct a finishing program for measured diameters; say what that leaves."""
    _check_picture(picture)
    both, _ = sort_files(files, (2, 2), (0, 0), "diameters and program")
    found = [file for file in both if file.suffix.lower() == ".csv"]
    if len(found) != 1:
        raise tn.InputError(
            f"files: got {len(found)} that end in .csv, expected one (the diameters) and a program"
        )
    program = next(file for file in both if file != found[0])
    with _naming(program):
        got = tn.turning.correct(
            _read(program, dialect),
            tn.read_diameters(found[0]),
            rule=cast("Rule", rule),
            unit_um=unit_um,
            bound_um=bound_um,
            window=window,
            look_ahead=look_ahead,
            follows=cast("Follows", follows),
            nose_mm=nose_mm,
            feed=feed,
            machine_codes=_codes(machine_code),
        )
    saved = _saved(picture, lambda: tn.plot.plot_correction(got).figure)
    return Answer(got, (got, *saved, _written(got.program, output)))


def _check_picture(target: Path | None) -> None:
    """Refuse a name that no picture can be written to, before anything is computed."""
    if target is None:
        return
    from matplotlib.backend_bases import FigureCanvasBase

    known = FigureCanvasBase.get_supported_filetypes()
    if target.suffix.lstrip(".").lower() not in known:
        raise tn.InputError(
            f"--picture: got {target.name!r}, expected a name that ends in one of "
            + ", ".join(sorted(known))
        )
    check_outputs(target)


def _saved(target: Path | None, draw: Callable[[], Figure | SubFigure]) -> tuple[str, ...]:
    """Draw a picture and save it, where one is wanted."""
    if target is None:
        return ()
    from trunnion.plot.axes import close

    whole = draw().get_figure(root=True)
    try:
        return (save(target, lambda path: whole.savefig(path, dpi=130)),)
    finally:
        close(whole)  # pyplot would keep it
