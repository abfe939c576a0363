"""The progress bar of a sweep, in a terminal or in a notebook."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

QUIET_S = 0.5
"""A sweep that takes less than this shows no bar unless it is asked for."""


@contextmanager
def progress_bar(
    name: str, total: int, done: int, show: bool | None
) -> Iterator[Callable[[int], None]]:
    """Give a function that counts further samples, and show them with the remaining time.

    name: What the bar says.
    total, done: Samples of the whole sweep, and those that were there before.
    show: True: at once; False: never; None: once half a second has passed.
    """
    console = Console(stderr=True)
    if show is False or not _can_show(console):
        yield lambda _: None
        return
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=console)
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


def _can_show(console: Console) -> bool:
    """Whether there is a terminal, or a notebook that can redraw a line."""
    return console.is_terminal or (console.is_jupyter and find_spec("ipywidgets") is not None)
