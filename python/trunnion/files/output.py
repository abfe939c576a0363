"""Writing files: whole or not at all, and over another file only where that was asked for."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trunnion.base.errors import InputError


def check_new(path: Path, *, overwrite: bool) -> None:
    """Refuse a path where a file stands already.

    Raises
    ------
    InputError
        There is a file, and `overwrite` is false.
    """
    if not overwrite and path.exists():
        raise InputError(f"{path}: the file exists already; give --force to overwrite it")


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a path to write to; what was written there takes the place of `path` at the end.

    A writer that fails leaves `path` as it was.
    """
    target = Path(path)
    handle, name = tempfile.mkstemp(
        prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent
    )
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        mode = target.stat().st_mode if target.exists() else 0o666 & ~_umask()
        draft.chmod(mode & 0o777)
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write text as UTF-8, whole or not at all."""
    with whole_file(path) as draft:
        draft.write_text(text, encoding="utf-8")
