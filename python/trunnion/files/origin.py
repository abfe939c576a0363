"""Where the rows of a table were read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from trunnion.base.units import Integers
from trunnion.files.recognised import Recognised


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
    """

    files: tuple[str, ...]
    file: Integers
    line: Integers
    recognised: tuple[Recognised | None, ...] = ()

    def __getitem__(self, index: Any) -> Origin:
        """Return the origin of some rows."""
        return replace(self, file=self.file[index], line=self.line[index])

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
        file, line = [], []
        for table in tables:
            if table.origin is None:
                file.append(np.full(len(table), -1))
                line.append(np.zeros(len(table), dtype=np.intp))
                continue
            number = [files.setdefault(name, len(files)) for name in table.origin.files]
            file.append(np.append(number, -1)[table.origin.file])
            line.append(table.origin.line)
        known = {f: r for t in tables if t.origin for f, r in t.origin._recognised.items()}
        return cls(
            tuple(files),
            np.concatenate(file),
            np.concatenate(line),
            tuple(known.get(name) for name in files),
        )

    @property
    def _recognised(self) -> dict[str, Recognised]:
        return {f: r for f, r in zip(self.files, self.recognised, strict=False) if r is not None}
