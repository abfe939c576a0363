"""Where the rows of a table were read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.read_files import RecordedFile, as_read
from trunnion.base.stored import structured
from trunnion.base.units import Integers
from trunnion.files.recognised import Recognised

FROM_0 = " (counted from 0)"


class HasOrigin(Protocol):
    """Rows that may have been read from files: a table."""

    @property
    def origin(self) -> Origin | None:
        """File and line of each row."""
        ...

    def __len__(self) -> int: ...


@dataclass(frozen=True, eq=False)
class Origin:
    """Where the rows of a table were read: messages name the file and its line.

    Attributes
    ----------
    files
        Files, as they were given to the reader.
    file
        Which of them each row is from, (n,); -1: a row that was not read from a file.
    line
        Line of each row in its file, from 1, (n,).
    recognised
        What each of the files was taken for; empty where that is not known.
    touch
        Number of each row in the plan that it is of, from 1, (n,); 0: of none. None: no plans.
    read
        Each of the files as it was when it was read; empty where that is not known.
    """

    files: tuple[str, ...]
    file: Integers
    line: Integers
    recognised: tuple[Recognised | None, ...] = ()
    touch: Integers | None = None
    read: tuple[RecordedFile | None, ...] = ()

    @classmethod
    def of(
        cls, file: str, line: Integers, recognised: Recognised | None, touch: Integers | None
    ) -> Origin:
        """Return the origin of rows of one file, which its reader has read a moment ago."""
        read = as_read(file, "data")
        return cls((file,), np.zeros(len(line), dtype=np.intp), line, (recognised,), touch, (read,))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], rows: int) -> Origin:
        """Return the origin of so many rows from plain values.

        Raises
        ------
        InputError
            A row without a file or a line, or in a file that is not named.
        """
        file, line = (np.asarray(values[key], dtype=np.intp) for key in ("file", "line"))
        files = tuple(map(str, values["files"]))
        touch = values.get("touch")
        touch = None if touch is None else np.asarray(touch, dtype=np.intp)
        named = len(files) > file.max(initial=-1) and file.min(initial=0) >= -1
        if not named or any(
            each is not None and each.shape != (rows,) for each in (file, line, touch)
        ):
            raise InputError(f"origin: got {dict(values)!r:.60}, expected file and line a row")
        known = tuple(r and Recognised.from_dict(r) for r in values.get("recognised", ()))
        read = tuple(r and structured(r, RecordedFile) for r in values.get("read", ()))
        return cls(files, file, line, known, touch, read)

    def __getitem__(self, index: Any) -> Origin:
        """Return the origin of some rows."""
        touch = None if self.touch is None else self.touch[index]
        return replace(self, file=self.file[index], line=self.line[index], touch=touch)

    @property
    def names(self) -> tuple[str, ...]:
        """What messages call the files: without the folder where that is enough."""
        short = [Path(file).name for file in self.files]
        return tuple(
            file if short.count(name) > 1 else name
            for file, name in zip(self.files, short, strict=True)
        )

    @classmethod
    def joined(cls, tables: Sequence[HasOrigin]) -> Origin | None:
        """Return the origin of the rows of tables put one below the other."""
        if all(table.origin is None for table in tables):
            return None
        files: dict[str, int] = {}
        file, line, touch = [], [], []
        for table in tables:
            if table.origin is None or table.origin.touch is None:
                touch.append(np.zeros(len(table), dtype=np.intp))
            else:
                touch.append(table.origin.touch)
            if table.origin is None:
                file.append(np.full(len(table), -1))
                line.append(np.zeros(len(table), dtype=np.intp))
                continue
            number = [files.setdefault(name, len(files)) for name in table.origin.files]
            file.append(np.append(number, -1)[table.origin.file])
            line.append(table.origin.line)
        known = {f: r for t in tables if t.origin for f, r in t.origin._recognised.items()}
        read = {f.file: f for t in tables if t.origin for f in t.origin.as_read()}
        return cls(
            tuple(files),
            np.concatenate(file),
            np.concatenate(line),
            tuple(known.get(name) for name in files),
            np.concatenate(touch) if any(map(np.any, touch)) else None,
            tuple(read.get(name) for name in files),
        )

    def as_read(self) -> tuple[RecordedFile, ...]:
        """Return the files as they were when they were read."""
        read = self.read or (None,) * len(self.files)
        pairs = zip(self.files, read, strict=False)
        return tuple(r or RecordedFile.unknown(file, "data") for file, r in pairs)

    @property
    def _recognised(self) -> dict[str, Recognised]:
        return {f: r for f, r in zip(self.files, self.recognised, strict=False) if r is not None}


def places(table: HasOrigin, rows: Sequence[int], most: int = 20) -> str:
    """Say where people find rows: "lines 59 and 142 of touches.csv", or the rows, from 0.

    Those of the log of a plan: "line 15 of run.log (touch 12)".
    """
    origin = getattr(table, "origin", None)
    found: dict[int, list[int]] = {}
    for row in rows[:most]:
        found.setdefault(-1 if origin is None else int(origin.file[row]), []).append(row)
    parts = []
    for file, mine in found.items():
        if origin is None or file < 0:
            parts.append(f"{_counted('row', mine)}{FROM_0}")
            continue
        of_plan = [] if origin.touch is None else [n for n in origin.touch[mine].tolist() if n]
        touches = f" ({_counted('touch', of_plan, 'touches')})" if of_plan else ""
        lines = _counted("line", origin.line[mine].tolist())
        parts.append(f"{lines} of {origin.names[file]}{touches}")
    more = f" and {len(rows) - most} more" if len(rows) > most else ""
    return ", ".join(parts) + more


def _counted(what: str, numbers: Sequence[int], several: str = "") -> str:
    *most, last = map(str, numbers)
    return f"{several or f'{what}s'} {', '.join(most)} and {last}" if most else f"{what} {last}"
