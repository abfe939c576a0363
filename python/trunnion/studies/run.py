"""Running a sweep: blocks out, blocks in, in any order, on whatever executes them."""

from __future__ import annotations

import logging
import os
import queue
import shutil
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from trunnion._core import MAX_THREADS
from trunnion.base.arguments import checked
from trunnion.base.checks import choose, entry, whole, within
from trunnion.base.errors import DataError, InputError, TrunnionError
from trunnion.base.progress import progress_bar
from trunnion.base.workers import processes
from trunnion.setup import Setup
from trunnion.studies.dataset import dataset, import_xarray, journal_of, read_same, target_of, write
from trunnion.studies.description import Description, check_names
from trunnion.studies.grid import Grid
from trunnion.studies.store import Blocks, Place, exclusive
from trunnion.studies.study import Block, FunctionStudy, Output, Seeds, Study, study_of

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr

LOG = logging.getLogger("trunnion.studies")

MAX_TRIES = 3
"""How often a block is sent out whose worker died."""
MAX_WAITING = 64
"""Blocks that wait at an executor at a time."""
MAX_TRIALS = 64
"""Nodes that are asked for the outputs before none is taken to work."""
MIN_FAILURES = 20
"""So many failed samples do not end a sweep, whatever their share."""


class Submits(Protocol):
    """A `concurrent.futures`-style executor: futures with `add_done_callback` and `result`."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Run it somewhere."""
        ...


@checked
def sweep(
    study: str | Study | Callable[..., Any],
    grid: Mapping[str, Any] | None = None,
    samples: int = 1,
    seed: int = 0,
    executor: Submits | None = None,
    *,
    setup: Setup | None = None,
    fixed: Mapping[str, Any] | None = None,
    path: str | os.PathLike[str] | None = None,
    chunk: int | None = None,
    threads: int | None = None,
    units: Mapping[str, str] | None = None,
    progress: bool | None = None,
    most_failures: float = 0.5,
) -> xr.Dataset:
    """Run a study over a full factorial grid, with random draws at every node.

    Sample i of node k draws its random numbers from `seed`, k and i alone: results are the same bit
    for bit whatever the chunks, the order, the executor and the number of threads.

    Parameters
    ----------
    study
        "calibration", "compensation", "identification", "diagnosis-power", a function ``f(rng,
        **parameters)`` that returns a number or a dict of numbers, or an object like
        :class:`trunnion.studies.Study`. A function is tried out once or more beforehand, to learn
        the names of its outputs.
    grid
        Parameter → values, one dimension of the result each. Parameters of the built-in studies:
        ``trunnion sweep --parameters NAME``.
    samples
        Random draws at each node.
    seed
        Of all random numbers, from 0.
    executor
        None: this process (the core uses all its cores; "diagnosis-power" starts worker processes).
        Else anything with ``submit`` in the style of `concurrent.futures`: a
        `ProcessPoolExecutor`; on a cluster dask's ``distributed.Client(...).get_executor()``,
        ``mpi4py.futures.MPIPoolExecutor()`` under ``mpiexec -n 9 python -m
        mpi4py.futures``; for Ray :class:`trunnion.studies.RayExecutor`.
    setup
        What "identification" and "diagnosis-power" begin with: any key of it can be in the grid
        (``artefact.length_mm``, ``machine.preset``, ``axes.C.sense``); by default a cross on
        ``trt-ca``.
    fixed
        Parameters that stay the same.
    path
        File of the result (netCDF). While it runs, blocks are kept beside it in ``path.part``; the
        same call goes on where it stopped, and reads the result once it is complete. Without it an
        interrupted sweep is lost.
    chunk
        Samples in a block; the study's own unless given.
    threads
        Threads of the core in this process; None: all cores. On an executor each block has one.
    units
        Units of the outputs of a function.
    progress
        Show a bar with the remaining time; None: when it takes longer than two seconds.
    most_failures
        A sample that fails is recorded with its parameters and error; when more than this share of
        those done (and more than 20) have failed, the sweep ends with an error.

    Returns
    -------
    xarray.Dataset
        Dimensions: those of the grid, ``sample``, and the outputs' own. Failed samples are missing
        (not a number) and listed along ``failure``. Units, seed and everything that stays the same
        are in the attributes.

    Raises
    ------
    InputError, UnknownNameError
        A grid that cannot be, at once.
    DataError
        `path` holds another sweep, is damaged, or is being filled by another process; too many
        samples failed; an executor broke.

    Examples
    --------
    >>> import trunnion as tn
    >>> found = tn.sweep(lambda rng, s: rng.normal(0, s), grid={"s": [1.0, 2.0]}, samples=3, seed=1)
    >>> dict(found.sizes)
    {'s': 2, 'sample': 3}
    """
    import_xarray()
    with entry("study"):
        chosen = study_of(study, units, setup)
    with entry("samples"):
        samples = whole("samples", samples, 1)
    with entry("seed"):
        seed = whole("seed", seed, 0)
    if threads is not None:
        threads = whole("threads", threads, 1, MAX_THREADS)
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise InputError(f"executor: got {executor!r}, expected an object with submit")
    limit = _Limit(most_failures)
    target = None if path is None else target_of(path)
    nodes = Grid.checked(chosen, grid, fixed, samples)
    size = whole("chunk", chosen.chunk if chunk is None else chunk, 1)
    with entry("fixed"):
        outputs = _outputs(chosen, nodes)
    nodes.check_size(samples, sum(output.width for output in outputs))
    if hasattr(chosen, "of_outputs"):
        chosen = chosen.of_outputs(outputs)
    description = Description.of(chosen, nodes, samples, seed, outputs)
    run = _Run(chosen, description, size, executor, threads, limit, progress)
    return run.in_memory() if target is None else run.into(target)


