"""``trunnion sweep``: a study described in a TOML file, its result a netCDF file."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from trunnion.base.errors import InputError
from trunnion.cli.common import say
from trunnion.studies.study import study_of
from trunnion.studies.study_file import sweep_file

__all__ = ["sweep_command"]


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
    target = output or study.with_suffix(".nc")
    try:
        with _answering_interrupts():
            found = sweep_file(study, path=target, threads=threads)
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


@contextmanager
def _answering_interrupts() -> Iterator[None]:
    """Let SIGINT interrupt even where a shell has started the command in the background.

    A shell without job control has what ends in ``&`` ignore it.
    """
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    if not ignored or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
