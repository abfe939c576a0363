"""Reading what was stored as JSON: a fault is an error of the package that names its place."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

from trunnion.base.errors import FileFormatError, InputError, TrunnionError


def read_json(source: str | PathLike[str]) -> tuple[Any, str]:
    """Return what JSON text, or a file of it, holds, and what messages call its place.

    Raises
    ------
    FileFormatError
        It is not JSON; the message names line and column.
    """
    text, where = str(source), "JSON"
    if not isinstance(source, str | PathLike):
        raise InputError(f"source: got {type(source).__name__}, expected JSON text or a path")
    if isinstance(source, PathLike) or not text.lstrip().startswith(("{", "[", '"')):
        if "\n" in text or "\0" in text or len(text) > MAX_PATH:
            raise FileFormatError(f"{where}:1:1: got {text[:20]!r}, expected a table {{...}}")
        where = text
        raw = Path(source).read_bytes()
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError as error:
            line = raw.count(b"\n", 0, error.start) + 1
            column = error.start - raw.rfind(b"\n", 0, error.start)
            raise FileFormatError(
                f"{where}:{line}:{column}: got the byte 0x{raw[error.start]:02x}, expected UTF-8"
            ) from None
    try:
        return json.loads(text, parse_constant=_no_constant), where
    except json.JSONDecodeError as error:
        raise FileFormatError(
            f"{where}:{error.lineno}:{error.colno}: got {error.msg}, expected JSON"
        ) from error
    except (ValueError, RecursionError) as error:  # nan, thousands of digits, of brackets
        raise FileFormatError(f"{where}:1:1: {error}") from None


MAX_PATH = 4000
"""Characters of a path; more is text."""


def _no_constant(name: str) -> float:
    raise ValueError(f"got {name}, expected JSON: numbers are finite there")


@contextmanager
def fitting(what: str) -> Iterator[None]:
    """Make an InputError of what stored values of another shape lead to, whatever it is."""
    try:
        yield
    except TrunnionError:
        raise
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise InputError(f"{what}: got values that do not fit its fields: {error}") from error
