"""Ctrl-C at moments in which Python would lose it, or leave things half done."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

IMPORTS = "<frozen importlib._bootstrap>"
RETRY_S = 0.02
"""An interrupt in the middle of an import is looked at again after this time."""


class _Interrupted:
    """Ctrl-C that came at a bad moment; as the first finder of modules it answers between two.

    What is raised in a callback of Python's imports is lost, and modules in C turn it into an
    error of their own. A module's search is no such moment.
    """

    def __init__(self) -> None:
        self.came = self.is_due = False

    def note(self, _signal: int, _frame: FrameType | None) -> None:
        self.came = self.is_due = True

    def find_spec(self, *_: Any) -> None:
        if self.is_due and threading.current_thread() is threading.main_thread():
            self.is_due = False  # once: a traceback imports modules, too
            raise KeyboardInterrupt


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Answer Ctrl-C between two imports or when the block is left.

    Where a program has its own answer to Ctrl-C, and in other threads, nothing is done.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    interrupted = _Interrupted()
    signal.signal(signal.SIGINT, interrupted.note)
    sys.meta_path.insert(0, interrupted)
    try:
        yield
    finally:
        sys.meta_path.remove(interrupted)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if interrupted.came and not isinstance(sys.exc_info()[1], KeyboardInterrupt):
            raise KeyboardInterrupt from None


def answer_interrupts_between_imports() -> None:
    """Let Ctrl-C raise `KeyboardInterrupt` in this process, but not in the middle of an import."""
    interrupted = _Interrupted()

    def answer(_signal: int, frame: FrameType | None) -> None:
        while frame is not None:
            if frame.f_code.co_filename == IMPORTS:
                interrupted.is_due = True
                again = threading.Timer(RETRY_S, retry)
                again.daemon = True
                again.start()
                return
            frame = frame.f_back
        interrupted.is_due = False
        raise KeyboardInterrupt

    def retry() -> None:
        if interrupted.is_due:
            signal.raise_signal(signal.SIGINT)

    signal.signal(signal.SIGINT, answer)
    sys.meta_path.insert(0, interrupted)
