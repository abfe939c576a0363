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
import logging
import os
import shlex
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NoReturn, ParamSpec

import typer
from typer.core import TyperGroup

from trunnion.base.call import COMMAND
from trunnion.base.errors import InputError, TrunnionError
from trunnion.base.output import WRITTEN, check_among, check_ending, check_new, whole_file
from trunnion.base.progress import shown_progress
from trunnion.cli.given import near_file

P = ParamSpec("P")

SCHEMA_VERSION = 1
"""Of what --json prints; raised when a key goes or gets another meaning, not when one is added."""
FAULT, REFUSED, INTERRUPTED = 1, 2, 130
"""Exit codes: a fault of trunnion; arguments or files that are not usable; Ctrl-C."""
PROGRAM, PAGE, LOG, CORRECTIONS = WRITTEN
LEVELS = (logging.WARNING, logging.INFO, logging.DEBUG)
_LOG = logging.getLogger("trunnion")

Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        help="write the result here; its ending says as what: .csv .json .xlsx .parquet; of "
        "results .html, the report",
        show_default=False,
    ),
]
Html = Annotated[
    Path | None, typer.Option(help="write the measurement report here: one page (HTML)")
]
_JSON = Annotated[bool, typer.Option("--json", help="print JSON instead of text")]
_QUIET = Annotated[bool, typer.Option("--quiet", "-q", help="print nothing but errors")]
_FORCE = Annotated[bool, typer.Option("--force", help="overwrite files that exist already")]
_VERBOSE = Annotated[
    int,
    typer.Option(
        "--verbose", "-v", count=True, show_default=False, help="say what is done; -vv: in detail"
    ),
]
_UNIT = Annotated[
    str, typer.Option("--unit", "--units", help="unit of the files' lengths: mm or inch")
]
_DECIMAL = Annotated[
    str, typer.Option(help="decimal mark, where it cannot be found: . or ,", show_default=False)
]
_SEPARATOR = Annotated[
    str, typer.Option(help="mark between columns, where it cannot be found", show_default=False)
]
_SHEET = Annotated[str, typer.Option(help="sheet of a workbook (xlsx)", show_default=False)]
READING: tuple[tuple[str, Any, Any], ...] = (
    ("unit", _UNIT, "mm"),
    ("decimal", _DECIMAL, ""),
    ("separator", _SEPARATOR, ""),
    ("sheet", _SHEET, ""),
)
"""Options of every command that reads measured data: as `SHARED`."""
SHARED: tuple[tuple[str, Any, Any], ...] = (
    ("json_", _JSON, False),
    ("quiet", _QUIET, False),
    ("force", _FORCE, False),
    ("verbose", _VERBOSE, 0),
)
"""Options of every command: name, annotation, default."""
_FORCED: ContextVar[bool] = ContextVar("force", default=False)
_READ: ContextVar[tuple[Path, ...]] = ContextVar("read", default=())


