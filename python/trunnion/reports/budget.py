"""The uncertainty budget of a result, where it has one."""

from __future__ import annotations

from typing import Any

from trunnion.base.errors import InputError
from trunnion.machine.budget import Measurand
from trunnion.plot.dispatch import pictures
from trunnion.reports.document import Item, Section

OF_ONE = "Budget of "
MAX_TABLES = 4
"""Of single quantities; the picture has all."""
NEARLY_ALL = 0.995  # of the variance: what is due to one source needs no table of its own


def budget_section(result: Any) -> Section:
    """Return the uncertainty budget of a result; empty where it has none."""
    items: list[Item] = []
    if callable(budget := getattr(result, "budget", None)):
        try:
            found = budget()
        except InputError as error:
            items = [str(error)]
        else:
            first = [t for t in found.tables() if not t.title.startswith(OF_ONE)]
            mixed = {f"{OF_ONE}{m.name}" for m in found.measurands if _mixed(m)}
            several = [t for t in found.tables() if t.title in mixed]
            shown = pictures(found) if several else ()
            items = [*found.sentences(), *shown, *first, *several[:MAX_TABLES]]
            if len(several) > MAX_TABLES:
                items.append(f"The picture has the {len(several) - MAX_TABLES} others.")
    return Section("Uncertainty budget", tuple(items))


def _mixed(m: Measurand) -> bool:
    """Whether more than one source makes the uncertainty of a quantity."""
    squares = [line.contribution**2 for line in m.lines]
    return max(squares, default=0.0) < NEARLY_ALL * sum(squares)
