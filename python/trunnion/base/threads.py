"""Limit the threads of numpy's linear algebra."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any

from threadpoolctl import ThreadpoolController

_LOCK = Lock()
_ACTIVE: list[Any] = []


@cache
def _controller() -> ThreadpoolController:
    """Find the libraries that are loaded, which takes milliseconds, once."""
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS calculate on one thread: small matrices are slower on more, and differ by rounding.

    The limit holds for the whole process until the last of all blocks that run at a time ends.
    """
    with _LOCK:
        if not _ACTIVE:
            _ACTIVE.append(_controller().limit(limits=1, user_api="blas"))
        _ACTIVE.append(None)
    try:
        yield
    finally:
        with _LOCK:
            _ACTIVE.pop()
            if len(_ACTIVE) == 1:
                _ACTIVE.pop().restore_original_limits()
