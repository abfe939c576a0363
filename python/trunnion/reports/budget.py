"""The uncertainty budget of a result, where it has one."""

from __future__ import annotations

from typing import Any

from trunnion.base.errors import InputError
from trunnion.plot.dispatch import pictures
from trunnion.reports.document import Item, Section

OF_ONE = "Budget of "
MAX_TABLES = 4
"""Of single quantities; the picture has all."""


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
            several = [t for t in found.tables() if t.title.startswith(OF_ONE) and len(t.rows) > 1]
            shown = pictures(found) if several else ()
            items = [*found.sentences(), *shown, *first, *several[:MAX_TABLES]]
            if len(several) > MAX_TABLES:
                items.append(f"{len(several) - MAX_TABLES} more are in the result's budget().")
    return Section("Uncertainty budget", tuple(items))
