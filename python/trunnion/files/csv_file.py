"""The one reader and the one writer of CSV files.

A message about a file says ``file:line:column: column: got ..., expected ...``, line and column
from 1. Fields are split and converted all at once; what stands where
is worked out only for a line that has an error.
"""

import logging
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from os import PathLike
from typing import Any, ClassVar, Protocol, Self, TextIO, TypeVar

from numpy.typing import ArrayLike, NDArray

from trunnion.base.checks import choose
from trunnion.base.units import unit_of
from trunnion.files.columns import (
    Column,
    ColumnError,
    is_numeric,
    is_time_stamp,
    scaled,
    shown_field,
)
from trunnion.files.delimited import Delimited, Dialect
from trunnion.files.recognised import PLAIN, Recognised
from trunnion.files.text import Source

LOG = logging.getLogger("trunnion.files")

MM_OF = {"mm": 1.0, "inch": 25.4}
TIME = "time_s"
"""Unit of lengths that a file may be in → mm."""


class Readable(Protocol):
    """What the reader has to know of a kind of data."""

    kinds: ClassVar[Mapping[str, Column[Any]]]

    @classmethod
    def required(cls) -> list[str]:
        """Names of the columns that must be there."""
        ...

    @classmethod
    def expected_columns(cls) -> str:
        """Say what columns are needed, for messages."""
        ...

    @classmethod
    def checked(cls, columns: Mapping[str, NDArray[Any]]) -> Self:
        """Make a table of these columns, or raise `ColumnError`."""
        ...

    def read_from(self, file: str, lines: ArrayLike, recognised: Recognised | None = None) -> Self:
        """Return the table with its origin: a file, the line of each row, what it is."""
        ...


T = TypeVar("T", bound=Readable)


@dataclass(frozen=True)
class Options(Dialect):
    """What a user says of a file.

    separator, decimal: As in `Dialect`.
    units: Of columns in mm: ``mm`` or ``inch``.
    sheet: Name of a workbook's sheet.

    What nobody says is what `reading` says for all files read inside it.
    """

    units: str = "mm"
    sheet: str | None = None

    def __post_init__(self) -> None:
        choose("units", self.units, MM_OF)
        for what, value, known in (
            ("separator", self.separator, ",;\t"),
            ("decimal", self.decimal, ".,"),
        ):
            if value is not None:
                choose(what, value, known)


_READING: ContextVar[Options | None] = ContextVar("reading", default=None)


@contextmanager
def reading(options: Options) -> Iterator[None]:
    """Read all files inside with these options, unless their own are given."""
    reset = _READING.set(options)
    try:
        yield
    finally:
        _READING.reset(reset)


def options_in_force(given: Options | None = None) -> Options:
    """Return the options given, or those of `reading`."""
    if given is None or given == Options():
        return _READING.get() or Options()
    return given


def write_columns(columns: Mapping[str, NDArray[Any]], file: TextIO) -> None:
    """Write a header line and one line a row; it reads back as the same numbers and texts."""
    file.write(",".join(_quoted(name) for name in columns) + "\n")
    texts = [
        map(_quoted if values.dtype.kind == "U" else repr, values.tolist())
        for values in columns.values()
    ]
    file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _quoted(text: str) -> str:
    plain = text and text == text.strip() and not any(mark in text for mark in ',"#;\t')
    return text if plain else '"' + text.replace('"', '""') + '"'


def read_table(
    path: str | PathLike[str] | Source,
    kind: type[T],
    options: Options | None = None,
) -> T:
    """Read a CSV file as a kind of data.

    A header line, then one line a row, in any order of columns; blank lines, lines that begin with
    ``#`` and lines of separators at the end are skipped. Columns are separated by commas,
    semicolons or tabs, the last two with points or decimal commas; the text is UTF-8, or what its
    byte-order mark says; a first column without a name that counts rows is left out; known columns
    are known in any case of letters. Quoted fields are accepted, but not across lines. What was
    recognised is the table's `recognised`.

    Raises FileFormatError: if the file is not like that, can be read in two ways, or a column holds
        what it must not; the message has file, line and column (from 1), what stood there and what
        is expected.
    """
    options = options_in_force(options)
    source = path if isinstance(path, Source) else Source.of(path, options.sheet)
    spelt = {name.lower(): name for name in kind.kinds}
    file = Delimited(source, options, lambda name: spelt.get(name.lower(), name))
    for name in kind.required():
        if name not in file.header:
            file.check_header()  # a name that stands twice may be the one that is missing
            got = shown_field(file.lines[file.header_line].strip())
            raise file.error(
                file.header_line,
                0,
                f"{name}: no such column, got the header {got}, expected the columns "
                f"{kind.expected_columns()}",
            )
    columns = file.columns(lambda name: is_numeric(kind.kinds.get(name)))
    named = _with_time(columns, kind)
    clock = _clock(columns)
    try:
        if options.units != "mm":
            columns |= _in_mm(columns, MM_OF[options.units])
        table = kind.checked(columns)
    except ColumnError as fault:
        raise file.located(fault) from None
    recognised = Recognised(
        format=PLAIN,
        kind=kind.__name__,
        encoding=source.encoding,
        separator=file.separator,
        decimal=file.decimal,
        columns=named,
        clock=clock,
        units={} if options.units == "mm" else _units_taken(columns, options.units),
        notes=tuple(file.notes),
    )
    found = table.read_from(source.name, [n + 1 for n in file.data_lines], recognised)
    LOG.info("%s: %d rows, %s", source.name, len(file.data_lines), recognised.headline())
    return found


def _with_time(columns: dict[str, NDArray[Any]], kind: type[Readable]) -> dict[str, str]:
    """Take the one column of dates with times for `time_s`, and say so, where that is missing."""
    if TIME not in kind.kinds or TIME in columns:
        return {}
    found = [name for name, values in columns.items() if all(map(is_time_stamp, values))]
    if len(found) != 1 or found[0] in kind.kinds:
        return {}
    columns[TIME] = columns.pop(found[0])
    return {TIME: found[0]}


def _clock(columns: Mapping[str, NDArray[Any]]) -> str:
    """Say from when seconds are counted; empty where the file has seconds."""
    first = columns[TIME][0] if TIME in columns else ""
    return f"seconds since {first}" if is_time_stamp(first) else ""


def _is_length(name: str) -> bool:
    return unit_of(name) in ("mm", "mm/min")


def _units_taken(columns: Iterable[str], given: str) -> dict[str, str]:
    """Say from which unit to which the columns of lengths, and of feeds, were taken."""
    each = {name: unit_of(name) for name in columns if _is_length(name)}
    return {name: f"{unit.replace('mm', given)} → {unit}" for name, unit in each.items()}


def _in_mm(columns: Mapping[str, NDArray[Any]], factor: float) -> dict[str, NDArray[Any]]:
    """Return the columns of lengths, and of feeds, in mm."""
    return {name: scaled(name, v, factor) for name, v in columns.items() if _is_length(name)}
