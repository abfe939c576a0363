"""Work in several processes, stopped at once by Ctrl-C."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from trunnion.base.errors import InputError
from trunnion.base.interrupts import held_interrupts

CLEARING_S = 5.0
"""The thread of a pool that is broken off is waited for no longer than this."""

T = TypeVar("T")
R = TypeVar("R")


def map_processes(
    work: Callable[[T], R], items: Sequence[T], workers: int, done: Callable[[int], None]
) -> list[R]:
    """Return ``work(item)`` of every item, in order; one worker is this process itself.

    done: Called with 1 after each item.

    Raises
    ------
    InputError
        A process ended, or what it should work on cannot be sent to it. What `work` raises is
        raised here.
    """
    if min(workers, len(items)) <= 1:
        return [_counted(work(item), done) for item in items]
    # Packed here: what the pool cannot pack, its own thread would meet after the pool has ended.
    packed = [_packed(work, item) for item in items]
    with processes(min(workers, len(items))) as pool:
        try:
            futures: list[Future[R]] = [pool.submit(_unpacked, each) for each in packed]
            for future in as_completed(futures):
                _counted(future.result(), done)
        except BrokenProcessPool as error:
            raise InputError(
                "workers: a process ended before its work was done (out of memory? a script that "
                'starts processes needs `if __name__ == "__main__":` around its work); expected '
                "to go on with workers=1"
            ) from error
        return [future.result() for future in futures]


def _packed(work: Callable[[T], R], item: T) -> bytes:
    try:
        return pickle.dumps((work, item))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"workers: got data that cannot be sent to another process ({error}), expected "
            "effects of your own defined at the top of a module, or workers=1"
        ) from error


def _unpacked(packed: bytes) -> Any:
    work, item = pickle.loads(packed)  # written by `_packed` of this very program
    return work(item)


def _counted(result: R, done: Callable[[int], None]) -> R:
    done(1)
    return result


@contextmanager
def processes(workers: int | None = None) -> Iterator[ProcessPoolExecutor]:
    """Processes that are killed when the block is left by an error or by Ctrl-C."""
    before = set(multiprocessing.active_children())
    # Not forked: the core's threads would not survive it.
    context = multiprocessing.get_context("spawn")
    count = cores() if workers is None else workers
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin)
    try:
        # Broken off here, a process would run that nobody knows.
        with held_interrupts(), _born_deaf():
            for _ in range(count):
                pool.submit(int)  # starts a process
        yield pool
    except BaseException:
        own = set(multiprocessing.active_children()) - before
        for process in own:
            process.kill()
        for process in own:
            process.join()
        # The pool's thread would wait for the rest of a result that was being sent.
        pool._result_queue._writer.close()  # type: ignore[attr-defined]
        thread: Any = pool._executor_manager_thread
        pool.shutdown(wait=False, cancel_futures=True)
        # Ended in the middle of its clearing up, it would leave semaphores that are half given back
        # and a warning of Python's below the last line.
        if thread is not None:
            thread.join(CLEARING_S)
        raise
    pool.shutdown()


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _born_deaf() -> Iterator[None]:
    """Let processes that are started here never hear Ctrl-C: the one that waits ends them.

    Otherwise each would write a traceback, before `_begin`.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # it would undo the mask as it starts
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _begin() -> None:
    """Leave Ctrl-C to the process that waits, and the other cores to the other processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["RAYON_NUM_THREADS"] = "1"