@dataclass(frozen=True)
class _Run:
    """What is to be run, and on what."""

    study: Study
    description: Description
    chunk: int
    executor: Submits | None
    threads: int | None
    limit: _Limit
    progress: bool | None

    def in_memory(self) -> xr.Dataset:
        """Run all of it."""
        blocks = self.blocks()
        self.fill(blocks, lambda _place, _block: None)
        return dataset(self.description, blocks)

    def into(self, target: Path) -> xr.Dataset:
        """Run what the files of the sweep do not have yet, and complete them."""
        if target.exists():
            return read_same(target, self.description)
        lock = target.with_name(target.name + ".lock")
        with exclusive(lock):
            if target.exists():  # another process has just ended it
                return read_same(target, self.description)
            self.announce(target)
            journal = journal_of(target)
            journal.start(self.description)
            blocks = self.blocks()
            journal.restore(blocks)
            with journal.writing() as keep:
                self.fill(blocks, keep)
            result = dataset(self.description, blocks)
            write(result, target)
            journal.path.unlink()
            lock.unlink(missing_ok=True)
        return result

    def announce(self, target: Path) -> None:
        """Say how large the file will be, before anything of it is written.

        Raises InputError: the disk has no room for it.
        """
        described = self.description
        nodes, size = described.grid.nodes, described.bytes
        free = shutil.disk_usage(target.parent).free
        LOG.info(
            "%s: %d nodes of %d samples, %d numbers each: %s, and as much in %s.part while it runs "
            "(%s are free)",
            target,
            nodes,
            described.samples,
            described.width,
            shown_bytes(size),
            target.name,
            shown_bytes(free),
        )
        if 2 * size > free:
            raise InputError(
                f"path: got {target} for a result of {shown_bytes(size)}, expected room for twice "
                f"as much while it runs ({shown_bytes(free)} are free)"
            )

    def blocks(self) -> Blocks:
        """Room for all outputs."""
        described = self.description
        return Blocks(described.grid.nodes, described.samples, described.width)

    def fill(self, blocks: Blocks, keep: Callable[[Place, Block], None]) -> None:
        """Run what is not done yet."""
        begun, total = int(blocks.done.sum()), blocks.done.size
        places = (
            (node, first, count)
            for node in range(len(blocks.done))
            for first, count in _missing(blocks.done[node].copy(), self.chunk)
        )
        with progress_bar(self.study.name, total, begun, self.progress) as advance:
            for place, block in self.results(places):
                blocks.put(place, block)
                keep(place, block)
                advance(place[2])
                self.limit.check(blocks)

    def results(self, places: Iterator[Place]) -> Iterator[tuple[Place, Block]]:
        """Blocks as they come."""
        begin = tuple(islice(places, 2))
        places = chain(begin, places)
        if self.executor is not None:
            yield from self.sent(places, self.executor)
        elif len(begin) > 1 and getattr(self.study, "processes", False):
            with processes() as pool:
                yield from self.sent(places, pool)
        else:
            for place in places:
                yield place, _work(*self.task(place), place, self.threads)

    def task(self, place: Place) -> tuple[Study, dict[str, Any], Seeds]:
        """What a block is made from."""
        values = self.description.grid.at(place[0])
        return self.study, values, Seeds(self.description.seed, place[0])

    def sent(self, places: Iterator[Place], executor: Submits) -> Iterator[tuple[Place, Block]]:
        """Blocks from an executor as they come; one whose worker died is sent again."""
        again: deque[tuple[Place, int]] = deque()
        ready: queue.Queue[Any] = queue.Queue()
        out: dict[Any, tuple[Place, int]] = {}
        try:
            while True:
                while len(out) < MAX_WAITING:
                    place, tries = again.popleft() if again else (next(places, None), 1)
                    if place is None:
                        break
                    try:
                        future = executor.submit(_work, *self.task(place), place, 1)
                    except Exception as error:  # a pool that broke takes nothing more
                        raise _broken(error) from error
                    out[future] = (place, tries)
                    future.add_done_callback(ready.put)
                if not out:
                    return
                future = ready.get()
                place, tries = out.pop(future)
                try:
                    block = future.result()
                except Exception as error:
                    if tries >= MAX_TRIES:
                        raise _broken(error) from error
                    again.append((place, tries + 1))
                else:
                    yield place, block
        finally:
            for future in out:
                future.cancel()


