"""``trunnion compensate``: from estimated errors to tables and files of corrections."""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.cli.command import Answer, Html, check_outputs, command, one_set_up, save
from trunnion.cli.schema import Of, Printed

if TYPE_CHECKING:
    from trunnion.base.report import Result, Table
    from trunnion.compensation import (
        Compensation,
        ErrorMap,
        MachineErrors,
        ResidualInterval,
        VolumetricError,
    )
    from trunnion.controls import ControlFiles
    from trunnion.machine.estimate import Estimate
    from trunnion.setup import Setup

# Between the nodes of a map in steps of 15°, where it is at its worst.
_TILTS, _TURNS = tuple(range(-90, 91, 10)), tuple(range(0, 361, 20))
_POINTS = (7, 7, 5)


Control = Annotated[
    str | None,
    typer.Option(
        help="write what this control loads: linuxcnc, isg or etalon (TF5280), twincat, siemens, "
        "heidenhain, or table (any control)",
        show_default=False,
    ),
]
Kinematics = Annotated[
    str,
    typer.Option(
        help="of LinuxCNC: component (knows every location error) or stock (xyzac-trt-kins, "
        "Pocket NC)"
    ),
]
Present = Annotated[
    list[Path] | None,
    typer.Option(help="its .hal, .ini and .inc files when it was measured", show_default=False),
]
Stated = Annotated[
    list[str] | None,
    typer.Option(help="NAME=VALUE that the control's documentation does not say", metavar="TEXT"),
]
AnySize = Annotated[
    bool, typer.Option("--any-size", help="write errors beyond 2 mm or 1 degree, too")
]


class Compensated(TypedDict):
    """What `compensate` prints as JSON without --control."""

    parameters: Annotated[Any, Of(("trunnion.compensation.parameters:CncParameters",))]
    at_zero: dict[str, Annotated[Any, Of(("trunnion.compensation.volumetric:VolumetricError",))]]
    over_range: dict[str, Annotated[Any, Of(("trunnion.compensation.volumetric:VolumetricError",))]]


class Predicted(Compensated, total=False):
    """The same; the last only of an estimate with a covariance."""

    predicted_interval_over_range: Annotated[
        Any, Of(("trunnion.compensation.uncertainty:ResidualInterval",))
    ]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(
        app,
        values=(Printed(keys=Predicted), Printed("trunnion.controls.files:ControlFiles")),
    )(compensate)


def compensate(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="ERRORS SETUP",
            help="what `trunnion estimate --json` writes, or names and values as JSON "
            '({"EX0C": 15.0, ...}, µm and arcsec), and the set-up (TOML)',
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="folder for the files")] = Path(
        "compensation"
    ),
    linear_step_mm: Annotated[float, typer.Option(help="largest step of the map's X, Y, Z")] = 50.0,
    rotary_step_deg: Annotated[float, typer.Option(help="largest step of its rotary axes")] = 15.0,
    seed: Annotated[int, typer.Option(help="of the draws for the predicted interval")] = 0,
    control: Control = None,
    kinematics: Kinematics = "component",
    present: Present = None,
    stated: Stated = None,
    range_: Annotated[
        list[str] | None,
        typer.Option("--range", help="travel of an axis for its table, as X=-200:300"),
    ] = None,
    any_size: AnySize = False,
    html: Html = None,
) -> Answer:
    """Compute corrections: what each kind leaves, and error_map.csv, parameters.json and others.

    With --control, the files that this control loads instead, with old and new values.
    """
    from trunnion.compensation import MachineErrors

    estimates, file = one_set_up(files, (1, 1), "estimates")
    setup = _with_ranges(tn.read_setup(file), range_ or ())
    estimate = tn.read_estimate(estimates[0])
    if control is not None:
        given = {"any_size": any_size, "seed": seed}
        linuxcnc = {"kinematics": kinematics, "present": present or ()}
        made = _for_control(control, setup, estimate, _pairs(stated or ()), linuxcnc, given)
        check_outputs(*(output / name for name in made.files))
        output.mkdir(parents=True, exist_ok=True)
        said = [save(output / name, _text(t)) for name, t in made.files.items()]
        inputs = [estimates[0], *(present or ())]
        return Answer.of(made, *said, *_report(html, made, setup, inputs))
    known = MachineErrors.of(setup, estimate)
    table = tn.error_map(
        setup, known, **_ends(setup), linear_step_mm=linear_step_mm, rotary_step_deg=rotary_step_deg
    )
    answer = _general(setup, estimate, known, table, output, seed)
    more = (
        []
        if html is None
        else _report(
            html,
            tn.cnc_parameters(setup, dataclasses.replace(known, own=())),
            setup,
            estimates[:1],
        )
    )
    return Answer(answer.values, (*answer.shown, *more))


