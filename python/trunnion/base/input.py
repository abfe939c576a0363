"""Files that are read."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from trunnion.base.errors import InputError


def file_bytes(path: str | PathLike[str]) -> bytes:
    """Return what a file holds.

    Raises InputError: a folder. OSError: no such file, or one that may not be read.
    """
    try:
        return Path(path).read_bytes()
    except IsADirectoryError:
        raise InputError(f"{path}: got a folder, expected a file") from None
