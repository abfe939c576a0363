"""Writing files: whole or not at all, and over another file only where that was asked for.

Every file of the package is written by :func:`whole_file`: to a draft beside it, which is on the
disk before it takes the file's place. The Python API overwrites, as pandas does; the commands do
with ``--force`` only.
"""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from trunnion.base.errors import InputError, TrunnionError
from trunnion.base.input import path_of

LOG = logging.getLogger("trunnion.files")
PAGE = "a page (HTML)"

WRITTEN = {
    "an NC program": (".ngc", ".nc", ".tap", ".gcode", ".mpf", ".spf"),
    PAGE: (".html", ".htm"),
    "a log of touches": (".log",),
    "a table of corrections": (".comp", ".tbl"),
}
"""What is written whatever the name says, and the endings of its own. Other endings that no file of
`OTHERS` has may be those of a control."""
OTHERS = {
    **dict.fromkeys((".csv", ".parquet"), "a table"),
    **dict.fromkeys((".xlsx", ".xls", ".ods"), "a workbook"),
    ".json": "a result",
    ".toml": "a set-up",
    **dict.fromkeys((".png", ".svg"), "a picture"),
    **dict.fromkeys((".pdf", ".docx"), "a document"),
    **{ending: what for what, endings in WRITTEN.items() for ending in endings},
    ".netcdf": "netCDF",
}
"""What is in files of an ending: a file of another kind is not written there."""


def check_ending(path: Path, what: str) -> None:
    """Refuse a name whose ending says another kind of file than is written there.

    what: A key of `WRITTEN`.

    Raises
    ------
    InputError
        The ending is known, and not one of this kind; of a page any other: a browser shows none.
    """
    ending = path.suffix.lower()
    known = OTHERS if what != PAGE else {**OTHERS, ending: OTHERS.get(ending, "no page")}
    if ending in known and ending not in WRITTEN[what]:
        raise InputError(
            f"{path}: got the ending {path.suffix!r} ({known[ending]}) for {what}, expected one "
            f"such as {WRITTEN[what][0]}"
        )


def check_among(path: Path, endings: Iterable[str], note: str = "") -> None:
    """Refuse a name whose ending is none of those that can be written.

    note: What an ending that is none of them is known to be.

    Raises
    ------
    InputError
        It is none of them.
    """
    known = tuple(endings)
    if path.suffix.lower() not in known:
        raise InputError(
            f"{path}: got the ending {path.suffix!r}{note}, expected one of {', '.join(known)}"
        )


def check_folder(path: Path) -> None:
    """Refuse a folder for files that is none and cannot be made.

    Raises
    ------
    InputError
        There is a file, or nothing and its name is that of a file; or it would stand in a folder
        that is not there.
    """
    expected = "expected the name of a folder for several files"
    if path.is_dir():
        return
    if path.exists():
        raise InputError(f"{path}: got a file, {expected}")
    if ending := OTHERS.get(path.suffix.lower(), ""):
        raise InputError(f"{path}: got the ending {path.suffix!r} ({ending}), {expected}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent} to make it in")


def check_new(path: Path, *, overwrite: bool) -> None:
    """Refuse a path where a file stands already, and a folder in any case.

    Raises
    ------
    InputError
        There is a file, and `overwrite` is false; or a folder; or none to write the file to.
    """
    _check_parent(path)
    if path.is_dir():
        raise InputError(
            f"{path}: got a folder, expected the name of a file (did you mean {path / 'NAME'}?)"
        )
    there = path.is_file() or path.is_symlink()  # no pipe, no device
    if there and not overwrite:
        raise InputError(f"{path}: the file exists already; give --force to overwrite it")


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a path to write to; what was written there takes the place of `path` at the end.

    A writer that fails leaves `path` as it was. A link keeps pointing to the file that is written;
    a device or a pipe is written to as it is.
    """
    target = path_of(path)
    target = target.resolve() if target.is_symlink() else target
    if target.exists() and not target.is_file():
        yield target
        return
    _check_parent(target)
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{target.stem[:40]}-", suffix=target.suffix[:20], dir=target.parent
        )
    except OSError as error:
        error.filename = os.fspath(path)
        raise
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        mode = target.stat().st_mode if target.exists() else 0o666 & ~_umask()
        draft.chmod(mode & 0o777)
        with draft.open("rb+") as written:
            os.fsync(written.fileno())
        draft.replace(target)
        if target.name[0] != ".":  # none of the drafts of a file that is written through others
            LOG.info("wrote %s, %d bytes", target, target.stat().st_size)
    except TrunnionError as error:  # the draft's name says nothing to who gave `path`
        error.args = (str(error).replace(name, os.fspath(path)),)
        raise
    finally:
        draft.unlink(missing_ok=True)


def _check_parent(path: Path) -> None:
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent} to write it to")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write text as UTF-8 with line feeds, whole or not at all."""
    with whole_file(path) as draft:
        draft.write_text(text, encoding="utf-8", newline="\n")
