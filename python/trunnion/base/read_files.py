"""Files as they were when they were read: size, date and checksum, for the record of a result.

They are taken of the bytes that are read anyway: a file that changes, moves or goes afterwards, and
another folder to work in, do not change them.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

MAX_KNOWN = 10_000
"""Files of which it is known how they were read last."""
_KNOWN: dict[str, RecordedFile] = {}


@dataclass(frozen=True)
class RecordedFile:
    """An input file as it was when it was read.

    file: Path, as it was given.
    what: "data", "input", "effects" or "set-up".
    bytes: Size; None where it is not known.
    changed: Date of its last change.
    sha256: Checksum, in hexadecimal digits; empty where it is not known.
    """

    file: str
    what: str
    bytes: int | None
    changed: str
    sha256: str

    @classmethod
    def unknown(cls, path: str, what: str, why: str = "not recorded when read") -> RecordedFile:
        """Return a file of which the path alone is known."""
        return cls(path, what, None, why, "")

    @classmethod
    def now(cls, path: str | PathLike[str], what: str) -> RecordedFile:
        """Return a file as it is now, where nothing is known of when it was read."""
        try:
            if not Path(path).is_file():  # a pipe is read once only
                return cls.unknown(str(path), what, "no file")
            with Path(path).open("rb") as opened:
                return _of(path, opened.read(), os.fstat(opened.fileno()), what)
        except (OSError, ValueError):
            return cls.unknown(str(path), what, "not there any more")


def read_and_noted(path: Path, given: str | PathLike[str]) -> bytes:
    """Return what a file holds, and keep in mind with which size, date and checksum it was read."""
    with path.open("rb") as opened:
        about, raw = os.fstat(opened.fileno()), opened.read()
    if len(_KNOWN) >= MAX_KNOWN:
        _KNOWN.pop(next(iter(_KNOWN)), None)
    _KNOWN[os.path.abspath(path)] = _of(given, raw, about, "input")
    return raw


def as_read(path: str | PathLike[str], what: str) -> RecordedFile | None:
    """Return a file as it was when it was last read; None: it was not."""
    try:
        known = _KNOWN.get(os.path.abspath(path))
    except (OSError, ValueError):  # no name of a file, or no folder to work in
        return None
    return known and replace(known, file=str(path), what=what)


def _of(path: str | PathLike[str], raw: bytes, about: os.stat_result, what: str) -> RecordedFile:
    import hashlib  # not to be loaded for --help
    import stat
    from datetime import UTC, datetime

    when = "no file"
    if stat.S_ISREG(about.st_mode):
        when = datetime.fromtimestamp(about.st_mtime, UTC).astimezone().isoformat(" ", "minutes")
    return RecordedFile(str(path), what, len(raw), when, hashlib.sha256(raw).hexdigest())
