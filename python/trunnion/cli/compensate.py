"""``trunnion compensate``: from estimated errors to tables and files of corrections."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from trunnion.base.errors import FileFormatError
from trunnion.base.report import Table
from trunnion.compensation import (
    CncParameters,
    Compensation,
    InverseCompensation,
    MachineErrors,
    ModelCompensation,
    ResidualInterval,
    VolumetricError,
    cnc_parameters,
    error_map,
    residual_interval,
    volumetric_error,
)
from trunnion.compensation.machine import chain_letters
from trunnion.plot.axes import new_figure
from trunnion.plot.volumetric import plot_over_poses, plot_volumetric
from trunnion.setup import Setup, read_setup

__all__ = ["compensate"]

# Between the nodes of a map in steps of 15°, where it is at its worst.
_TILTS, _TURNS = tuple(range(-90, 91, 10)), tuple(range(0, 361, 20))
_POINTS = (7, 7, 5)


def compensate(
    setup_file: Annotated[Path, typer.Argument(metavar="SETUP.TOML", help="set-up file")],
    errors_file: Annotated[
        Path,
        typer.Argument(
            metavar="ERRORS.JSON",
            help="what `trunnion estimate --json` writes, or a table of names and values "
            '({"EX0C": 15.0, ...}, µm and arcsec)',
        ),
    ],
    out: Annotated[Path, typer.Option(help="folder for the files")] = Path("compensation"),
    linear_step_mm: Annotated[float, typer.Option(help="largest step of the map's X, Y, Z")] = 50.0,
    rotary_step_deg: Annotated[float, typer.Option(help="largest step of its rotary axes")] = 15.0,
    seed: Annotated[int, typer.Option(help="of the draws for the predicted interval")] = 0,
) -> None:
    """Compute corrections from an estimate: what each kind leaves, and the files of them.

    Writes error_map.csv, parameters.json, volumetric.json and compensation.png into the folder.
    """
    setup = read_setup(setup_file)
    estimate = read_estimate(errors_file)
    known = MachineErrors.of(setup, estimate)
    table = error_map(setup, known, linear_step_mm=linear_step_mm, rotary_step_deg=rotary_step_deg)
    parameters = cnc_parameters(setup, known)
    kinds: dict[str, Compensation | None] = {
        "nothing compensated": None,
        "error map": table,
        "linear axes, exact": ModelCompensation(known),
        "CNC parameters": parameters,
        "CNC parameters, rounded": parameters.rounded(setup),
        "all axes, exact": InverseCompensation(known),
    }
    at_zero = {name: _field(setup, known, kind, over=False) for name, kind in kinds.items()}
    over = {name: _field(setup, known, kind, over=True) for name, kind in kinds.items()}
    interval = _interval(setup, estimate, seed)

    console = Console()
    console.print(_table(at_zero, over).to_rich())
    console.print(_set_to(parameters).to_rich())
    console.print(_removable(parameters).to_rich())
    if interval is not None:
        console.print(interval.table().to_rich())
    console.print(table.summary())

    out.mkdir(parents=True, exist_ok=True)
    table.to_csv(out / "error_map.csv")
    _write(out / "parameters.json", parameters.to_dict())
    found = {"at_zero": _plain(at_zero), "over_range": _plain(over)}
    if interval is not None:
        found["predicted_interval_over_range"] = interval.to_dict()
    _write(out / "volumetric.json", found)
    _picture(setup, known, table, parameters, over, out / "compensation.png")
    for name in ("error_map.csv", "parameters.json", "volumetric.json", "compensation.png"):
        console.print(f"wrote {out / name}")


@dataclass(frozen=True)
class Estimate:
    """What the command takes from a file."""

    errors: dict[str, float]
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    std_errors: dict[str, float] = field(default_factory=dict)
    names: tuple[str, ...] | None = None
    covariance: Any = None
    degrees_of_freedom: float = float("inf")


def read_estimate(path: Path) -> Estimate:
    """Read an estimate: the dictionary of a result, or names and values alone.

    Raises
    ------
    FileFormatError
        If the file is not JSON, or holds neither.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: got bytes that are not UTF-8 at {error.start}") from None
    except json.JSONDecodeError as error:
        raise FileFormatError(
            f"{path}:{error.lineno}:{error.colno}: got no JSON ({error.msg}), wanted an estimate"
        ) from None
    wanted = 'a table of errors {"EX0C": 15.0, ...} or the JSON of a result with "errors"'
    if not isinstance(content, dict):
        raise FileFormatError(f"{path}:1:1: got {type(content).__name__}, wanted {wanted}")
    # What `trunnion estimate --json` writes: results by method, the most general one first.
    for method in ("least-squares", "separating"):
        if isinstance(content.get(method), dict):
            content = content[method]
    if "errors" not in content:
        return Estimate(_numbers(path, "errors", content))
    effects = content.get("effects") or {}
    if not isinstance(effects, dict):
        raise FileFormatError(f"{path}: effects: got {effects!r}, wanted id → parameter → value")
    std_errors = content.get("std_errors") or {}
    return Estimate(
        errors=_numbers(path, "errors", content["errors"]),
        effects={name: _numbers(path, f"effects.{name}", v) for name, v in effects.items()},
        std_errors={name: float(value) for name, value in std_errors.items()},
        names=tuple(content["names"]) if "names" in content else None,
        covariance=content.get("covariance"),
        degrees_of_freedom=float(content.get("degrees_of_freedom", float("inf"))),
    )


