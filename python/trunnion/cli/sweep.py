"""``trunnion sweep``: a study described in a TOML file, its result a netCDF file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from trunnion.base.errors import FileFormatError, InputError
from trunnion.cli.common import say
from trunnion.studies import STUDIES, sweep
from trunnion.studies.study import study_of

__all__ = ["sweep_command"]

KEYS = ("study", "samples", "seed", "grid", "fixed")


def sweep_command(
    study: Annotated[
        Path | None, typer.Argument(help="study (TOML)", metavar="STUDY", show_default=False)
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="result (netCDF); STUDY.nc if absent")
    ] = None,
    threads: Annotated[int | None, typer.Option(help="threads of the core; all cores")] = None,
    parameters: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="show what a built-in study can vary, and stop"),
    ] = None,
) -> None:
    r"""Run a parameter sweep, or go on with one that was interrupted.

    The file has study (calibration, compensation or diagnosis-power),
    samples, seed, and the tables \[grid] (name = list of values) and
    \[fixed] (name = value). Ctrl-C keeps what is done; the same command
    goes on from there.
    """
    if parameters is not None:
        _show_parameters(parameters)
        return
    if study is None:
        raise InputError("STUDY: got none, wanted the path of a TOML file")
    described = _read(study)
    target = output or study.with_suffix(".nc")
    try:
        found = sweep(
            described["study"],
            described.get("grid", {}),
            described.get("samples", 1),
            described.get("seed", 0),
            fixed=described.get("fixed", {}),
            path=target,
            threads=threads,
        )
    except KeyboardInterrupt:
        typer.echo(
            f"interrupted: {target}.part has what is done; the same command goes on", err=True
        )
        raise typer.Exit(130) from None
    except ImportError as error:
        raise InputError(str(error)) from None
    say(f"{target}: {', '.join(f'{name} {size}' for name, size in found.sizes.items())}")
    for name, values in found.data_vars.items():
        if "sample" in values.dims:
            unit = values.attrs.get("units", "")
            said = ", ".join(str(dim) for dim in values.dims)
            say(f"  {name} ({said}){f' in {unit}' if unit not in ('', '1') else ''}")
    if found.attrs["samples_failed"]:
        first = found["failure_error"].values[0]
        say(f"  {found.attrs['samples_failed']} samples failed, see failure_error; first: {first}")


def _show_parameters(name: str) -> None:
    table = Table("name", "default", "unit", "wanted", box=None)
    for parameter, entry in study_of(name, None).parameters.items():
        wanted = "" if entry.low is None else f"from {entry.low:g}"
        wanted += "" if entry.high is None else f" to {entry.high:g}"
        if entry.choices:
            wanted = ", ".join(str(choice) for choice in entry.choices)
        if not entry.in_grid:
            wanted = "in fixed only"
        table.add_row(parameter, str(entry.default), entry.unit, wanted)
    Console(soft_wrap=True).print(table)


def _read(path: Path) -> dict[str, Any]:
    try:
        described = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{path}: {error}") from None
    for key in described:
        if key not in KEYS:
            raise FileFormatError(f"{path}: got key {key!r}, wanted some of {', '.join(KEYS)}")
    if not isinstance(described.get("study"), str):
        raise FileFormatError(
            f"{path}: got study {described.get('study')!r}, wanted one of {', '.join(STUDIES)}"
        )
    return described
