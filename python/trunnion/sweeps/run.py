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
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from trunnion._core import __version__
from trunnion.errors import DataError, InputError, TrunnionError
from trunnion.sweeps.grid import Grid
from trunnion.sweeps.store import Blocks, Journal, Place, check_same
from trunnion.sweeps.study import Block, Output, Seeds, Study, study_of

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["open_sweep", "sweep"]

QUIET_S = 0.5
"""A sweep that is done by then shows no bar."""
TRIES = 3
"""How often a block is sent out whose worker died."""
AHEAD = 64
"""Blocks that wait at an executor at a time."""


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
        returns a number or a dict of numbers, or an object like :class:`trunnion.sweeps.Study`.
    grid
        Parameter → values, one dimension of the result each.
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
        same call goes on where it stopped, and reads the result once it is complete.
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
        `path` holds another sweep; too many samples failed.

    Examples
    --------
    >>> import trunnion as tn
    >>> found = tn.sweep(lambda rng, s: rng.normal(0, s), grid={"s": [1.0, 2.0]}, samples=3, seed=1)
    >>> dict(found.sizes)
    {'s': 2, 'sample': 3}
    """
    chosen = study_of(study, units)
    _whole("samples", samples, 1)
    _whole("seed", seed, 0)
    nodes = Grid.checked(chosen, grid, fixed)
    nodes.check_size(samples, 1)
    outputs = chosen.outputs(nodes.at(0))
    width = sum(output.width for output in outputs)
    nodes.check_size(samples, width)
    size = _whole("chunk", chunk if chunk is not None else chosen.chunk, 1)
    described = _described(chosen, nodes, samples, seed, outputs)
    target = None if path is None else Path(path)
    if target is not None and target.exists():
        return _complete(target, described)
    blocks = Blocks(nodes.nodes, samples, width)
    journal = None
    if target is not None:
        journal = Journal(target.with_name(target.name + ".part"))
        journal.start(described)
        for place, block in journal.read():
            blocks.put(place, block)
    places = [
        place
        for node in range(nodes.nodes)
        for first, count in _missing(blocks.done[node], size)
        for place in [(node, first, count)]
    ]
    limit = _Limit(most_failures)
    with _bar(chosen.name, nodes.nodes * samples, int(blocks.done.sum()), progress) as advance:
        for place, block in _results(chosen, nodes, seed, places, executor, threads):
            if journal is not None:
                journal.write(place, block)
            blocks.put(place, block)
            advance(place[2])
            limit.check(blocks)
    result = _dataset(nodes, outputs, blocks, described)
    if target is not None and journal is not None:
        new = target.with_name(target.name + ".new")
        result.to_netcdf(new, engine="scipy")
        new.replace(target)
        journal.path.unlink()
    return result


def open_sweep(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a sweep from its file, finished or still running; samples not done yet are missing.

    Raises
    ------
    DataError
        There is neither `path` nor `path.part`.
    """
    import xarray as xr

    target = Path(path)
    if target.exists():
        return xr.load_dataset(target, engine="scipy")
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


def _whole(what: str, value: int, low: int) -> int:
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < low:
        raise InputError(f"{what}: got {value!r}, wanted a whole number from {low}")
    return int(value)


def _missing(done: np.ndarray[Any, np.dtype[np.bool_]], size: int) -> Iterator[tuple[int, int]]:
    """Stretches of samples that are not done, at most `size` long."""
    first = 0
    while first < len(done):
        if done[first]:
            first += 1
            continue
        stop = first
        while stop < len(done) and not done[stop] and stop - first < size:
            stop += 1
        yield first, stop - first
        first = stop


def _work(
    study: Study, values: dict[str, Any], seeds: Seeds, place: Place, threads: int | None
) -> Block:
    """One block, here or in another process; a node that cannot be fails with all its samples."""
    try:
        return study.run(values, seeds, place[1], place[2], threads)
    except TrunnionError as error:
        why = f"{type(error).__name__}: {error}"
        return Block(np.full((place[2], 1), np.nan), tuple((i, why) for i in range(place[2])))


def _results(
    study: Study,
    nodes: Grid,
    seed: int,
    places: list[Place],
    executor: Submits | None,
    threads: int | None,
) -> Iterator[tuple[Place, Block]]:
    if executor is not None:
        yield from _sent(study, nodes, seed, places, executor)
    elif getattr(study, "processes", False) and len(places) > 1:
        # Not forked: the core's threads would not survive it.
        with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
            yield from _sent(study, nodes, seed, places, pool)
    else:
        for place in places:
            yield place, _work(study, nodes.at(place[0]), Seeds(seed, place[0]), place, threads)


def _sent(
    study: Study, nodes: Grid, seed: int, places: list[Place], executor: Submits
) -> Iterator[tuple[Place, Block]]:
    """Blocks from an executor as they come; one whose worker died is sent again."""
    waiting = deque((place, 1) for place in places)
    ready: queue.Queue[Any] = queue.Queue()
    out: dict[Any, tuple[Place, int]] = {}
    try:
        while waiting or out:
            while waiting and len(out) < AHEAD:
                place, tries = waiting.popleft()
                seeds = Seeds(seed, place[0])
                try:
                    future = executor.submit(_work, study, nodes.at(place[0]), seeds, place, 1)
                except Exception as error:  # a pool that broke takes nothing more
                    raise _broken(error) from error
                out[future] = (place, tries)
                future.add_done_callback(ready.put)
            future = ready.get()
            place, tries = out.pop(future)
            try:
                block = future.result()
            except Exception as error:
                if tries >= TRIES:
                    raise _broken(error) from error
                waiting.append((place, tries + 1))
            else:
                yield place, block
    finally:
        for future in out:
            future.cancel()


def _broken(error: Exception) -> DataError:
    return DataError(
        f"executor: {type(error).__name__}: {error}; what is done is kept in the file of the "
        "sweep, if it has one: the same call goes on from there"
    )


class _Limit:
    """Ends a sweep in which too many samples fail."""

    def __init__(self, share: float) -> None:
        if not (np.isfinite(share) and 0 <= share <= 1):
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
        "outputs": [
            [output.name, output.unit, output.dim, list(output.labels), output.words]
            for output in outputs
        ],
        "trunnion": __version__,
    }


def _output(entry: list[Any]) -> Output:
    name, unit, dim, labels, words = entry
    return Output(name, unit if isinstance(unit, str) else tuple(unit), dim, tuple(labels), words)


def _complete(target: Path, described: dict[str, Any]) -> xr.Dataset:
    found = open_sweep(target)
    check_same(target, json.loads(str(found.attrs.get("described", "{}"))), described)
    return found


def _dataset(
    nodes: Grid, outputs: tuple[Output, ...], blocks: Blocks, described: dict[str, Any]
) -> xr.Dataset:
    """Arrays with names: grid axes, sample, and the outputs' own dimensions."""
    import xarray as xr

    samples = blocks.columns.shape[1]
    axes = tuple(nodes.axes)
    coordinates: dict[str, Any] = {
        name: (name, list(values), {"units": described["grid_units"].get(name, "")})
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
        "study": described["study"],
        # The classic netCDF format has no whole numbers beyond 32 bits.
        "seed": described["seed"] if described["seed"] < 2**31 else str(described["seed"]),
        "samples_done": int(blocks.done.sum()),
        "samples_failed": len(told),
        "trunnion": described["trunnion"],
        "described": json.dumps(described, sort_keys=True),
        **{
            name: int(value) if isinstance(value, bool) else value
            for name, value in described["fixed"].items()
        },
    }
    return xr.Dataset(variables, coordinates, described_by)
