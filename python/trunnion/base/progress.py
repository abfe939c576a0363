"""Progress of what takes long: a bar with the remaining time on the error stream, or in a notebook.

Nothing is shown where nobody can see it (no terminal, no notebook), and nothing of what is quick.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from importlib.util import find_spec
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.console import Console

T = TypeVar("T")

QUIET_S = 2.0
"""What takes less than this shows no bar unless it is asked for."""
_SHOW: ContextVar[bool] = ContextVar("show", default=False)


@contextmanager
def shown_progress() -> Iterator[None]:
    """Show progress of what runs inside and takes longer than `QUIET_S`."""
    reset = _SHOW.set(True)
    try:
        yield
    finally:
        _SHOW.reset(reset)


def tracked(items: Iterable[T], name: str, total: int) -> Iterator[T]:
    """Give the items, with a bar where progress is shown (`shown_progress`)."""
    with progress_bar(name, total, show=None if _SHOW.get() else False) as advance:
        for item in items:
            yield item
            advance(1)


@contextmanager
def progress_bar(
    name: str, total: int, done: int = 0, show: bool | None = None
) -> Iterator[Callable[[int], None]]:
    """Give a function that counts further parts of the work, and show them with the remaining time.

    name: What the bar says.
    total, done: Parts of the whole work, and those that were there before.
    show: True: at once; False: never; None: once `QUIET_S` has passed.
    """
    console = None if show is False else _console()
    if console is None:
        yield lambda _: None
        return
    from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=console, transient=show is None)
    task = bar.add_task(name, total=total, completed=done)
    begun = time.monotonic()
    with ExitStack() as stack:
        if show:
            stack.enter_context(bar)

        def advance(count: int) -> None:
            bar.advance(task, count)
            if not bar.live.is_started and time.monotonic() - begun > QUIET_S:
                stack.enter_context(bar)

        yield advance


def _console() -> Console | None:
    """Return a terminal, or a notebook that can redraw a line; None: nobody would see it."""
    from rich.console import Console

    console = Console(stderr=True)
    seen = console.is_terminal or (console.is_jupyter and find_spec("ipywidgets") is not None)
    return console if seen else None