@dataclass(frozen=True)
class Answer:
    """What a command answers.

    values: Printed with --json: a result, or plain values by name.
    shown: Printed otherwise, one after the other: results (their summaries), tables, or text.
    failed: What was not usable, of several files; the command then ends with `REFUSED`.
    made_of: Data, set-up and further files of the result, for its record, in JSON and in the
        report: arguments of `Result.to_html`.
    kept: What a JSON file holds beside what is printed.
    record_of: The result whose record stands in JSON; by default `values`, or the last of them.
    """

    values: Any
    shown: tuple[Any, ...] = ()
    failed: tuple[str, ...] = ()
    made_of: Mapping[str, Any] = field(default_factory=dict)
    kept: Mapping[str, Any] = field(default_factory=dict)
    record_of: Any = None

    @classmethod
    def of(cls, result: Any, *more: Any, **made_of: Any) -> Answer:
        """Return a result as answer, with further blocks below its summary."""
        return cls(result, (result, *more), made_of=made_of)

    def with_page(self, html: Path | None, of: Any = None) -> Answer:
        """Write the report of the result, or of one of several, where one is wanted; say so."""
        if html is None:
            return self
        return replace(self, shown=(*self.shown, self._page(html, of or self._result(html))))

    def _page(self, path: Path, of: Any) -> str:
        return save(path, functools.partial(of.to_html, **self.made_of), PAGE)

    def save(self, path: Path) -> str:
        """Write the result: as JSON whole, so that it comes back; in other formats its tables."""
        if path.suffix.lower() == ".json":
            text = self.json(whole=True)
            return save(path, lambda draft: draft.write_text(text + "\n", encoding="utf-8"))
        result = self._result(path)
        is_page = path.suffix.lower() in WRITTEN[PAGE] and hasattr(result, "to_html")
        return self._page(path, result) if is_page else save_result(path, result)

    def _result(self, path: Path) -> Any:
        """Return what is written to files: of several results by name the last, the most general.

        path: Of the file, for the message.
        """
        by_name = [*self.values.values()][::-1] if isinstance(self.values, Mapping) else []
        results = [e for e in (self.values, *by_name, *self.shown) if hasattr(e, "save")]
        if not results:
            raise InputError(f"--output: got {path}, expected a name that ends in .json")
        return results[0]

    def json(self, command: str = "", *, whole: bool = False) -> str:
        """Return `values` as JSON text; with the name of a command, which schema they follow.

        whole: With what is `kept`, as a file has it.
        """
        from trunnion.base.record import Record, record_of
        from trunnion.base.stored import plain

        values = self.values.to_dict() if hasattr(self.values, "to_dict") else self.values
        values = {**values, **(self.kept if whole else {})}
        if (of := self._recorded()) is not None:
            given = Record.of(of, **self.made_of) if self.made_of else record_of(of)
            values = {**values, "record": given}
        if command:
            values = {"schema": {"command": command, "version": SCHEMA_VERSION}, **values}
        return json.dumps(plain(values), indent=2, ensure_ascii=False, allow_nan=False)

    def _recorded(self) -> Any:
        """Return the result that the record is of; None for an answer without one."""
        from trunnion.base.report import Result

        by_name = [*self.values.values()][::-1] if isinstance(self.values, Mapping) else []
        every = (self.record_of, self.values, *by_name, *self.shown)
        return next((one for one in every if isinstance(one, Result)), None)

    def text(self) -> str:
        """Return what is shown as text."""
        return "\n".join(_text(block) for block in self.shown)


def _text(block: Any) -> str:
    if hasattr(block, "to_rich"):  # a table
        return str(block.text())
    return str(block.summary()) if hasattr(block, "summary") else str(block)


class Group(TyperGroup):
    """A group of commands, which knows a file that stands where a command is expected."""

    def resolve_command(
        self, ctx: Any, args: list[str]
    ) -> tuple[str | None, Any | None, list[str]]:
        """Return the command that the first argument names."""
        if args and args[0] not in self.commands and Path(args[0]).exists():
            names = ", ".join(self.commands)
            ctx.fail(f"Got the file {args[0]!r}, expected a command before it: {names}.")
        return super().resolve_command(ctx, args)


def group_of(app: typer.Typer, name: str, about: str) -> typer.Typer:
    """Add a group of commands to the application."""
    group = typer.Typer(cls=Group, name=name, help=about, no_args_is_help=True)
    app.add_typer(group)
    return group


@dataclass(frozen=True)
class Command:
    """A command as it was added.

    name: With its group, as typed.
    values: What --json prints: a class, or "module:Class", imported when it is asked for.
    """

    name: str
    values: Any


COMMANDS: dict[str, Command] = {}
"""Every command by name."""