def _numbers(path: Path, what: str, values: object) -> dict[str, float]:
    if not isinstance(values, dict):
        raise FileFormatError(f"{path}: {what}: got {values!r}, wanted names with numbers")
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise FileFormatError(f"{path}: {what}.{name}: got {value!r}, wanted a finite number")
    return {name: float(value) for name, value in values.items()}


def _field(
    setup: Setup, known: MachineErrors, kind: Compensation | None, *, over: bool
) -> VolumetricError:
    if not over:
        return volumetric_error(setup, known, compensation=kind, points=_POINTS)
    tilt = "A" if "A" in chain_letters(setup) else "B"
    return volumetric_error(
        setup,
        known,
        a_deg=_TILTS if tilt == "A" else 0,
        b_deg=_TILTS if tilt == "B" else None,
        c_deg=_TURNS,
        compensation=kind,
        points=(3, 3, 2),
    )


def _interval(setup: Setup, estimate: Estimate, seed: int) -> ResidualInterval | None:
    """Predicted interval over the whole range, where the estimate has a covariance."""
    if estimate.covariance is None or estimate.names is None:
        return None
    tilt = "A" if "A" in chain_letters(setup) else "B"
    return residual_interval(
        setup,
        estimate,
        a_deg=_TILTS if tilt == "A" else 0,
        b_deg=_TILTS if tilt == "B" else None,
        c_deg=_TURNS,
        draws=1000,
        seed=seed,
    )


def _table(at_zero: dict[str, VolumetricError], over: dict[str, VolumetricError]) -> Table:
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


def _removable(parameters: CncParameters) -> Table:
    rows = [
        (row.name, row.unit, f"{row.before_um:.3f}", f"{row.left_um:.3f}", f"{row.share_left:.1%}")
        for row in parameters.removable
    ]
    title = "What CNC parameters can leave of one unit of each error, µm rms over all A/B, C"
    return Table.of(title, ("", "unit", "before", "left", "share"), rows)


def _set_to(parameters: CncParameters) -> Table:
    return Table.of("CNC parameters to set", ("", "value"), parameters.set_to())


def _plain(fields: dict[str, VolumetricError]) -> dict[str, Any]:
    return {name: value.to_dict() for name, value in fields.items()}


def _write(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _picture(
    setup: Setup,
    known: MachineErrors,
    table: Compensation,
    parameters: Compensation,
    over: dict[str, VolumetricError],
    path: Path,
) -> None:
    """Sections at zero and the largest error over the poses, before and after, one scale."""
    shown = {"nothing compensated": None, "error map": table, "CNC parameters": parameters}
    top = max(value.max_um for value in over.values())
    scale = (0.01, top) if top > 0.01 else None
    figure = new_figure(13.0, 7.0)
    panels = figure.subplots(2, 3)
    for column, (name, kind) in enumerate(shown.items()):
        section = volumetric_error(setup, known, compensation=kind)
        plot_volumetric(
            section, plane="xz", at_mm=0.0, scale_um=scale, colorbar=False, ax=panels[0, column]
        )
        upper = panels[0, column]
        upper.set_title(f"{name}, all axes at zero\n{upper.get_title()}", fontsize="medium")
        plot_over_poses(over[name], scale_um=scale, colorbar=False, ax=panels[1, column])
        lower = panels[1, column]
        lower.set_title(f"{name}, over the range\n{lower.get_title()}", fontsize="medium")
    image = panels[0, 0].collections[0]
    figure.colorbar(image, ax=panels, label="error (µm)", shrink=0.7)
    figure.savefig(path, dpi=120)
