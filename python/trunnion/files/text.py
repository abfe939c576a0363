"""Text of a file, and where in it something stands."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from os import PathLike

from trunnion.base.errors import FileFormatError, InputError
from trunnion.base.input import file_bytes

_MARKS = (
    (codecs.BOM_UTF8, "utf-8", "UTF-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16-be", "UTF-16"),
)
"""Byte-order marks; without one a text is UTF-8."""


@dataclass(frozen=True)
class Source:
    """The lines of a file.

    Attributes
    ----------
    name
        File, as messages call it.
    lines
        Its lines, without their ends.
    encoding
        How the text was stored: UTF-8, UTF-16, or the sheet of a workbook.
    """

    name: str
    lines: list[str]
    encoding: str = "UTF-8"

    @classmethod
    def of(cls, path: str | PathLike[str], sheet: str | None = None) -> Source:
        """Return the lines of a text file, of one sheet of a workbook (xlsx), or of Parquet."""
        raw = file_bytes(path)
        if raw.startswith(b"PK\x03\x04"):
            from trunnion.files.workbook import sheet_lines

            return cls(str(path), *sheet_lines(str(path), raw, sheet))
        if sheet is not None:
            raise InputError(
                f"{path}: got no workbook (xlsx), and the sheet {sheet!r}; expected a workbook, or "
                "no name of a sheet"
            )
        if raw.startswith(b"PAR1"):
            from trunnion.files.workbook import parquet_lines

            return cls(str(path), parquet_lines(str(path), raw), "Parquet")
        return cls(str(path), decode(str(path), raw).split("\n"), _encoding(raw)[2])

    def error(self, line: int, column: int, what: str) -> FileFormatError:
        """Return an error at a line (index from 0) and a column (from 0) of it."""
        return FileFormatError(f"{self.name}:{line + 1}:{column + 1}: {what}")

    def filled(self) -> list[int]:
        """Return the indices of the lines that are neither blank nor comments (``#``)."""
        return [
            i for i, line in enumerate(self.lines) if (text := line.lstrip()) and text[0] != "#"
        ]


def decode(name: str, raw: bytes) -> str:
    """Return the text of a file's bytes, every line end as a line feed.

    The text is UTF-8, or what its byte-order mark says. `name` is the file's name in the message of
    the FileFormatError that other bytes raise.
    """
    mark, codec, encoding = _encoding(raw)
    raw = raw.removeprefix(mark)
    try:
        text = raw.decode(codec)
    except UnicodeDecodeError as error:
        line, column = position_of(_line_feeds(raw[: error.start].decode(codec)), None)
        raise FileFormatError(
            f"{name}:{line}:{column}: got the byte 0x{raw[error.start]:02x}, expected "
            f"{encoding} text{'' if mark else ' (in Excel: save as CSV UTF-8)'}"
        ) from None
    return _line_feeds(text)


def position_of(text: str, offset: int | None) -> tuple[int, int]:
    """Return line and column, both from 1, of an offset into a text (None: its end)."""
    before = text[:offset]
    return before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1


def _encoding(raw: bytes) -> tuple[bytes, str, str]:
    """Return byte-order mark, codec and name of the encoding."""
    found = next((known for known in _MARKS if raw.startswith(known[0])), None)
    return found or (b"", "utf-8", "UTF-8")


def _line_feeds(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")
