"""Where each key of a TOML text stands, which tomllib does not say.

The scanner walks over text that tomllib has accepted, so it need not judge syntax: it only has to
know where strings, comments, arrays and inline tables begin and end.
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike

from trunnion.base.errors import FileFormatError
from trunnion.base.input import file_bytes
from trunnion.files.text import decode, position_of

MAX_DEPTH = 40
"""Tables and arrays in one another."""

MAX_NUMBER = 1000
"""Characters of a number, a date or a flag."""

_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'', re.DOTALL
)
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SPACE = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SCALAR = re.compile(r"[^,\]}#\n]*")
_MESSAGE = re.compile(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", re.DOTALL)


@dataclass(frozen=True)
class Span:
    """Offsets into the text: where the key begins, where its value begins and ends."""

    key: int
    value: int
    end: int


@dataclass(frozen=True)
class TomlText:
    """A parsed TOML file that knows where each of its keys stands.

    `spans` has one entry a key and table header, by the path of keys; an element of an array of
    tables has its index in the path.
    """

    path: str
    text: str
    tables: Mapping[str, object]
    spans: Mapping[tuple[str | int, ...], Span]

    @classmethod
    def read(cls, path: str | PathLike[str]) -> "TomlText":
        """Read and parse a file; a file that is not TOML raises FileFormatError with its place."""
        name = str(path)
        text = decode(name, file_bytes(path))
        tables: Mapping[str, object] | None = None
        try:
            try:
                tables = tomllib.loads(text)
            except tomllib.TOMLDecodeError as error:
                raise _syntax_error(name, text, error) from None
            except (ValueError, RecursionError):
                pass  # digits or depth beyond Python's limits: the scanner says where
            spans = _Scanner(text).scan()
        except _LimitError as limit:
            line, column = position_of(text, limit.at)
            raise FileFormatError(f"{name}:{line}:{column}: {limit}") from None
        except RecursionError:
            tables = None
        if tables is None:
            raise FileFormatError(f"{name}:1:1: got values that Python does not hold")
        return cls(name, text, tables, spans)

    def error(self, keys: tuple[str | int, ...], what: str, *, at_value: bool) -> FileFormatError:
        """Return the error `what` at a key or its value; at the nearest table if absent."""
        return FileFormatError(f"{self.place(keys, at_value=at_value)}: {what}")

    def place(self, keys: tuple[str | int, ...], *, at_value: bool) -> str:
        """Return file, line and column of a key or its value; of the nearest table if absent."""
        while keys and keys not in self.spans:
            keys, at_value = keys[:-1], False
        span = self.spans.get(keys, Span(0, 0, 0))
        line, column = position_of(self.text, span.value if at_value else span.key)
        return f"{self.path}:{line}:{column}"

    def written(self, keys: tuple[str | int, ...]) -> str | None:
        """Return the value of a key as it stands in the file, None for a table or an absent key."""
        span = self.spans.get(keys)
        return None if span is None else self.text[span.value : span.end].strip() or None


_LIKELY = (
    (re.compile(r"[^=\"']*=[^#\"']*\d,\d[^#,\]]*($|#)"), " (a decimal comma? TOML has points)"),
    (re.compile(r"[^=]*=\s*[^\W\d]"), ' (text stands in quotes: "...")'),
)
"""How a line that is no TOML looks, and what is likely wrong with it."""


def _syntax_error(name: str, text: str, error: Exception) -> FileFormatError:
    match = _MESSAGE.fullmatch(str(error))
    if match is None:
        return FileFormatError(f"{name}:1:1: got a file that is not TOML: {error}")
    what, line, column = match.groups()
    if line is None:
        line, column = (str(number) for number in position_of(text, None))
    stood = text.split("\n")[int(line) - 1].strip()
    why = next((said for like, said in _LIKELY if like.match(stood)), "")
    return FileFormatError(
        f"{name}:{line}:{column}: got {stood[:80]!r}, expected TOML: {what}{why}"
    )


class _LimitError(Exception):
    """Something at an offset into the text that is larger than any set-up needs."""

    def __init__(self, at: int, what: str) -> None:
        super().__init__(what)
        self.at = at


class _Scanner:
    """One pass over the text; `at` is the offset reached."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.spans: dict[tuple[str | int, ...], Span] = {}
        self.lengths: dict[tuple[str | int, ...], int] = {}  # arrays of tables

    def scan(self) -> dict[tuple[str | int, ...], Span]:
        table: tuple[str | int, ...] = ()
        self.space()
        while self.at < len(self.text):
            start = self.at
            if self.text[self.at] == "[":
                many = self.text.startswith("[[", self.at)
                self.at += 2 if many else 1
                table = self.header(self.keys(), append=many)
                self.at += 2 if many else 1
                self.check_depth(table, start)
                self.spans.setdefault(table, Span(start, start, start))
            else:
                self.pair(table)
            self.space()
        return self.spans

    def header(self, keys: tuple[str, ...], *, append: bool) -> tuple[str | int, ...]:
        """Path of a table header: below an array of tables, its last element."""
        path: tuple[str | int, ...] = ()
        for place, key in enumerate(keys):
            path += (key,)
            if append and place == len(keys) - 1:
                self.lengths[path] = self.lengths.get(path, 0) + 1
            if path in self.lengths:
                path += (self.lengths[path] - 1,)
        return path

    def space(self) -> None:
        self.at = self.end_of(_SPACE)

    def end_of(self, pattern: re.Pattern[str]) -> int:
        match = pattern.match(self.text, self.at)
        return self.at if match is None else match.end()

    def keys(self) -> tuple[str, ...]:
        """Read a dotted key up to what follows it (``=`` or ``]``)."""
        keys: list[str] = []
        while True:
            self.space()
            start = self.at
            quoted = self.text[self.at : self.at + 1] in ('"', "'")
            self.at = self.end_of(_STRING if quoted else _BARE)
            word = self.text[start : self.at]
            keys.append(next(iter(tomllib.loads(f"{word} = 0"))) if quoted else word)
            self.space()
            if self.text[self.at : self.at + 1] != ".":
                return tuple(keys)
            self.at += 1

    def pair(self, table: tuple[str | int, ...]) -> None:
        start = self.at
        path = (*table, *self.keys())
        self.check_depth(path, start)
        self.at += 1  # the equals sign
        self.space()
        value = self.at
        self.value(path)
        for length in range(len(table) + 1, len(path)):  # a.b = 1 makes the table a
            self.spans.setdefault(path[:length], Span(start, start, start))
        self.spans[path] = Span(start, value, self.at)

    def value(self, path: tuple[str | int, ...]) -> None:
        first = self.text[self.at : self.at + 1]
        if first in ('"', "'"):
            self.at = self.end_of(_STRING)
        elif first in ("[", "{"):
            self.at += 1
            self.space()
            index = 0
            while self.text[self.at : self.at + 1] not in ("]", "}", ""):
                if first == "{":
                    self.pair(path)
                else:
                    start = self.at
                    self.check_depth((*path, index), start)
                    self.value((*path, index))
                    self.spans[(*path, index)] = Span(start, start, self.at)
                    index += 1
                self.space()
                self.at += self.text.startswith(",", self.at)
                self.space()
            self.at += 1
        else:
            start, self.at = self.at, self.end_of(_SCALAR)
            if (length := len(self.text[start : self.at].strip())) > MAX_NUMBER:
                what = f"got {length} characters, expected a number of at most {MAX_NUMBER}"
                raise _LimitError(start, what)

    def check_depth(self, path: tuple[str | int, ...], start: int) -> None:
        if len(path) > MAX_DEPTH:
            what = f"got tables or arrays nested too deeply, expected at most {MAX_DEPTH} levels"
            raise _LimitError(start, what)