def _report(html: Path | None, result: Result, setup: Setup, inputs: list[Path]) -> list[str]:
    """Write the report of a compensation where one is wanted; inputs: files it was made of."""
    if html is None:
        return []
    return [save(html, functools.partial(result.to_html, data=inputs, setup=setup))]


def _general(
    setup: Setup,
    estimate: Estimate,
    known: MachineErrors,
    table: ErrorMap,
    output: Path,
    seed: int,
) -> Answer:
    """Error map, parameters and pictures, for any control."""
    # Parameters and tool direction follow no motion of the linear axes; the fields below have them.
    parameters = tn.cnc_parameters(setup, dataclasses.replace(known, own=()))
    kinds: dict[str, Compensation | None] = {
        "nothing compensated": None,
        "error map": table,
        "linear axes, exact": tn.ModelCompensation(known),
        "CNC parameters": parameters,
        "CNC parameters, rounded": parameters.rounded(setup),
    }
    if not known.own:
        kinds["all axes, exact"] = tn.InverseCompensation(known)
    at_zero = {name: _field(setup, known, kind, over=False) for name, kind in kinds.items()}
    over = {name: _field(setup, known, kind, over=True) for name, kind in kinds.items()}
    found: dict[str, Any] = {
        what: {name: value.to_dict() for name, value in fields.items()}
        for what, fields in (("at_zero", at_zero), ("over_range", over))
    }
    shown: list[Any] = [_table(at_zero, over), *parameters.tables()]
    interval = None if known.own else _interval(setup, estimate, seed)
    if interval is not None:
        shown.append(interval.table())
        found["predicted_interval_over_range"] = interval.to_dict()

    names = ("error_map.csv", "parameters.json", "volumetric.json", "compensation.png")
    check_outputs(*(output / name for name in names))
    output.mkdir(parents=True, exist_ok=True)
    shown += [
        table.summary(),
        save(output / "error_map.csv", table.to_csv),
        save(output / "parameters.json", _json(parameters.to_dict())),
        save(output / "volumetric.json", _json(found)),
        save(
            output / names[-1], lambda path: _picture(setup, known, table, parameters, over, path)
        ),
    ]
    return Answer({"parameters": parameters.to_dict(), **found}, tuple(shown))


def _for_control(
    control: str,
    setup: Setup,
    estimate: Estimate,
    stated: dict[str, str],
    linuxcnc: dict[str, Any],
    given: dict[str, Any],
) -> ControlFiles:
    """Files for a control."""
    from trunnion import controls
    from trunnion.base.checks import choose

    writers: dict[str, Callable[..., ControlFiles]] = {
        "linuxcnc": functools.partial(controls.linuxcnc_files, **linuxcnc),
        "isg": functools.partial(controls.isg_files, stated=stated),
        "etalon": functools.partial(controls.isg_files, layout="etalon", stated=stated),
        "siemens": functools.partial(controls.siemens_files, stated=stated),
        "heidenhain": functools.partial(controls.heidenhain_files, stated=stated),
        "twincat": controls.twincat_files,
        "table": controls.iso_table,
    }
    return writers[choose("--control", control, writers)](setup, estimate, **given)


def _pairs(texts: Iterable[str]) -> dict[str, str]:
    """NAME=VALUE as a mapping."""
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise tn.InputError(f"--stated: got {text!r}, expected NAME=VALUE")
        pairs[name.strip()] = value.strip()
    return pairs


