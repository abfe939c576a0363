"""What users give: files that are read, paths to read or to write, lists of numbers."""

from __future__ import annotations

import errno
import math
import os
from os import PathLike
from pathlib import Path

from trunnion.base.errors import InputError
from trunnion.base.read_files import read_and_noted

_NO_NAME = (errno.ENAMETOOLONG, errno.EINVAL, errno.ELOOP)
"""What the system says of a name that no file can have."""


def path_of(path: object, what: str = "path", expected: str = "the path of a file") -> Path:
    """Return a path that a file may have; whether there is one is another matter.

    Raises InputError: no path, or one that the system takes for no name of a file.
    """
    why = ""
    if isinstance(path, str | PathLike):
        try:
            found = Path(path)
            os.lstat(found)
        except (TypeError, ValueError) as error:  # no text, or a character that no name may hold
            why = f" ({error})"
        except OSError as error:
            if error.errno not in _NO_NAME:
                return found
            why = f" ({os.strerror(error.errno or 0).lower()}: is it what the file holds?)"
        else:
            return found
    from trunnion.base.checks import shown  # imports numpy, which --help does without

    got = shown(str(path) if isinstance(path, Path) else path)
    raise InputError(f"{what}: got {got}, expected {expected}{why}") from None


def file_bytes(path: str | PathLike[str]) -> bytes:
    """Return what a file holds.

    Raises InputError: a folder, or no path. OSError: no such file, or one that may not be read.
    """
    try:
        return read_and_noted(path_of(path), path)
    except IsADirectoryError:
        raise InputError(f"{path}: got a folder, expected a file") from None


MAX_LISTED = 100_000
"""Numbers that a range may stand for."""


def listed_numbers(what: str, text: str) -> list[float]:
    """Return ``"0,90,180"`` or ``"0:330:30"`` (first, last, step) as numbers.

    Raises InputError: anything else.
    """
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            if not math.isfinite(step):
                raise ValueError(text)
            count = int((last - first) / step + 1e-9) + 1
            if count < 1 or count > MAX_LISTED:
                raise ValueError(text)
            return [first + i * step for i in range(count)]
        if not text.strip(" ,"):
            raise ValueError(text)
        return [float(part) for part in text.split(",") if part.strip()]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError(
            f"{what}: got {text!r}, expected numbers such as 0,90,180 or first:last:step"
        ) from None
