"""The one reader and the one writer of CSV files.

A message about a file says ``file:line:column: column: got ..., expected ...``, line and column
from 1. Fields are split and converted all at once; what stands where
is worked out only for a line that has an error.
"""

import re
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, Self, TextIO, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trunnion.base.errors import FileFormatError
from trunnion.files.columns import ColumnError, shown_field
from trunnion.files.text import decode


class Readable(Protocol):
    """What the reader has to know of a kind of data."""

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

    def read_from(self, file: str, lines: ArrayLike) -> Self:
        """Return the table with its origin: a file, and the line of each row in it."""
        ...


T = TypeVar("T", bound=Readable)

# A field of a line: in quotes or plain, with spaces around it, then a comma or the end.
_FIELD = re.compile(r'\s*(?:("(?:[^"]|"")*")\s*|([^",]*))(,|\Z)')


def write_columns(columns: Mapping[str, NDArray[Any]], file: TextIO) -> None:
    """Write a header line and one line a row; it reads back as the same numbers and texts."""
    file.write(",".join(_quoted(name) for name in columns) + "\n")
    texts = [
        map(_quoted if values.dtype.kind == "U" else repr, values.tolist())
        for values in columns.values()
    ]
    file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _quoted(text: str) -> str:
    plain = text and text == text.strip() and not any(mark in text for mark in ',"#')
    return text if plain else '"' + text.replace('"', '""') + '"'


def read_table(path: str | PathLike[str], kind: type[T]) -> T:
    """Read a CSV file as a kind of data.

    A header line, then one line a row, in any order of columns; blank lines and lines that begin
    with ``#`` are skipped. A byte-order mark and either kind of line end are accepted, quoted
    fields too, but not across lines.

    Raises FileFormatError: if the file is not like that, or a column holds what it must not; the
        message has file, line and column (from 1), what stood there and what is expected.
    """
    name = str(path)
    lines = decode(name, Path(path).read_bytes()).split("\n")
    numbers = [
        number for number, line in enumerate(lines) if (text := line.lstrip()) and text[0] != "#"
    ]
    if not numbers:
        raise FileFormatError(f"{name}:1:1: got an empty file, expected a header line and data")
    file = _CsvFile(name, lines, numbers, kind)
    columns = file.columns()
    try:
        table = kind.checked(columns)
    except ColumnError as fault:
        raise file.located(fault) from None
    return table.read_from(name, [number + 1 for number in file.data_lines])


class _CsvFile:
    """A file taken apart; `numbers` are the indices of the header line and the lines of data."""

    def __init__(
        self, name: str, lines: list[str], numbers: list[int], kind: type[Readable]
    ) -> None:
        self.name, self.lines, self.kind = name, lines, kind
        self.header_line, self.data_lines = numbers[0], numbers[1:]
        self.header = self.fields(self.header_line)

    def error(self, line: int, column: int, what: str) -> FileFormatError:
        """Return an error at a line (index from 0) and a column (from 0) of it."""
        return FileFormatError(f"{self.name}:{line + 1}:{column + 1}: {what}")

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the fields as text by column name."""
        starts = self.starts(self.header_line)
        for index, name in enumerate(self.header):
            place = (self.header_line, starts[index])
            if not name:
                raise self.error(
                    *place, "header: got an empty field, expected the name of a column"
                )
            if name in self.header[:index]:
                raise self.error(*place, f"{name}: got the column twice, expected it once")
        missing = [name for name in self.kind.required() if name not in self.header]
        if missing:
            got = self.lines[self.header_line].strip()
            for mark, word in ((";", "semicolons"), ("\t", "tabs")):
                if mark in got and "," not in got:
                    raise self.error(
                        self.header_line,
                        got.index(mark),
                        f"header: got {word} between the columns, expected commas",
                    )
            raise self.error(
                self.header_line,
                0,
                f"{missing[0]}: no such column, got the header {shown_field(got)}, expected the "
                f"columns {self.kind.expected_columns()}",
            )
        if not self.data_lines:
            raise self.error(
                self.header_line + 1,
                0,
                "got no line of data, expected at least one below the header",
            )
        return self.split()

    def split(self) -> dict[str, NDArray[Any]]:
        count = len(self.header)
        lines = [self.lines[number] for number in self.data_lines]
        if any('"' in line for line in lines):
            rows = [self.fields(number) for number in self.data_lines]
            for row, fields in enumerate(rows):
                if len(fields) != count:
                    raise self.wrong_count(row, len(fields))
            flat = [field for fields in rows for field in fields]
        else:
            for row, line in enumerate(lines):
                if line.count(",") != count - 1:
                    raise self.wrong_count(row, line.count(",") + 1)
            flat = list(map(str.strip, ",".join(lines).split(",")))
        columns = {name: np.empty(len(lines), dtype=object) for name in self.header}
        for index, column in enumerate(columns.values()):
            column[:] = flat[index::count]
        return columns

    def wrong_count(self, row: int, got: int) -> FileFormatError:
        count = len(self.header)
        line = self.data_lines[row]
        starts = self.starts(line)
        if got > count:
            column, at = "after the last column", starts[count]
        else:
            column, at = self.header[got], len(self.lines[line])
        return self.error(
            line,
            at,
            f"{column}: got {got} fields, expected {count}: {', '.join(self.header)}",
        )

    def located(self, fault: ColumnError) -> FileFormatError:
        """Return the error of the file that a fault of the table is."""
        line = self.header_line if fault.row is None else self.data_lines[fault.row]
        at = 0
        if fault.column in self.header:
            at = self.starts(line)[self.header.index(fault.column)]
        return self.error(line, at, fault.said)

    def fields(self, line: int) -> list[str]:
        """Return the fields of one line, without spaces and quotes around them."""
        return [field for _, field in self.pieces(line)]

    def starts(self, line: int) -> list[int]:
        """Return the index in the line at which each field begins."""
        return [start for start, _ in self.pieces(line)]

    def pieces(self, line: int) -> list[tuple[int, str]]:
        """Split one line; quotes are around a whole field or nowhere, and doubled within it."""
        text = self.lines[line]
        pieces, at, more = [], 0, ","
        while more:
            match = _FIELD.match(text, at)
            if match is None:
                at = text.index('"', at)
                raise self.error(
                    line, at, f"got {shown_field(text[at:])}, expected quotes that close"
                )
            quoted, plain, more = match.groups()
            field = plain.strip() if quoted is None else quoted[1:-1].replace('""', '"')
            pieces.append((match.start(2) if quoted is None else match.start(1), field))
            at = match.end()
        return pieces
