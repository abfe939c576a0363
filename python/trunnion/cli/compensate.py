"""``trunnion compensate``: from estimated errors to tables and files of corrections."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import trunnion as tn
from trunnion.base.output import check_folder
from trunnion.cli.command import Answer, Html, check_outputs, command, save
from trunnion.cli.given import one_set_up
from trunnion.cli.schema import Printed

if TYPE_CHECKING:
    from trunnion.compensation import Compensation, ErrorMap
    from trunnion.controls import ControlFiles
    from trunnion.machine.estimate import Estimate
    from trunnion.setup import Setup

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


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(
        app,
        values=(
            Printed("trunnion.compensation.forecast:CompensationForecast"),
            Printed("trunnion.controls.files:ControlFiles"),
        ),
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
    seed: Annotated[int, typer.Option(min=0, help="of the draws for the predicted interval")] = 0,
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
    check_folder(output)
    estimates, file = one_set_up(files, (1, 1), "estimates")
    setup = _with_ranges(tn.read_setup(file), range_ or ())
    estimate = tn.read_estimate(estimates[0])
    if control is not None:
        given = {"any_size": any_size, "seed": seed}
        linuxcnc = {"kinematics": kinematics, "present": present or ()}
        made = _for_control(control, setup, estimate, _pairs(stated or ()), linuxcnc, given)
        output.mkdir(exist_ok=True)
        check_outputs(*(output / name for name in made.files))
        said = [save(output / name, _text(t)) for name, t in made.files.items()]
        inputs = [estimates[0], *(present or ())]
        return Answer.of(made, *said, data=inputs, setup=setup).with_page(html)
    table = tn.error_map(
        setup, estimate, **_ends(setup), linear_step_mm=linear_step_mm,
        rotary_step_deg=rotary_step_deg,
    )  # fmt: skip
    answer = _general(setup, estimate, table, output, seed)
    made_of = {"data": estimates, "setup": setup}
    return dataclasses.replace(answer, made_of=made_of).with_page(html)


def _general(setup: Setup, estimate: Estimate, table: ErrorMap, output: Path, seed: int) -> Answer:
    """Error map, parameters and pictures, for any control."""
    from trunnion.compensation import compensation_forecast

    found = compensation_forecast(setup, estimate, table=table, seed=seed)
    parameters = found.parameters
    names = ("error_map.csv", "parameters.json", "volumetric.json", "compensation.png")
    written = [output / name for name in names]
    output.mkdir(exist_ok=True)
    check_outputs(*written)
    said = [
        save(written[0], table.to_csv),
        save(written[1], _json(parameters.to_dict())),
        save(written[2], _json(found.to_dict())),
        save(written[3], lambda path: _picture(setup, estimate, table, parameters, path)),
    ]
    sums = {str(p): hashlib.sha256(p.read_bytes()).hexdigest() for p in written}
    found = dataclasses.replace(found, files=sums)
    return Answer.of(found, table.summary(), *said)


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


def _ends(setup: Setup) -> dict[str, Any]:
    """Lowest and highest rotary positions of the work space, for an error map."""
    from trunnion.compensation.workspace import work_space

    at = {k: v for k, v in work_space(setup).arguments().items() if k.endswith("_deg")}
    return {k: (float(v[0]), float(v[-1])) for k, v in at.items() if isinstance(v, tuple)}


def _json(content: Any) -> Callable[[Path], object]:
    """Return what writes the content to a path."""
    text = json.dumps(content, indent=2) + "\n"
    return lambda path: path.write_text(text, encoding="utf-8")


def _picture(
    setup: Setup, estimate: Estimate, table: Compensation, parameters: Compensation, path: Path
) -> None:
    """Sections at zero and the largest error over the poses, before and after, each on its scale.

    Poses are drawn for two rotary axes.
    """
    from matplotlib.figure import Figure

    from trunnion.compensation.workspace import work_space

    shown = {"nothing compensated": None, "error map": table, "CNC parameters": parameters}
    where, pictures, over = work_space(setup).arguments(), [], []
    for name, kind in shown.items():
        section = tn.volumetric_error(setup, estimate, compensation=kind)
        p = tn.plot.volumetric_picture(section, plane="xz", at_mm=0.0)
        title = f"{name}, axes at zero, y = 0; in the box up to {section.max_um:.3g} µm"
        pictures.append(dataclasses.replace(p, title=title))
        poses = tn.volumetric_error(setup, estimate, compensation=kind, points=(2, 2, 2), **where)
        if poses.max_by_pose_um.ndim == 2:
            p = tn.plot.poses_picture(poses)
            title = f"{name}, over the range: largest {poses.max_um:.3g} µm"
            over.append(dataclasses.replace(p, title=title))
    figure = Figure(figsize=(16.0, 3.6 * len(pictures + over) / 3), layout="constrained")
    tn.plot.panels(pictures + over, columns=3, figure=figure)
    figure.savefig(path, dpi=120)
