"""The uncertainty budget of a result, where it has one."""

from __future__ import annotations

from typing import Any

from trunnion.base.errors import InputError
from trunnion.reports.document import Item, Section


def budget_section(result: Any) -> Section:
    """Return the uncertainty budget of a result; empty where it has none."""
    items: list[Item] = []
    if callable(budget := getattr(result, "budget", None)):
        try:
            found = budget()
        except InputError as error:
            items = [str(error)]
        else:
            items = [*found.sentences(), *found.tables()]
    return Section("Uncertainty budget", tuple(items))