def _with_ranges(setup: Setup, texts: Iterable[str]) -> Setup:
    """Return the set-up with the travel of axes from the command line."""
    axes = dict(setup.axes)
    for text in texts:
        name, _, limits = text.partition("=")
        low, _, high = limits.partition(":")
        try:
            span = (float(low), float(high))
        except ValueError:
            raise tn.InputError(f"--range: got {text!r}, expected one as X=-200:300") from None
        letter = name.strip().upper()
        axis = axes.get(letter, tn.AxisSetup())
        axes[letter] = (
            dataclasses.replace(axis, range_mm=span)
            if letter in ("X", "Y", "Z")
            else dataclasses.replace(axis, range_deg=span)
        )
    return dataclasses.replace(setup, axes=axes) if axes != dict(setup.axes) else setup


def _text(text: str) -> Callable[[Path], object]:
    """Return what writes a text to a path."""
    return lambda path: path.write_text(text, encoding="utf-8")


def _range(setup: Setup) -> dict[str, Any]:
    """Rotary positions over the whole range."""
    from trunnion.machine.chain import Chain

    chain = Chain(setup)
    at: dict[str, Any] = {"a_deg": 0, "b_deg": None, "c_deg": 0}
    for letter in chain.letters:
        at[f"{letter.lower()}_deg"] = _TURNS if letter == chain.turning else _TILTS
    return at


def _ends(setup: Setup) -> dict[str, Any]:
    """Lowest and highest rotary positions of the same range, for an error map."""
    given = {name: at for name, at in _range(setup).items() if isinstance(at, tuple)}
    return {name: (float(at[0]), float(at[-1])) for name, at in given.items()}


def _field(
    setup: Setup, known: MachineErrors, kind: Compensation | None, *, over: bool
) -> VolumetricError:
    if not over:
        return tn.volumetric_error(setup, known, compensation=kind, points=_POINTS)
    return tn.volumetric_error(setup, known, **_range(setup), compensation=kind, points=(3, 3, 2))


def _interval(setup: Setup, estimate: Estimate, seed: int) -> ResidualInterval | None:
    """Predicted interval over the whole range, where the estimate has a covariance."""
    if not estimate.names:
        return None
    return tn.residual_interval(setup, estimate, **_range(setup), draws=1000, seed=seed)


def _table(at_zero: dict[str, VolumetricError], over: dict[str, VolumetricError]) -> Table:
    from trunnion.base.report import Table

    rows = [
        (
            name,
            f"{zero.max_um:.3f}",
            f"{zero.rms_um:.3f}",
            f"{whole.max_um:.3f}",
            f"{whole.rms_um:.3f}",
            f"{float(whole.direction_by_pose_arcsec.max()):.2f}",
        )
        for (name, zero), whole in zip(at_zero.items(), over.values(), strict=True)
    ]
    return Table.of(
        "Volumetric error of the machine as estimated, µm; tool direction, arcsec",
        ("", "at zero: max", "rms", "all A/B, C: max", "rms", "direction"),
        rows,
    )


def _json(content: Any) -> Callable[[Path], object]:
    """Return what writes the content to a path."""
    text = json.dumps(content, indent=2) + "\n"
    return lambda path: path.write_text(text, encoding="utf-8")


def _picture(
    setup: Setup,
    known: MachineErrors,
    table: Compensation,
    parameters: Compensation,
    over: dict[str, VolumetricError],
    path: Path,
) -> None:
    """Sections at zero and the largest error over the poses, before and after, each on its scale.

    Poses are drawn for two rotary axes.
    """
    from matplotlib.figure import Figure

    shown = {"nothing compensated": None, "error map": table, "CNC parameters": parameters}
    pictures = []
    for name, kind in shown.items():
        section = tn.volumetric_error(setup, known, compensation=kind)
        p = tn.plot.volumetric_picture(section, plane="xz", at_mm=0.0)
        title = f"{name}, axes at zero, y = 0; in the box up to {section.max_um:.3g} µm"
        pictures.append(dataclasses.replace(p, title=title))
    if all(field.max_by_pose_um.ndim == 2 for field in over.values()):
        for name in shown:
            p = tn.plot.poses_picture(over[name])
            title = f"{name}, over the range: largest {over[name].max_um:.3g} µm"
            pictures.append(dataclasses.replace(p, title=title))
    figure = Figure(figsize=(16.0, 3.6 * len(pictures) / 3), layout="constrained")
    tn.plot.panels(pictures, columns=3, figure=figure)
    figure.savefig(path, dpi=120)
