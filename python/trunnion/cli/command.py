"""What makes a function a command: the same options, answers and errors everywhere.

A command takes files (data first, then the set-up; the order is free where their endings differ)
and returns an `Answer`. The options --json, --quiet and --force are added here, so that they are
the same for every command; a file is written by `Answer.file` or `save`, which do not overwrite
without --force.
"""

from __future__ import annotations

import functools
import inspect
import json
import shlex
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ParamSpec

import click
import typer

from trunnion.base.call import COMMAND
from trunnion.base.errors import InputError, TrunnionError
from trunnion.base.output import check_new, whole_file
from trunnion.base.report import Table, plain

P = ParamSpec("P")

Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="write the result here", show_default=False)
]
Html = Annotated[
    Path | None, typer.Option(help="write the measurement report here: one page (HTML)")
]
_JSON = Annotated[bool, typer.Option("--json", help="print JSON instead of text")]
_QUIET = Annotated[bool, typer.Option("--quiet", "-q", help="print nothing but errors")]
_FORCE = Annotated[bool, typer.Option("--force", help="overwrite files that exist already")]
_FORCED: ContextVar[bool] = ContextVar("force", default=False)


@dataclass(frozen=True)
class Answer:
    """What a command answers.

    values: Printed with --json: a result, or plain values.
    shown: Printed otherwise, one after the other: results (their summaries), tables, or text.
    """

    values: Any
    shown: tuple[Any, ...] = ()

    @classmethod
    def of(cls, result: Any, *more: Any) -> Answer:
        """Return a result as answer, with further blocks below its summary."""
        return cls(result, (result, *more))

    def json(self) -> str:
        """Return `values` as JSON text."""
        values = self.values.to_dict() if hasattr(self.values, "to_dict") else self.values
        return json.dumps(plain(values), indent=2, ensure_ascii=False, allow_nan=False)

    def text(self) -> str:
        """Return what is shown as text."""
        return "\n".join(_text(block) for block in self.shown)


def _text(block: Any) -> str:
    if isinstance(block, Table):
        return block.text()
    return str(block.summary()) if hasattr(block, "summary") else str(block)


def command(
    group: typer.Typer, name: str | None = None
) -> Callable[[Callable[P, Answer]], Callable[P, Answer]]:
    """Add a function that returns an `Answer` to a group as a command."""

    def decorate(function: Callable[P, Answer]) -> Callable[P, Answer]:
        given = inspect.signature(function, eval_str=True)
        keyword = inspect.Parameter.KEYWORD_ONLY
        shared = [
            inspect.Parameter(key, keyword, default=False, annotation=annotation)
            for key, annotation in (("json_", _JSON), ("quiet", _QUIET), ("force", _FORCE))
        ]

        @functools.wraps(function)
        def run(*arguments: Any, json_: bool, quiet: bool, force: bool, **options: Any) -> None:
            reset, line = _FORCED.set(force), COMMAND.set(_command_line())
            try:
                with _warnings_as_notes():
                    answer = function(*arguments, **options)
                if not quiet:
                    typer.echo(answer.json() if json_ else answer.text())
            except BrokenPipeError:  # the reader has seen enough (| head)
                raise typer.Exit(0) from None
            except (TrunnionError, OSError) as error:
                typer.echo(
                    typer.style("error:", fg="red", bold=True) + f" {_message(error)}", err=True
                )
                raise typer.Exit(2) from None
            finally:
                _FORCED.reset(reset)
                COMMAND.reset(line)

        run.__signature__ = given.replace(  # type: ignore[attr-defined]
            parameters=[*given.parameters.values(), *shared], return_annotation=None
        )
        group.command(name)(run)
        return function

    return decorate


def _command_line() -> str:
    """Return the command that runs, with the options that were given, as a shell takes it."""
    context = click.get_current_context(silent=True)
    if context is None:
        return ""
    parts = context.command_path.split()
    for option in context.command.params:
        value = context.params.get(option.name or "")
        if value is None or value == option.default or value is False:
            continue
        values = value if isinstance(value, list | tuple) else [value]
        if isinstance(option, click.Argument):
            parts += map(str, values)
        elif value is True:
            parts.append(option.opts[0])
        else:
            parts += [text for one in values for text in (option.opts[0], str(one))]
    return shlex.join(parts)


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """Say on the error stream what the library warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    for warning in caught:
        if warning.category is UserWarning:
            typer.echo(f"note: {warning.message}", err=True)


def _message(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {(error.strerror or str(error)).lower()}"
    return str(error)


def check_outputs(*paths: Path) -> None:
    """Refuse paths where files stand already, unless --force is given."""
    for path in paths:
        check_new(path, overwrite=_FORCED.get())


def save(path: Path, write: Callable[[Path], object]) -> str:
    """Write a file whole or not at all, over another one only with --force; say so in one line.

    `write` is called with the path to write to, which has the ending of `path`.
    """
    check_outputs(path)
    with whole_file(path) as draft:
        write(draft)
    return f"wrote {path}"


def sort_files(
    files: Iterable[Path], data: tuple[int, int], set_ups: tuple[int, int], what: str = "data"
) -> tuple[list[Path], list[Path]]:
    """Return data and set-ups (.toml) in the order given.

    files: As given on the command line.
    data, set_ups: Smallest and largest number of each.
    what: What the data are called in the message.

    Raises InputError: other numbers of files, or a file that does not exist.
    """
    files = list(files)
    found = [f for f in files if f.suffix.lower() != ".toml"]
    toml = [f for f in files if f.suffix.lower() == ".toml"]
    if not (data[0] <= len(found) <= data[1] and set_ups[0] <= len(toml) <= set_ups[1]):
        raise InputError(
            f"files: got {_named(found)} as {what} and {_named(toml)} as set-up (.toml), expected "
            f"{_count(data)} of {what} and {_count(set_ups)} set-up"
        )
    for file in files:
        if not file.exists():
            raise InputError(f"{file}: no such file or directory")
    return found, toml


def _named(files: list[Path]) -> str:
    return ", ".join(map(str, files)) or "none"


def one_set_up(files: Iterable[Path], data: tuple[int, int], what: str) -> tuple[list[Path], Path]:
    """Return the data and the one set-up among the files of a command."""
    found, toml = sort_files(files, data, (1, 1), what)
    return found, toml[0]


def _count(bounds: tuple[int, int]) -> str:
    low, high = bounds
    return (
        str(low) if low == high else f"{low} or {high}" if high == low + 1 else f"{low} to {high}"
    )
