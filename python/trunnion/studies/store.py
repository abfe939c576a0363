"""Where the blocks of a sweep go: arrays in memory, and a file that survives an interruption.

While a sweep runs, its blocks are rows of an SQLite database beside the result (``.part``): each
is there wholly or not at all, whatever stops the process, and the file may be read meanwhile. The
end is one netCDF file.
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from trunnion.base.errors import DataError, InputError
from trunnion.base.units import Floats
from trunnion.studies.description import Description
from trunnion.studies.study import Block

Place = tuple[int, int, int]
"""Node, first sample, number of samples."""
FILLED_AT_ONCE = 1 << 22
"""Numbers of which memory is made at once: gigabytes take seconds."""
COMMIT_EVERY_S = 0.25
"""Blocks that come within this time are written to the disk together."""


class Blocks:
    """All outputs in memory, (nodes, samples, columns), and the samples that failed."""

    def __init__(self, nodes: int, samples: int, columns: int) -> None:
        self.columns: Floats = np.empty((nodes, samples, columns))
        flat = self.columns.reshape(-1)
        for first in range(0, len(flat), FILLED_AT_ONCE):  # Ctrl-C is answered between them
            flat[first : first + FILLED_AT_ONCE] = np.nan
        self.done = np.zeros((nodes, samples), dtype=bool)
        self.failures: dict[tuple[int, int], str] = {}

    def put(self, place: Place, block: Block) -> None:
        """Take a block.

        Raises InputError: a place that is not there, or another number of outputs.
        """
        node, first, count = place
        nodes, samples, width = self.columns.shape
        if not (0 <= node < nodes and 0 <= first < first + count <= samples):
            raise InputError(
                f"block: got node {node}, samples {first} to {first + count}, expected them within "
                f"{nodes} nodes of {samples} samples"
            )
        if not all(0 <= index < count for index, _ in block.failures):
            raise InputError(f"block: got failures beyond its {count} samples")
        if block.columns.shape == (count, width):
            self.columns[node, first : first + count] = block.columns
        elif len(block.failures) < count:
            # A block in which every sample failed cannot know how many outputs there are.
            raise InputError(
                f"study: got outputs of shape {block.columns.shape}, expected "
                f"{(count, width)}: the same names at every node"
            )
        self.done[node, first : first + count] = True
        for index, why in block.failures:
            self.failures[node, first + index] = why


class Journal:
    """Blocks on disk, each wholly there or not at all."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def start(self, description: Description) -> None:
        """Create it, or check that it belongs to the same sweep.

        Raises DataError: the file holds another sweep, or none.
        """
        with self._open() as base:
            base.execute("CREATE TABLE IF NOT EXISTS sweep (described TEXT)")
            base.execute(
                "CREATE TABLE IF NOT EXISTS block (node INTEGER, first INTEGER, count INTEGER, "
                "columns BLOB, width INTEGER, failures TEXT, PRIMARY KEY (node, first))"
            )
            found = base.execute("SELECT described FROM sweep").fetchone()
            if found is None:
                base.execute("INSERT INTO sweep VALUES (?)", (description.text(),))
            else:
                description.check_same(self.path, Description.read(self.path, found[0]))

    def description(self) -> Description:
        """What the sweep is."""
        with self._open() as base:
            found = base.execute("SELECT described FROM sweep").fetchone()
        if found is None:
            raise DataError(f"{self.path}: got no sweep, expected one that has begun")
        return Description.read(self.path, found[0])

    @contextmanager
    def writing(self) -> Iterator[Callable[[Place, Block], None]]:
        """What adds a block; one that is there already stays.

        Blocks are on the disk `COMMIT_EVERY_S` later at most, all of them at the end, even one
        that an exception makes.
        """
        with self._open() as base:
            last = time.monotonic()

            def write(place: Place, block: Block) -> None:
                nonlocal last
                columns = np.ascontiguousarray(block.columns, dtype="<f8")
                row = (*place, columns.tobytes(), columns.shape[1], json.dumps(block.failures))
                base.execute("INSERT OR IGNORE INTO block VALUES (?, ?, ?, ?, ?, ?)", row)
                if time.monotonic() - last > COMMIT_EVERY_S:
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
                    place = (_index(node), _index(first), _index(count))
                    columns = np.frombuffer(data, dtype="<f8").reshape(count, _index(width))
                    failed = tuple((_index(index), str(why)) for index, why in json.loads(failures))
                except (TypeError, ValueError, RecursionError):
                    raise self._damaged(node, first) from None
                yield place, Block(columns, failed)

    def restore(self, blocks: Blocks) -> None:
        """Put all blocks so far into `blocks`.

        Raises DataError: a block that is damaged, or none of this sweep.
        """
        for place, block in self.read():
            try:
                blocks.put(place, block)
            except InputError:
                raise self._damaged(*place[:2]) from None

    def _damaged(self, node: object, first: object) -> DataError:
        return DataError(
            f"{self.path}: the block of node {node} from sample {first} is damaged; expected a "
            "whole file: remove it to begin again"
        )

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """A connection for one transaction."""
        try:
            with closing(sqlite3.connect(self.path, timeout=60)) as base, base:
                base.execute("PRAGMA synchronous=NORMAL")
                yield base
        except sqlite3.Error as error:
            raise DataError(
                f"{self.path}: {error}; expected a file of a running sweep that can be read and "
                "written"
            ) from None


def _index(value: object) -> int:
    """A count or index of a row; the database holds whatever was put into it."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(value)
    return value


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Hold the lock file `path`; it falls free with the process, however that ends.

    Raises DataError: another process has it, or it cannot be made.
    """
    from filelock import FileLock, Timeout  # part of the extra "sweep", as xarray is

    lock = FileLock(path, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise DataError(
            f"{path}: another process is running this sweep, or another thread of this one; "
            "expected one at a time"
        ) from None
    except OSError as error:
        raise DataError(
            f"{path}: {error.strerror}; expected a folder that can be written to"
        ) from None
    try:
        yield
    finally:
        lock.release()