def command(
    group: typer.Typer, name: str = "", *, values: Any, reads: bool = False, writes: str = ""
) -> Callable[[Callable[P, Answer]], Callable[P, Answer]]:
    """Add a function that returns an `Answer` to a group as a command.

    values: The class that `Answer.values` are of, for the schema of --json: a result ("module:
        Class"), or a TypedDict.
    reads: Whether it reads measured data, and takes the options that say how.
    writes: Which files it writes where, if these are all of its result: --output takes what --json
        prints.
    """

    def decorate(function: Callable[P, Answer]) -> Callable[P, Answer]:
        given = inspect.signature(function, eval_str=True)
        keyword = inspect.Parameter.KEYWORD_ONLY
        own = () if "output" in given.parameters else (("output", Output, None),)
        shared = [
            inspect.Parameter(key, keyword, default=default, annotation=annotation)
            for key, annotation, default in (*own, *(READING if reads else ()), *SHARED)
        ]
        place = inspect.Parameter("context", keyword, annotation=typer.Context)
        owner = "" if group.info.name == "trunnion" else f"{group.info.name} "
        known = Command(f"{owner}{name or function.__name__}", values)
        COMMANDS[known.name] = known

        @functools.wraps(function)
        def run(
            *arguments: Any,
            context: typer.Context,
            json_: bool,
            quiet: bool,
            force: bool,
            verbose: int,
            **options: Any,
        ) -> None:
            reset, line = _FORCED.set(force), COMMAND.set(_command_line(context))
            read = _READ.set(_files_given(context))
            output = options.pop("output") if own else None
            how = {key: options.pop(key) for key, *_ in READING} if reads else {}
            try:
                with _logged(verbose), _warnings_as_notes(), shown_progress(), _reading(how):
                    _check_given(context, output, options.get("html"), writes)
                    answer = function(*arguments, **options)
                    if output is not None:
                        answer = replace(answer, shown=(*answer.shown, answer.save(output)))
                if not quiet:
                    typer.echo(answer.json(known.name) if json_ else answer.text())
                if answer.failed:
                    for message in answer.failed if quiet or json_ else ():  # no text says it
                        say("error:", message)
                    raise typer.Exit(REFUSED)
            except (Exception, KeyboardInterrupt) as error:
                _end(error, context)
            finally:
                _FORCED.reset(reset)
                COMMAND.reset(line)
                _READ.reset(read)

        run.__signature__ = given.replace(  # type: ignore[attr-defined]
            parameters=[*given.parameters.values(), place, *shared], return_annotation=None
        )
        group.command(name or None)(run)
        return function

    return decorate


def _check_given(
    context: typer.Context, output: Path | None, html: Path | None, writes: str
) -> None:
    """Refuse numbers that no machine has (nan, infinite, far too large) and files to write."""
    if writes and output is not None and output.suffix.lower() != ".json":
        raise InputError(
            f"--output: got {output}, expected a name that ends in .json, for what --json prints: "
            f"{writes}"
        )
    if output is not None:
        check_outputs(output)
    if html is not None:
        check_outputs(html, what=PAGE)
    for option in context.command.params:
        value = context.params.get(option.name or "")
        if option.param_type_name != "option" or value == option.default:
            continue  # a default may be infinite: no limit
        for number in value if isinstance(value, list | tuple) else [value]:
            if isinstance(number, float):
                from trunnion.cli.values import sensible

                sensible(option.opts[0], number, option.name or "")


def _name_as_typed(error: BaseException, context: typer.Context) -> None:
    """Let a message that begins with an argument of Python begin with the option that gave it."""
    said, given = str(error), {str(value) for value in context.params.values()}
    for option in context.command.params if type(error) is InputError else ():
        is_file = option.name in given  # one that is called as an option is
        starts = option.param_type_name == "option" and said.startswith(f"{option.name}: ")
        if starts and not is_file:
            error.args = (f"{option.opts[0]}{said[len(option.name or '') :]}",)


def _end(error: BaseException, context: typer.Context) -> NoReturn:
    """Say what ended a command in one line, never a traceback, and end with its exit code."""
    _name_as_typed(error, context)
    if isinstance(error, typer.Exit | typer.Abort | typer.BadParameter):
        raise error
    if isinstance(error, KeyboardInterrupt):
        typer.echo("interrupted", err=True)
        raise typer.Exit(INTERRUPTED) from None
    if isinstance(error, BrokenPipeError):  # the reader has seen enough (| head)
        _drop_output()
        raise typer.Exit(0) from None
    if isinstance(error, TrunnionError | OSError | ImportError | MemoryError):
        say("error:", _message(error))
        raise typer.Exit(REFUSED) from None
    kind = type(error).__name__
    say("fault of trunnion:", f"{kind}: {error} (the same command with -vv says where)")
    raise typer.Exit(FAULT) from None


def say(head: str, message: str) -> None:
    """Write a line with a red beginning to the error stream; NO_COLOR takes the colour."""
    red = head if os.environ.get("NO_COLOR") else typer.style(head, fg="red", bold=True)
    typer.echo(f"{red} {message}", err=True)


