"""Where the blocks of a sweep go: arrays in memory, and a file that survives an interruption.

While a sweep runs, its blocks are rows of an SQLite database beside the result (``.part``): each
is there wholly or not at all, whatever stops the process, and the file may be read meanwhile. The
end is one netCDF file.
"""

from __future__ import annotations

import json
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from trunnion.base.errors import DataError, InputError
from trunnion.studies.study import Block, Floats

__all__ = ["Blocks", "Journal", "alone", "check_same"]

Place = tuple[int, int, int]
"""Node, first sample, number of samples."""
EVERY_S = 0.25
"""Blocks are written to the disk together that come within this time."""
_HELD: set[Path] = set()
"""What this process holds: its own locks do not keep a process out."""


class Blocks:
    """All outputs in memory, (nodes, samples, columns), and the samples that failed."""

    def __init__(self, nodes: int, samples: int, columns: int) -> None:
        self.columns: Floats = np.full((nodes, samples, columns), np.nan)
        self.done = np.zeros((nodes, samples), dtype=bool)
        self.failures: dict[tuple[int, int], str] = {}

    def put(self, place: Place, block: Block) -> None:
        """Take a block."""
        node, first, count = place
        if block.columns.shape != (count, self.columns.shape[2]):
            # A block in which every sample failed cannot know how many outputs there are.
            if len(block.failures) < count:
                raise InputError(
                    f"study: got outputs of shape {block.columns.shape}, wanted "
                    f"{(count, self.columns.shape[2])}: the same names at every node"
                )
        else:
            self.columns[node, first : first + count] = block.columns
        self.done[node, first : first + count] = True
        for index, why in block.failures:
            self.failures[node, first + index] = why


class Journal:
    """Blocks on disk, each wholly there or not at all."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def start(self, described: dict[str, Any]) -> None:
        """Create it, or check that it belongs to the same sweep.

        Raises
        ------
        DataError
            The file holds another sweep, or is none.
        """
        with self._open() as base:
            base.execute("CREATE TABLE IF NOT EXISTS sweep (described TEXT)")
            base.execute(
                "CREATE TABLE IF NOT EXISTS block (node INTEGER, first INTEGER, count INTEGER, "
                "columns BLOB, width INTEGER, failures TEXT, PRIMARY KEY (node, first))"
            )
            found = base.execute("SELECT described FROM sweep").fetchone()
            if found is None:
                text = json.dumps(described, sort_keys=True)
                base.execute("INSERT INTO sweep VALUES (?)", (text,))
            else:
                check_same(self.path, self._described(found[0]), described)

    def described(self) -> dict[str, Any]:
        """What the sweep is."""
        with self._open() as base:
            found = base.execute("SELECT described FROM sweep").fetchone()
        if found is None:
            raise DataError(f"{self.path}: got no sweep, wanted one that has begun")
        return self._described(found[0])

    @contextmanager
    def writing(self) -> Iterator[Callable[[Place, Block], None]]:
        """What adds a block; one that is there already stays.

        Blocks are on the disk `EVERY_S` later at most, all of them at the end, even one that an
        exception makes.
        """
        with self._open() as base:
            last = time.monotonic()

            def write(place: Place, block: Block) -> None:
                nonlocal last
                columns = np.ascontiguousarray(block.columns, dtype="<f8")
                row = (*place, columns.tobytes(), columns.shape[1], json.dumps(block.failures))
                base.execute("INSERT OR IGNORE INTO block VALUES (?, ?, ?, ?, ?, ?)", row)
                if time.monotonic() - last > EVERY_S:
                    base.commit()
                    last = time.monotonic()

            try:
                yield write
            finally:
                base.commit()

    def read(self) -> Iterator[tuple[Place, Block]]:
        """All blocks so far."""
        with self._open() as base:
            rows = base.execute("SELECT node, first, count, columns, width, failures FROM block")
            for node, first, count, data, width, failures in rows:
                try:
                    columns = np.frombuffer(data, dtype="<f8").reshape(count, width)
                    told = tuple((int(index), str(why)) for index, why in json.loads(failures))
                except (TypeError, ValueError):
                    raise DataError(
                        f"{self.path}: the block of node {node} from sample {first} is damaged; "
                        "wanted a whole file: remove it to begin again"
                    ) from None
                yield (node, first, count), Block(columns, told)

    def _described(self, text: Any) -> dict[str, Any]:
        try:
            found: dict[str, Any] = json.loads(text)
        except (TypeError, ValueError):
            raise DataError(f"{self.path}: damaged, wanted the file of a running sweep") from None
        return found

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """A connection for one transaction."""
        try:
            with closing(sqlite3.connect(self.path, timeout=60)) as base, base:
                base.execute("PRAGMA synchronous=NORMAL")
                yield base
        except sqlite3.Error as error:
            raise DataError(
                f"{self.path}: {error}; wanted a file of a running sweep that can be read and "
                "written"
            ) from None


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Hold `path` as this process's own; it falls free with the process, however that ends.

    Raises
    ------
    DataError
        Another process has it, or it cannot be made.
    """
    name = path.resolve()
    if name in _HELD:
        raise DataError(f"{path}: this process is running this sweep; wanted one at a time")
    try:
        held = path.open("ab")
    except OSError as error:
        raise DataError(
            f"{path}: {error.strerror}; wanted a folder that can be written to"
        ) from None
    with held:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(held.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                # Not flock: workers that are forked meanwhile would share it and might outlive us.
                fcntl.lockf(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            raise DataError(
                f"{path}: another process is running this sweep; wanted one at a time"
            ) from None
        _HELD.add(name)
        try:
            yield
        finally:
            _HELD.discard(name)


def check_same(path: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Refuse to go on with the file of another sweep."""
    for key, value in json.loads(json.dumps(wanted)).items():
        if key == "code" and key in found and found[key] != value:
            raise DataError(
                f"{path}: holds another sweep: the code of {wanted['study']} was another; wanted "
                "the same function to go on with, or another file"
            )
        if found.get(key) != value:
            raise DataError(
                f"{path}: holds another sweep: {key} is {found.get(key)!r} there, {value!r} here; "
                "wanted the same sweep to go on with, or another file"
            )
