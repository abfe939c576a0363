"""Lines with a header taken apart into columns, whatever marks separate them.

The separator and the decimal mark are found in the file; where it can be read in two ways, it is
refused, and the message names the argument that decides.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import FileFormatError
from trunnion.files.columns import ColumnError, shown_field
from trunnion.files.recognised import SEPARATORS
from trunnion.files.text import Source

_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_COMMA = re.compile(r"[+-]?(?:[0-9]+,[0-9]*|,[0-9]+)(?:[eE][+-]?[0-9]+)?")
_POINT = re.compile(r"[+-]?(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_POINT_BEHIND = re.compile(r"[+-]?[0-9]{1,3},[0-9]{3}\.[0-9]*")
_WHOLE = re.compile(r"[+-]?[0-9]+(?:[eE][+-]?[0-9]+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:,[0-9]{3})+")
_INDEX = re.compile(r"[0-9]{1,15}")


@dataclass(frozen=True)
class Dialect:
    """What a user says of the marks in a file; None: it is found.

    separator: Between columns: ``,``, ``;`` or a tab.
    decimal: ``.`` or ``,``.
    """

    separator: str | None = None
    decimal: str | None = None


class Delimited:
    """A header line and lines of data.

    source: The file.
    known: Returns the name of a column as its kind of data writes it, for the header's names.
    first: Index of the header line; None: the first line that is neither blank nor a comment.

    Attributes: `header`, `header_line`, `data_lines` (indices of lines), `separator`, `decimal`,
    and `notes` on what was left out.
    """

    def __init__(
        self,
        source: Source,
        dialect: Dialect = Dialect(),
        known: Callable[[str], str] = str,
        first: int | None = None,
    ) -> None:
        self.source, self.lines = source, source.lines
        numbers = [i for i in source.filled() if first is None or i >= first]
        if not numbers:
            raise source.error(0, 0, "got an empty file, expected a header line and data")
        self.notes: list[str] = []
        self.separator = dialect.separator or self._separator(numbers)
        space = r"[^\S\t]*" if self.separator == "\t" else r"\s*"
        mark = re.escape(self.separator)
        # a field: in quotes or plain, with spaces around it, then a separator or the end
        self._field = re.compile(rf'{space}(?:("(?:[^"]|"")*"){space}|([^"{mark}]*))({mark}|\Z)')
        self.header_line, self.data_lines = numbers[0], self._data_lines(numbers[1:])
        self._without_ends()
        self.header = [known(name) for name in self.fields(self.header_line)]
        self.decimal = "."
        self._decimal = dialect.decimal

    def error(self, line: int, column: int, what: str) -> FileFormatError:
        """Return an error at a line (index from 0) and a column (from 0) of it."""
        return self.source.error(line, column, what)

    def _separator(self, numbers: Sequence[int]) -> str:
        """Return the mark that splits header and first line into the same number of fields."""
        header, *data = (_QUOTED.sub("", self.lines[i]) for i in numbers[:2])
        there = [mark for mark in ",;\t" if mark in header]
        even = [m for m in there if data and data[0].count(m) == header.count(m)]
        if len(even) > 1:
            raise self.error(
                numbers[0],
                min(header.index(mark) for mark in even),
                f"header: got {' and '.join(SEPARATORS[mark] for mark in even)}, either of which "
                "could separate the columns, expected one (separator= decides)",
            )
        return (even or there or [","])[0]

    def _data_lines(self, numbers: list[int]) -> list[int]:
        """Return the lines of data without those at the end that hold separators only."""
        kept = len(numbers)
        while kept and not self._has_fields(numbers[kept - 1]):
            kept -= 1
        if kept < len(numbers):
            self.notes.append(f"{len(numbers) - kept} empty lines at the end were left out.")
        return numbers[:kept]

    def _without_ends(self) -> None:
        """Leave out the separator that the header and every line of data end with."""
        mark, lines = self.separator, [self.header_line, *self.data_lines]
        ends = [self.lines[i].rstrip(" ").endswith(mark) for i in lines[:2]]
        if len(lines) < 2 or not all(ends):
            return
        if all(self.lines[i].rstrip(" ").endswith(mark) for i in lines):
            self.lines = list(self.lines)
            for i in lines:
                self.lines[i] = self.lines[i].rstrip(" ").removesuffix(mark)
            self.notes.append("Every line ends with a separator, which was left out.")

    def columns(self, numeric: Callable[[str], bool] = lambda _: False) -> dict[str, NDArray[Any]]:
        """Return the fields as text by column name, decimal marks as points.

        numeric: Says whether a column must hold numbers.
        """
        index = self.check_header()
        if not self.data_lines:
            raise self.error(
                self.header_line + 1,
                0,
                "got no line of data, expected at least one below the header",
            )
        columns = self._split()
        self._note_cut_end(columns)
        if index:
            del columns[""]
            self.notes.append("The first column has no name and counts rows: it was left out.")
        sign = '"' if self.separator == "," else ","  # a comma in a field is in quotes there
        if any(sign in self.lines[i] for i in self.data_lines):
            self._with_points(columns, numeric)
        return columns

    def check_header(self) -> bool:
        """Check that every column has a name of its own; whether the first counts rows."""
        starts = self.starts(self.header_line)
        index = bool(self.data_lines) and len(self.header) > 1 and self._has_index()
        for i, name in enumerate(self.header):
            if not name and not (i == 0 and index):
                raise self.error(
                    self.header_line,
                    starts[i],
                    "header: got an empty field, expected the name of a column",
                )
            if name in self.header[:i]:
                raise self.error(
                    self.header_line, starts[i], f"{name}: got the column twice, expected it once"
                )
        return index

    def _note_cut_end(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Note a last line without its end whose last number is shorter than those above it."""
        last = self.data_lines[-1]
        if not self.source.encoding.startswith("UTF") or last < len(self.lines) - 1:
            return
        *others, text = columns[self.header[-1]].tolist()
        numbers = [t for t in others if _POINT.fullmatch(t) or _COMMA.fullmatch(t)]
        if len(numbers) == len(others) > 0 and len(text) < min(map(len, numbers)):
            self.notes.append(
                f"Line {last + 1} has no end, and its last number {text!r} is shorter than all "
                "others of its column: was the file cut off?"
            )

    def _has_index(self) -> bool:
        """Whether the first column is without a name and counts up, as pandas writes it."""
        if self.header[0]:
            return False
        first = [self.lines[i].split(self.separator, 1)[0].strip(' "') for i in self.data_lines]
        if not all(map(_INDEX.fullmatch, first)):
            return False
        return bool(np.all(np.diff(np.array(first, dtype=np.int64)) > 0))

    def _with_points(
        self, columns: dict[str, NDArray[Any]], numeric: Callable[[str], bool]
    ) -> None:
        """Replace decimal commas, once it is sure that commas are such."""
        with_comma = {name: v for name, v in columns.items() if _all(v, _COMMA, _WHOLE, _POINT)}
        commas = [(n, r) for n, v in with_comma.items() for r in _matching(v, _COMMA)[:1]]
        if not commas or self._decimal == ".":
            return
        name, row = commas[0]
        line = self.data_lines[row]
        place = (line, self.starts(line)[self.header.index(name)])
        got = f"{name}: got {columns[name][row]!r}"
        for other, values in columns.items():
            points = _matching(values, _POINT)
            if points and (other in with_comma or numeric(other)):
                raise self.error(
                    *place,
                    f"{got}, but {values[points[0]]!r} in column {other}, line "
                    f"{self.data_lines[points[0]] + 1}, expected one decimal mark in the file",
                )
        fields = [text for v in with_comma.values() for text in v if "," in text]
        if self._decimal is None and all(map(_THOUSANDS.fullmatch, fields)):
            raise self.error(
                *place,
                f"{got}, which may be {columns[name][row].replace(',', '.')} or "
                f"{columns[name][row].replace(',', '')}, expected a decimal mark that is sure "
                '(tn.read with decimal="," or "." decides)',
            )
        self.decimal = ","
        for each, values in with_comma.items():
            columns[each] = np.array([text.replace(",", ".") for text in values], dtype=object)

    def _split(self) -> dict[str, NDArray[Any]]:
        count, mark = len(self.header), self.separator
        lines = [self.lines[number] for number in self.data_lines]
        if any('"' in line for line in lines):
            rows = [self.fields(number) for number in self.data_lines]
            for row, fields in enumerate(rows):
                if len(fields) != count:
                    raise self._wrong_count(row, len(fields))
            flat = [field for fields in rows for field in fields]
        else:
            for row, line in enumerate(lines):
                if line.count(mark) != count - 1:
                    raise self._wrong_count(row, line.count(mark) + 1)
            flat = list(map(str.strip, mark.join(lines).split(mark)))
        columns = {name: np.empty(len(lines), dtype=object) for name in self.header}
        for index, column in enumerate(columns.values()):
            column[:] = flat[index::count]
        return columns

    def _wrong_count(self, row: int, got: int) -> FileFormatError:
        count = len(self.header)
        line = self.data_lines[row]
        starts = self.starts(line)
        if got > count:
            column, at = "after the last column", starts[count]
        else:
            column, at = self.header[got], len(self.lines[line])
        why = self._split_numbers(line, got - count)
        return self.error(
            line,
            at,
            f"{column}: got {got} fields, expected {count}: {', '.join(self.header)}{why}",
        )

    def _split_numbers(self, line: int, more: int) -> str:
        """Say why a line may have so many fields more: a comma in numbers splits them."""
        if self.separator != "," or more <= 0:
            return ""
        fields = self.fields(line)
        pairs = list(pairwise(fields))
        if sum(bool(_POINT_BEHIND.fullmatch(",".join(pair))) for pair in pairs) >= more:
            return " (a comma between thousands? then write the numbers without it)"
        whole = not any("." in field for field in fields)
        if whole and sum(bool(_COMMA.fullmatch(",".join(pair))) for pair in pairs) >= more:
            return " (decimal commas? then separate the columns by semicolons or tabs)"
        return ""

    def located(self, fault: ColumnError) -> Exception:
        """Return the error of the file that a fault of its table is."""
        line = self.header_line if fault.row is None else self.data_lines[fault.row]
        at = 0
        if fault.column in self.header:
            at = self.starts(line)[self.header.index(fault.column)]
        empty = fault.row is not None and not self._has_fields(line)
        return self.error(line, at, fault.said + " (the whole row is empty)" * empty)

    def _has_fields(self, line: int) -> bool:
        """Whether a line holds more than separators."""
        return bool(self.lines[line].strip(self.separator + " \t"))

    def fields(self, line: int) -> list[str]:
        """Return the fields of one line, without spaces and quotes around them."""
        return [field for _, field in self._pieces(line)]

    def starts(self, line: int) -> list[int]:
        """Return the index in the line at which each field begins."""
        return [start for start, _ in self._pieces(line)]

    def _pieces(self, line: int) -> list[tuple[int, str]]:
        """Split one line; quotes are around a whole field or nowhere, and doubled within it."""
        text = self.lines[line]
        pieces, at, more = [], 0, self.separator
        while more:
            match = self._field.match(text, at)
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


def _all(values: NDArray[Any], *patterns: re.Pattern[str]) -> bool:
    """Whether every field is empty or like one of the patterns."""
    return all(not text or any(p.fullmatch(text) for p in patterns) for text in values)


def _matching(values: NDArray[Any], pattern: re.Pattern[str]) -> list[int]:
    """Return the rows whose field is like a pattern."""
    return [row for row, text in enumerate(values) if pattern.fullmatch(text)]