def _drop_output() -> None:
    """Let Python write what it still holds for a closed pipe to nowhere at its end."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):  # no file: captured by a test, or closed
        return


@contextmanager
def _reading(how: dict[str, str]) -> Iterator[None]:
    """Read all files as the options say."""
    if not any(value for key, value in how.items() if (key, value) != ("unit", "mm")):
        yield
        return
    from trunnion.files.csv_file import Options, reading

    marks = {key: how[key] or None for key in ("separator", "decimal", "sheet")}
    with reading(Options(units=how["unit"], **marks)):
        yield


@contextmanager
def _logged(verbose: int) -> Iterator[None]:
    """Write the package's log to the error stream, with --verbose."""
    if not verbose:
        yield
        return
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s", "%H:%M:%S"))
    before = _LOG.level
    _LOG.addHandler(handler)
    _LOG.setLevel(LEVELS[min(verbose, len(LEVELS) - 1)])
    try:
        yield
    except BaseException as error:
        _LOG.debug("where it ended", exc_info=error)
        raise
    finally:
        _LOG.setLevel(before)
        _LOG.removeHandler(handler)


def _files_given(context: typer.Context) -> tuple[Path, ...]:
    """Return the files and folders among the arguments of the command: those that it reads."""
    names = [p.name or "" for p in context.command.params if p.param_type_name == "argument"]
    given = (context.params.get(name) for name in names)
    every = (one for value in given for one in (value if isinstance(value, list) else [value]))
    return tuple(one for one in every if isinstance(one, Path))


def _command_line(context: typer.Context) -> str:
    """Return the command that runs, with the options that were given, as a shell takes it."""
    parts = context.command_path.split()
    for option in context.command.params:
        value = context.params.get(option.name or "")
        if value is None or value == option.default or value is False:
            continue
        values = value if isinstance(value, list | tuple) else [value]
        if option.param_type_name == "argument":
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


def _message(error: BaseException) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        near = near_file(error.filename) if isinstance(error, FileNotFoundError) else ""
        return f"{error.filename}: {(error.strerror or str(error)).lower()}{near}"
    if isinstance(error, MemoryError):
        return f"not enough memory: {error}" if str(error) else "not enough memory"
    return str(error)


def check_outputs(*paths: Path, what: str = "") -> None:
    """Refuse paths where files stand already, unless --force is given, and what is read.

    what: Is written there whatever the name says (`base.output.WRITTEN`): its ending is checked.
    """
    for path in paths:
        _check_not_read(path)
        if what:
            check_ending(path, what)
        check_new(path, overwrite=_FORCED.get())


def check_log(log: str) -> None:
    """Refuse a log that a control would append to a file of another kind, or of this command."""
    check_ending(Path(log), LOG)
    _check_not_read(Path(log))


def _check_not_read(path: Path) -> None:
    """Refuse a file that the command reads, even with --force: what it holds would be lost."""
    if any(path.exists() and file.exists() and path.samefile(file) for file in _READ.get()):
        raise InputError(f"{path}: got a file that this command reads, expected another name")


def forced() -> bool:
    """Whether --force is given."""
    return _FORCED.get()


def save(path: Path, write: Callable[[Path], object], what: str = "") -> str:
    """Write a file whole or not at all, over another one only with --force; say so in one line.

    `write` is called with the path to write to, which has the ending of `path`; `what` it writes
    if it does not look at that.
    """
    check_outputs(path, what=what)
    with whole_file(path) as draft:
        write(draft)
    return f"wrote {path}"


def is_program(path: Path) -> bool:
    """Whether a control takes a file for a program by the ending of its name."""
    return path.suffix.lower() in WRITTEN[PROGRAM]


def save_result(path: Path, result: Any) -> str:
    """Write a result or data as `save`, as the ending of the name says.

    Raises InputError: the result cannot be written so, or a control takes it for a program.
    """
    from trunnion.base.saved import writers

    endings = (ending for ending in writers(result) if ending not in WRITTEN[PROGRAM])
    note = ", which a control takes for a program" if is_program(path) else ""
    check_among(path, endings, note)
    return save(path, result.save)
