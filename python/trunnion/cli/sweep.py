"""``trunnion sweep``: a study described in a TOML file, its result a netCDF file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any

import typer

from trunnion.cli.common import say
from trunnion.errors import FileFormatError
from trunnion.sweeps import STUDIES, sweep

__all__ = ["sweep_command"]

KEYS = ("study", "samples", "seed", "grid", "fixed")


def sweep_command(
    study: Annotated[Path, typer.Argument(help="study (TOML)", metavar="STUDY")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="result (netCDF); STUDY.nc if absent")
    ] = None,
    threads: Annotated[int | None, typer.Option(help="threads of the core; all cores")] = None,
) -> None:
    """Run a parameter sweep, or go on with one that was interrupted.

    The file has study, samples, seed, and the tables [grid] (name = list) and [fixed] (name =
    value).
    """
    described = _read(study)
    target = output or study.with_suffix(".nc")
    found = sweep(
        described["study"],
        described.get("grid", {}),
        described.get("samples", 1),
        described.get("seed", 0),
        fixed=described.get("fixed", {}),
        path=target,
        threads=threads,
    )
    sizes = ", ".join(f"{name} {size}" for name, size in found.sizes.items())
    say(f"{target}: {sizes}")
    for name, values in found.data_vars.items():
        if "sample" in values.dims and values.dtype.kind == "f" and values.ndim == len(found.dims):
            say(f"  {name}")
    if found.attrs["samples_failed"]:
        say(f"  {found.attrs['samples_failed']} samples failed; see failure_error")


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
