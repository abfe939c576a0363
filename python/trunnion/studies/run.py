"""Running a sweep: blocks out, blocks in, in any order, on whatever executes them."""

from __future__ import annotations

import json
import os
import queue
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import chain, islice
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

import trunnion._core as _core
from trunnion.base.errors import DataError, InputError, TrunnionError, UnknownNameError
from trunnion.studies.grid import Grid
from trunnion.studies.store import Blocks, Journal, Place, alone, check_same
from trunnion.studies.study import Block, FunctionStudy, Output, Seeds, Study, Value, study_of

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["open_sweep", "sweep"]

QUIET_S = 0.5
"""A sweep that is done by then shows no bar."""
TRIES = 3
"""How often a block is sent out whose worker died."""
AHEAD = 64
"""Blocks that wait at an executor at a time."""
MOST_TRIALS = 64
"""Nodes that are asked for the outputs before none is taken to work."""
FAILURE = ("failure_sample", "failure_parameters", "failure_error")
"""What tells of failed samples."""


class Submits(Protocol):
    """A `concurrent.futures`-style executor: futures with `add_done_callback` and `result`."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Run it somewhere."""
        ...


def sweep(
    study: str | Study | Callable[..., Any],
    grid: Mapping[str, Any] | None = None,
    samples: int = 1,
    seed: int = 0,
    executor: Submits | None = None,
    *,
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
        "calibration", "compensation", "diagnosis-power", a function ``f(rng, **parameters)`` that
        returns a number or a dict of numbers, or an object like :class:`trunnion.studies.Study`. A
        function is tried out once or more beforehand, to learn the names of its outputs.
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
        `ProcessPoolExecutor`; on a cluster dask's ``distributed.Client(...).get_executor()``
        (tested), ``mpi4py.futures.MPIPoolExecutor()`` under ``mpiexec -n 9 python -m
        mpi4py.futures``; for Ray an object whose ``submit(f, *a)`` returns
        ``ray.remote(f).remote(*a).future()``.
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
        Show a bar with the remaining time; None: when it takes longer than half a second.
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
    chosen = study_of(study, units)
    samples = _whole("samples", samples, 1)
    seed = _whole("seed", seed, 0)
    if threads is not None:
        threads = _whole("threads", threads, 1, _core.MAX_THREADS)
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise InputError(f"executor: got {executor!r}, wanted an object with submit")
    limit = _Limit(most_failures)
    target = None if path is None else _target(path)
    nodes = Grid.checked(chosen, grid, fixed, samples)
    size = _whole("chunk", chunk if chunk is not None else chosen.chunk, 1)
    outputs = _outputs(chosen, nodes)
    width = sum(output.width for output in outputs)
    nodes.check_size(samples, width)
    if isinstance(chosen, FunctionStudy):
        chosen = replace(chosen, names=tuple(output.name for output in outputs))
    described = _described(chosen, nodes, samples, seed, outputs)
    if target is not None and target.exists():
        return _complete(target, described)
    blocks = Blocks(nodes.nodes, samples, width)
    run = _Run(chosen, nodes, seed, size, executor, threads, limit, progress)
    if target is None:
        run.fill(blocks, None)
        return _dataset(nodes, outputs, blocks, described)
    lock = target.with_name(target.name + ".lock")
    with alone(lock):
        if target.exists():  # another process has just ended it
            return _complete(target, described)
        journal = Journal(target.with_name(target.name + ".part"))
        journal.start(described)
        for place, block in journal.read():
            blocks.put(place, block)
        with journal.writing() as write:
            run.fill(blocks, write)
        result = _dataset(nodes, outputs, blocks, described)
        _write(result, target)
        journal.path.unlink()
        lock.unlink(missing_ok=True)
    return result


@dataclass(frozen=True)
class _Run:
    """What is to be run, and on what."""

    study: Study
    nodes: Grid
    seed: int
    chunk: int
    executor: Submits | None
    threads: int | None
    limit: _Limit
    progress: bool | None

    def fill(self, blocks: Blocks, write: Callable[[Place, Block], None] | None) -> None:
        """Run what is not done yet."""
        begun, total = int(blocks.done.sum()), blocks.done.size
        places = (
            (node, first, count)
            for node in range(self.nodes.nodes)
            for first, count in _missing(blocks.done[node].copy(), self.chunk)
        )
        with _bar(self.study.name, total, begun, self.progress) as advance:
            for place, block in self.results(places):
                blocks.put(place, block)
                if write is not None:
                    write(place, block)
                advance(place[2])
                self.limit.check(blocks)

    def results(self, places: Iterator[Place]) -> Iterator[tuple[Place, Block]]:
        """Blocks as they come."""
        begin = tuple(islice(places, 2))
        places = chain(begin, places)
        if self.executor is not None:
            yield from self.sent(places, self.executor)
        elif len(begin) > 1 and getattr(self.study, "processes", False):
            # Not forked: the core's threads would not survive it.
            with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
                yield from self.sent(places, pool)
        else:
            for place in places:
                yield place, _work(*self.task(place), place, self.threads)

    def task(self, place: Place) -> tuple[Study, dict[str, Any], Seeds]:
        """What a block is made from."""
        return self.study, self.nodes.at(place[0]), Seeds(self.seed, place[0])

    def sent(self, places: Iterator[Place], executor: Submits) -> Iterator[tuple[Place, Block]]:
        """Blocks from an executor as they come; one whose worker died is sent again."""
        again: deque[tuple[Place, int]] = deque()
        ready: queue.Queue[Any] = queue.Queue()
        out: dict[Any, tuple[Place, int]] = {}
        try:
            while True:
                while len(out) < AHEAD:
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
                    if tries >= TRIES:
                        raise _broken(error) from error
                    again.append((place, tries + 1))
                else:
                    yield place, block
        finally:
            for future in out:
                future.cancel()


def open_sweep(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a sweep from its file, finished or still running; samples not done yet are missing.

    Raises
    ------
    DataError
        There is neither `path` nor `path.part`, or it is none of a sweep.
    """
    xarray = import_xarray()
    target = _target(path)
    if target.exists():
        try:
            found: xr.Dataset = xarray.load_dataset(target, engine="scipy")
        except (TypeError, ValueError, OSError, IndexError, KeyError, EOFError) as error:
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise DataError(f"{target}: {why}; wanted the file (netCDF) of a sweep") from None
        return found
    journal = Journal(target.with_name(target.name + ".part"))
    if not journal.path.exists():
        raise DataError(f"{target}: no such sweep, finished or running")
    described = journal.described()
    outputs = tuple(_output(entry) for entry in described["outputs"])
    axes = {name: tuple(values) for name, values in described["grid"].items()}
    nodes = Grid(axes, described["fixed"])
    blocks = Blocks(nodes.nodes, described["samples"], sum(output.width for output in outputs))
    for place, block in journal.read():
        blocks.put(place, block)
    return _dataset(nodes, outputs, blocks, described)


def import_xarray() -> ModuleType:
    """xarray, which holds the results.

    Raises
    ------
    ImportError
        It is not installed.
    """
    try:
        return import_module("xarray")
    except ImportError as error:
        raise ImportError('sweeps need xarray; pip install "trunnion[sweep]"') from error


def _whole(what: str, value: Any, low: int, high: float = np.inf) -> int:
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not low <= value <= high:
        to = "" if high == np.inf else f" to {high:g}"
        raise InputError(f"{what}: got {value!r}, wanted a whole number from {low}{to}")
    return int(value)


def _target(path: Any) -> Path:
    """Where the result goes; a file that may be, in a folder that is there."""
    try:
        target = Path(path)
    except TypeError:
        raise InputError(f"path: got {path!r}, wanted the path of a file") from None
    if target.is_dir():
        raise InputError(f"path: got {target}, a folder, wanted a file")
    if not target.parent.is_dir():
        raise InputError(f"path: got {target}, wanted a file in a folder that is there")
    return target


def _outputs(study: Study, nodes: Grid) -> tuple[Output, ...]:
    """Outputs from the first node that works; names that the result can hold."""
    first: TrunnionError | None = None
    for node in range(min(nodes.nodes, MOST_TRIALS)):
        try:
            outputs = study.outputs(nodes.at(node))
            break
        except TrunnionError as error:
            first = first or error
    else:
        raise first or InputError(f"study {study.name}: no outputs")
    if not outputs:
        raise InputError(f"study {study.name}: got no outputs, wanted at least one")
    taken = {*nodes.axes, *FAILURE, "sample", "failure"}
    taken |= {output.dim for output in outputs} | {f"{output.dim}_unit" for output in outputs}
    for output in outputs:
        if output.name in taken:
            raise InputError(
                f"study {study.name}: got an output named {output.name!r} as a parameter or a "
                "dimension is, wanted another name"
            )
        taken.add(output.name)
        if output.dim in nodes.axes:
            raise InputError(f"axis {output.dim}: the name is taken, wanted another")
    if isinstance(study, FunctionStudy):
        for name in study.units:
            if name not in taken:
                names = ", ".join(output.name for output in outputs)
                raise UnknownNameError(f"units: got {name!r}, wanted some of {names}")
    return outputs


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


class _Limit:
    """Ends a sweep in which too many samples fail."""

    def __init__(self, share: float) -> None:
        number = isinstance(share, float | int | np.number) and not isinstance(share, bool)
        if not (number and 0 <= share <= 1):
            raise InputError(f"most_failures: got {share!r}, wanted a share from 0 to 1")
        self.share = share

    def check(self, blocks: Blocks) -> None:
        failed = len(blocks.failures)
        if failed > 20 and failed > self.share * blocks.done.sum():
            (node, sample), why = next(iter(blocks.failures.items()))
            raise DataError(
                f"sweep: {failed} of {int(blocks.done.sum())} samples failed, wanted at most "
                f"{self.share:.0%}; the first, node {node} sample {sample}: {why}"
            )


@contextmanager
def _bar(name: str, total: int, done: int, wanted: bool | None) -> Iterator[Callable[[int], None]]:
    """A bar with the remaining time, in a terminal or a notebook, once it is worth one."""
    begun = time.monotonic()
    so_far = done
    show: Callable[[int], None] | None = None
    with ExitStack() as stack:

        def advance(count: int) -> None:
            nonlocal so_far, show
            so_far += count
            if show is None and (wanted or time.monotonic() - begun > QUIET_S):
                notebook = "ipykernel" in sys.modules
                show = (_in_notebook if notebook else _in_terminal)(name, total, done, stack)
            if show is not None:
                show(so_far)

        yield (lambda _count: None) if wanted is False else advance


def _in_terminal(name: str, total: int, done: int, stack: ExitStack) -> Callable[[int], None]:
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=console, disable=not console.is_terminal)
    stack.enter_context(bar)
    task = bar.add_task(name, total=total, completed=done)
    return lambda so_far: bar.update(task, completed=so_far)


def _in_notebook(name: str, total: int, done: int, stack: ExitStack) -> Callable[[int], None]:  # noqa: ARG001
    from IPython import display as notebook

    shown: Any = notebook
    begun = time.monotonic()

    def html(so_far: int) -> Any:
        rate = (so_far - done) / max(time.monotonic() - begun, 1e-3)
        left = f"{(total - so_far) / rate:.0f} s left" if rate > 0 else ""
        bar = f"<progress value='{so_far}' max='{total}'></progress>"
        return shown.HTML(f"{name} {bar} {so_far} of {total} samples, {left}")

    handle = shown.display(html(done), display_id=True)
    return lambda so_far: handle.update(html(so_far))


def _described(
    study: Study, nodes: Grid, samples: int, seed: int, outputs: tuple[Output, ...]
) -> dict[str, Any]:
    """What makes a sweep this sweep, as JSON."""
    return {
        "study": study.name,
        "grid": {name: list(values) for name, values in nodes.axes.items()},
        "grid_units": {
            name: study.parameters[name].unit for name in nodes.axes if name in study.parameters
        },
        "fixed": nodes.fixed,
        "samples": int(samples),
        "seed": int(seed),
        **({"code": study.code()} if isinstance(study, FunctionStudy) else {}),
        "outputs": [
            [output.name, output.unit, output.dim, list(output.labels), output.words]
            for output in outputs
        ],
        "trunnion": _core.__version__,
    }


def _output(entry: list[Any]) -> Output:
    name, unit, dim, labels, words = entry
    return Output(name, unit if isinstance(unit, str) else tuple(unit), dim, tuple(labels), words)


def _write(result: xr.Dataset, target: Path) -> None:
    """The whole file or none, on the disk before what it was made from goes."""
    new = target.with_name(target.name + ".new")
    result.to_netcdf(new, engine="scipy")
    with new.open("rb+") as written:
        os.fsync(written.fileno())
    new.replace(target)


def _complete(target: Path, described: dict[str, Any]) -> xr.Dataset:
    found = open_sweep(target)
    text = found.attrs.get("described")
    if text is None:
        raise DataError(f"{target}: holds no sweep; wanted the file of one, or another file")
    check_same(target, json.loads(str(text)), described)
    return found


def _dataset(
    nodes: Grid, outputs: tuple[Output, ...], blocks: Blocks, described: dict[str, Any]
) -> xr.Dataset:
    """Arrays with names: grid axes, sample, and the outputs' own dimensions."""
    import xarray as xr

    samples = blocks.columns.shape[1]
    axes = tuple(nodes.axes)
    coordinates: dict[str, Any] = {
        name: (name, _storable(values), {"units": described["grid_units"].get(name, "")})
        for name, values in nodes.axes.items()
    }
    variables: dict[str, Any] = {}
    column = 0
    for output in outputs:
        dims: tuple[str, ...] = (*axes, "sample")
        shape = (*nodes.shape, samples)
        taken = blocks.columns[:, :, column : column + output.width]
        column += output.width
        attributes = {"long_name": output.words} if output.words else {}
        if output.dim:
            dims, shape = (*dims, output.dim), (*shape, output.width)
            coordinates[output.dim] = (output.dim, list(output.labels))
            if isinstance(output.unit, tuple):
                coordinates[f"{output.dim}_unit"] = (output.dim, list(output.unit))
        if isinstance(output.unit, str):
            attributes["units"] = output.unit
        variables[output.name] = (dims, taken.reshape(shape), attributes)
    told = sorted(blocks.failures.items())
    if told:
        places = [nodes.at(node) for (node, _), _ in told]
        variables["failure_sample"] = ("failure", [sample for (_, sample), _ in told])
        variables["failure_parameters"] = (
            "failure",
            [json.dumps({name: place[name] for name in axes}) for place in places],
        )
        variables["failure_error"] = ("failure", [why for _, why in told])
    described_by: dict[str, Any] = {
        **{name: _attribute(value) for name, value in described["fixed"].items()},
        "study": described["study"],
        "seed": _attribute(described["seed"]),
        "samples_done": int(blocks.done.sum()),
        "samples_failed": len(told),
        "trunnion": described["trunnion"],
        "described": json.dumps(described, sort_keys=True),
    }
    return xr.Dataset(variables, coordinates, described_by)


def _attribute(value: Value) -> Value:
    """The classic netCDF format has no truth values, and no whole numbers beyond 32 bits."""
    if isinstance(value, bool):
        return int(value)
    return str(value) if isinstance(value, int) and abs(value) >= 2**31 else value


def _storable(values: tuple[Value, ...]) -> list[Value]:
    whole = all(type(value) is int for value in values)
    if whole and any(abs(int(value)) >= 2**31 for value in values):
        return [float(value) for value in values]
    return list(values)
