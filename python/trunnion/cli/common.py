"""What all commands share: errors without a traceback, JSON or tables, named values."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import typer
from rich.console import Console
from rich.table import Table

from trunnion.base.errors import InputError, TrunnionError
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.words import opening, table

__all__ = ["clean_errors", "named_values", "numbers", "say", "show_diagnosis", "show_json"]

P = ParamSpec("P")
R = TypeVar("R")


def clean_errors(command: Callable[P, R]) -> Callable[P, R]:
    """Say what went wrong in one line on standard error and exit with 2."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except BrokenPipeError:
            # The reader has seen enough (| head).
            raise typer.Exit(0) from None
        except (TrunnionError, OSError) as error:
            Console(stderr=True, soft_wrap=True, highlight=False).print(
                f"[bold red]error:[/] {_plain(_message(error))}"
            )
            raise typer.Exit(2) from None

    return wrapped


def _message(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {(error.strerror or str(error)).lower()}"
    return str(error)


def _plain(text: str) -> str:
    return text.replace("[", r"\[")


def say(text: str) -> None:
    """Print text as it is."""
    typer.echo(text)


def show_json(value: Any) -> None:
    """Print plain values as JSON."""
    typer.echo(json.dumps(value, indent=2, allow_nan=False))


def show_diagnosis(d: Diagnosis, *, html: Path | None, json_output: bool) -> None:
    """Print a diagnosis as JSON or in words and a table, and write its page where wanted."""
    if json_output:
        show_json(d.to_dict())
    else:
        console = Console(highlight=False)
        console.print(opening(d), markup=False)
        shown = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
        for what, value in table(d):
            shown.add_row(_plain(what), _plain(value))
        console.print(shown)
    if html is not None:
        d.to_html(html)


def named_values(what: str, texts: Iterable[str]) -> dict[str, float]:
    """``["EX0C=15", "EB0C=25.2"]`` as a dict.

    Raises
    ------
    InputError
        Text that is not name=number.
    """
    found: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if name.strip() in found:
            raise InputError(f"{what}: got {name.strip()!r} twice, wanted it once")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            equals = ""
        if not equals:
            raise InputError(f"{what}: got {text!r}, wanted name=number")
    return found


def numbers(what: str, text: str) -> list[float]:
    """``"0,90,180"`` or ``"0:330:30"`` (first, last, step) as numbers.

    Raises
    ------
    InputError
        Anything else.
    """
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = int((last - first) / step + 1e-9) + 1
            if count < 1 or count > 100_000:
                raise ValueError(text)
            return [first + i * step for i in range(count)]
        return [float(part) for part in text.split(",") if part.strip()]
    except (ValueError, ZeroDivisionError):
        raise InputError(
            f"{what}: got {text!r}, wanted numbers such as 0,90,180 or first:last:step"
        ) from None
