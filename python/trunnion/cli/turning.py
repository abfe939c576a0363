"""``trunnion turning``: probe path, correction and diagnosis of a turned part, on files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, cast

import typer

from trunnion.base.errors import InputError, ProgramError
from trunnion.cli.common import clean_errors, say, show_json
from trunnion.data.diameters import read_diameters
from trunnion.nc import DIALECTS, Program
from trunnion.plot import plot_correction, plot_probe_path
from trunnion.setup import read_setup
from trunnion.turning import Profile, TurningProbe, correct, probe_path
from trunnion.turning.correction import Rule
from trunnion.turning.profile import Follows

app = typer.Typer(
    help="Probe a turned part, correct its finishing program, explain its diameter error.",
    no_args_is_help=True,
)

ProgramFile = Annotated[Path, typer.Argument(exists=True, help="finishing program")]
Dialect = Annotated[str, typer.Option(help="dialect: " + ", ".join(DIALECTS))]
Holds = Annotated[str, typer.Option(help="what it holds: contour, nose-centre or tip")]
Nose = Annotated[float, typer.Option(help="radius of the nose, mm")]
FeedInForce = Annotated[float | None, typer.Option(help="feed in force before the program")]
Codes = Annotated[
    list[str] | None,
    typer.Option("--machine-code", help="a code of this machine that moves no axis, as G4503"),
]
Out = Annotated[Path | None, typer.Option("--out", "-o", help="write the program here")]
Picture = Annotated[Path | None, typer.Option(help="write a picture here")]
AsJson = Annotated[bool, typer.Option("--json", help="print JSON instead of text")]


def _codes(codes: list[str] | None) -> list[tuple[str, float]]:
    out = []
    for code in codes or []:
        try:
            out.append((code[:1].upper(), float(code[1:])))
        except ValueError:
            raise InputError(f"machine code: got {code!r}, wanted one as G4503") from None
    return out


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the file's name before the line and column of a program's fault."""
    try:
        yield
    except ProgramError as error:
        raise ProgramError(f"{path}: {error}") from None
    except UnicodeDecodeError as error:
        got = f"byte {error.object[error.start]:#04x} at {error.start}"
        raise ProgramError(f"{path}: got {got}, wanted UTF-8 text") from None


def _read(path: Path, dialect: str) -> Program:
    return Program.parse(path.read_text(encoding="utf-8"), dialect)


def _write(program: Program, out: Path | None) -> None:
    if out is None:
        say(program.text().rstrip("\n"))
    else:
        out.write_text(program.text(), encoding="utf-8")
        say(f"program: {out}")


@app.command()
@clean_errors
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
    chuck_radius_mm: Annotated[float, typer.Option(help="0: no chuck to watch")] = 0.0,
    probe_feed: Annotated[float, typer.Option(help="measuring feed, mm/min")] = 120.0,
    out: Out = None,
    picture: Picture = None,
    as_json: AsJson = False,
) -> None:
    """Lay out the probe's path along the part of a finishing program; write the probe program."""
    with _naming(program):
        profile = Profile.from_program(
            _read(program, dialect),
            follows=cast(Follows, follows),
            nose_mm=nose_mm,
            feed=feed,
            machine_codes=_codes(machine_code),
        )
    found = probe_path(
        profile,
        TurningProbe(ball_diameter_mm, contact_angle_deg, body_diameter_mm),
        allowance_mm=allowance_mm,
        chuck_radius_mm=chuck_radius_mm,
    )
    linuxcnc = dialect == "linuxcnc-lathe"
    per_minute = ("G", 94) if linuxcnc else ("G", 98)
    modes = [[("G", 7), ("G", 18), ("G", 21), ("G", 90)]] if linuxcnc else []
    plain = dialect == "paper-um"
    head = [] if plain else [*modes, [per_minute]]
    tail = [] if plain else [[("M", 2 if linuxcnc else 30)]]
    written = found.program(dialect, feed=probe_feed, head=head, tail=tail)
    if picture is not None:
        _save(plot_probe_path(found).figure, picture)
    if as_json:
        show_json(found.to_dict() | {"program": written.text()})
        if out is not None:
            out.write_text(written.text(), encoding="utf-8")
        return
    say(found.summary())
    _write(written, out)


@app.command(name="correct")
@clean_errors
def correct_(
    program: ProgramFile,
    diameters: Annotated[Path, typer.Argument(exists=True, help="diameters.csv of one pass")],
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
    out: Out = None,
    picture: Picture = None,
    as_json: AsJson = False,
) -> None:
    """Correct a finishing program for measured diameters; say what that leaves."""
    with _naming(program):
        got = correct(
            _read(program, dialect),
            read_diameters(diameters),
            rule=cast(Rule, rule),
            unit_um=unit_um,
            bound_um=bound_um,
            window=window,
            look_ahead=look_ahead,
            follows=cast(Follows, follows),
            nose_mm=nose_mm,
            feed=feed,
            machine_codes=_codes(machine_code),
        )
    if picture is not None:
        _save(plot_correction(got).figure, picture)
    if as_json:
        show_json(got.to_dict())
        if out is not None:
            out.write_text(got.program.text(), encoding="utf-8")
        return
    say(got.summary())
    _write(got.program, out)


@app.command()
@clean_errors
def diagnose(
    diameters: Annotated[Path, typer.Argument(exists=True, help="diameters.csv")],
    setup: Annotated[Path, typer.Option(exists=True, help="setup.toml with \\[turning]")],
    html: Annotated[Path | None, typer.Option(help="write a page here")] = None,
    as_json: AsJson = False,
) -> None:
    """Name the cause of a diameter error, or what to turn next to tell causes apart."""
    from trunnion.models.kinds import diagnose as run
    from trunnion.models.next_passes import next_passes

    told = read_setup(setup)
    found = run(read_diameters(diameters), told)
    advice = next_passes(found)
    if html is not None:
        found.to_html(html)
    if as_json:
        passes = [a.to_dict() for a in advice]
        show_json(found.to_dict() | {"next_passes": passes})
        return
    say(found.summary())
    for one in advice[:1]:
        if one.parts:
            say(f"To tell them apart: {one}")
        else:
            say("To tell them apart: none of the passes that were tried would do.")


def _save(figure: object, target: Path) -> None:
    from matplotlib.figure import Figure

    if isinstance(figure, Figure):
        known = figure.canvas.get_supported_filetypes()
        if target.suffix.lstrip(".").lower() not in known:
            raise InputError(
                f"picture: got {target.name!r}, wanted a name that ends in one of "
                + ", ".join(sorted(known))
            )
        figure.savefig(target, dpi=130)
