"""Files that a command is given: data and set-ups in any order, which there are, and how many."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from trunnion.base.errors import InputError


def near_file(path: str | Path) -> str:
    """Say which file there is meant, if one has nearly this name."""
    from trunnion.base.checks import nearest

    folder = Path(path).parent
    names = [each.name for each in folder.iterdir()] if folder.is_dir() else []
    near = nearest(Path(path).name, names)
    return "" if near is None else f"; did you mean {folder / near}?"


def sort_files(
    files: Iterable[Path],
    data: tuple[int, int],
    set_ups: tuple[int, int],
    what: str = "data",
    *,
    exist: bool = True,
) -> tuple[list[Path], list[Path]]:
    """Return data and set-ups (.toml) in the order given.

    files: As given on the command line.
    data, set_ups: Smallest and largest number of each.
    what: What the data are called in the message.
    exist: Whether data that do not exist are refused; a set-up always is.

    Raises InputError: other numbers of files, or a file that does not exist.
    """
    files = list(files)
    found = [f for f in files if f.suffix.lower() != ".toml"]
    toml = [f for f in files if f.suffix.lower() == ".toml"]
    if not (data[0] <= len(found) <= data[1] and set_ups[0] <= len(toml) <= set_ups[1]):
        raise InputError(
            f"files: got {_named(found)} as {what} and {_named(toml)} as set-up (.toml), expected "
            f"{_count(data)} of {what} and {_count(set_ups)} set-up"
        )
    for file in files if exist else toml:
        if not file.exists():
            raise InputError(f"{file}: no such file or directory{near_file(file)}")
    return found, toml


def _named(files: list[Path]) -> str:
    return ", ".join(map(str, files)) or "none"


def one_set_up(files: Iterable[Path], data: tuple[int, int], what: str) -> tuple[list[Path], Path]:
    """Return the data and the one set-up among the files of a command."""
    found, toml = sort_files(files, data, (1, 1), what)
    return found, toml[0]


def _count(bounds: tuple[int, int]) -> str:
    low, high = bounds
    return (
        str(low) if low == high else f"{low} or {high}" if high == low + 1 else f"{low} to {high}"
    )
