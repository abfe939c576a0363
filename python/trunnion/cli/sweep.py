"""``trunnion sweep``: a study described in a TOML file, its result a netCDF file."""

from __future__ import annotations

import logging
import math
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.cli.command import Answer, command, forced
from trunnion.cli.schema import Printed


class Swept(TypedDict):
    """What `sweep` prints as JSON."""

    file: str
    sizes: dict[str, int]


class Parameter(TypedDict):
    """What a study can vary."""

    name: str
    default: str
    unit: str
    values: str


class Parameters(TypedDict):
    """What `sweep --parameters` prints as JSON."""

    parameters: list[Parameter]


KEYS = tuple(Parameter.__annotations__)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app, values=(Printed(keys=Swept), Printed(keys=Parameters)))(sweep)


def sweep(
    study: Annotated[
        Path | None, typer.Argument(help="study (TOML)", metavar="STUDY", show_default=False)
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="netCDF file; STUDY.nc if absent (.nc)", show_default=False
        ),
    ] = None,
    threads: Annotated[int | None, typer.Option(help="threads of the core; all cores")] = None,
    parameters: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="show what a study can vary, and stop: calibration, compensation, identification "
            "or diagnosis-power",
        ),
    ] = None,
) -> Answer:
    r"""Run a parameter sweep, or go on with one that was interrupted.

    The result is a netCDF file, --output.

    The file has study (its name), samples, seed, and the tables \[grid]
    (name = list of values) and \[fixed] (name = value). Ctrl-C keeps what
    is done; the same command goes on from there.
    """
    if parameters is not None:
        return _parameters(parameters)
    if study is None:
        raise tn.InputError("STUDY: got none, expected the path of a TOML file")
    target = output or study.with_suffix(".nc")
    if target.suffix.lower() != ".nc":
        raise tn.InputError(
            f"--output {target}: got the ending {target.suffix!r}, expected .nc (netCDF); "
            "tn.open_sweep(...).to_dataframe() makes tables of it"
        )
    complete = target.exists()
    try:
        with _answering_interrupts(), _said_beforehand():
            found, again = _swept(study, target, threads)
    except KeyboardInterrupt:
        typer.echo(
            f"interrupted: {target}.part has what is done; the same command goes on", err=True
        )
        raise typer.Exit(130) from None
    except ImportError as error:
        raise tn.InputError(str(error)) from None
    said = _described(target, found)
    if complete and not again:
        said.append("It was complete: nothing was computed.")
    return Answer({"file": str(target), "sizes": dict(found.sizes)}, tuple(said))


def _swept(study: Path, target: Path, threads: int | None) -> tuple[Any, bool]:
    """Return the result, and whether it took the place of another sweep (--force)."""
    from trunnion.studies.description import AnotherSweepError
    from trunnion.studies.study_file import sweep_file

    try:
        return sweep_file(study, path=target, threads=threads), False
    except AnotherSweepError as error:
        if not forced():
            raise tn.DataError(f"{error} (--force starts again)") from None
    for path in (target, Path(f"{target}.part")):
        path.unlink(missing_ok=True)
    return sweep_file(study, path=target, threads=threads), True


def _described(target: Path, found: Any) -> list[str]:
    """Return dimensions, outputs with units, and failures of a sweep's dataset, a line each."""
    lines = [f"{target}: {', '.join(f'{name} {size}' for name, size in found.sizes.items())}"]
    for name, values in found.data_vars.items():
        if "sample" in values.dims:
            unit = values.attrs.get("units", "")
            along = ", ".join(str(dim) for dim in values.dims)
            lines.append(f"  {name} ({along}){f' in {unit}' if unit not in ('', '1') else ''}")
    if found.attrs["samples_failed"]:
        first = found["failure_error"].values[0]
        lines.append(
            f"  {found.attrs['samples_failed']} samples failed, see failure_error; first: {first}"
        )
    return lines


def _parameters(name: str) -> Answer:
    from trunnion.base.report import Table
    from trunnion.studies.study import study_of

    rows = []
    for parameter, entry in study_of(name, None).parameters.items():
        bounds = "" if entry.low is None else f"from {entry.low:g}"
        bounds += "" if entry.high == math.inf else f" to {entry.high:g}"
        if entry.choices:
            bounds = ", ".join(str(choice) for choice in entry.choices)
        if not entry.in_grid:
            bounds = "in fixed only"
        rows.append((parameter, str(entry.default), entry.unit, bounds.strip()))
    table = Table.of(f"Parameters of {name}", ("", "default", "unit", "values"), rows)
    return Answer({"parameters": [dict(zip(KEYS, row, strict=True)) for row in rows]}, (table,))


@contextmanager
def _said_beforehand() -> Iterator[None]:
    """Write what a sweep says before it begins, the size of its file, to the error stream."""
    log, handler = logging.getLogger("trunnion.studies"), logging.StreamHandler()
    before = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    log.propagate = False
    try:
        yield
    finally:
        log.setLevel(before)
        log.propagate = True
        log.removeHandler(handler)


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