def _outputs(study: Study, nodes: Grid) -> tuple[Output, ...]:
    """Outputs from the first node that works; names that the result can hold."""
    outputs = study.all_outputs(nodes) if hasattr(study, "all_outputs") else _first(study, nodes)
    check_names(study.name, outputs, nodes.axes)
    if isinstance(study, FunctionStudy):
        names = [output.name for output in outputs]
        for name in study.units:
            choose("units", name, names)
    return outputs


def _first(study: Study, nodes: Grid) -> tuple[Output, ...]:
    """Outputs of the first node that works."""
    first: TrunnionError | None = None
    for node in range(min(nodes.nodes, MAX_TRIALS)):
        try:
            return study.outputs(nodes.at(node))
        except TrunnionError as error:
            first = first or error
    raise first or InputError(f"study {study.name}: no outputs")


def _missing(done: np.ndarray[Any, np.dtype[np.bool_]], size: int) -> Iterator[tuple[int, int]]:
    """Stretches of samples that are not done, at most `size` long."""
    edges = np.flatnonzero(np.diff(np.concatenate(([True], done, [True])).astype(np.int8)))
    for begin, end in edges.reshape(-1, 2).tolist():
        for first in range(begin, end, size):
            yield first, min(size, end - first)


def _work(
    study: Study, values: dict[str, Any], seeds: Seeds, place: Place, threads: int | None
) -> Block:
    """One block, here or in another process; a node that cannot be fails with all its samples."""
    try:
        return study.run(values, seeds, place[1], place[2], threads)
    except TrunnionError as error:
        why = f"{type(error).__name__}: {error}"
        return Block(np.full((place[2], 1), np.nan), tuple((i, why) for i in range(place[2])))


def _broken(error: Exception) -> DataError:
    why = f"{type(error).__name__}: {error}"
    if isinstance(error, BrokenProcessPool):
        why += (
            " (worker processes import the script that starts them: what it does belongs under "
            'if __name__ == "__main__")'
        )
    return DataError(
        f"executor: {why}; what is done is kept in the file of the sweep, if it has one: the same "
        "call goes on from there"
    )


def shown_bytes(count: int) -> str:
    """Return "1.2 GB"."""
    size = float(count)
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} TB"


class _Limit:
    """Ends a sweep in which too many samples fail."""

    def __init__(self, share: float) -> None:
        self.share = within("most_failures", share, 0.0, 1.0)

    def check(self, blocks: Blocks) -> None:
        failed = len(blocks.failures)
        if failed > MIN_FAILURES and failed > self.share * blocks.done.sum():
            (node, sample), why = next(iter(blocks.failures.items()))
            raise DataError(
                f"sweep: {failed} of {int(blocks.done.sum())} samples failed, expected at most "
                f"{self.share:.0%}; the first, node {node} sample {sample}: {why}"
            )
