"""The uncertainty budget of a result, where it has one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.report import Cell, Shown, Table, significant
from trunnion.machine.budget import Budget, Line, Measurand, freedom
from trunnion.reports.document import Item, Section
from trunnion.reports.results import with_expanded
from trunnion.setup.names import called

MAX_ROWS = 40
MIN_SHARE = 1e-3  # of the variance of a quantity


def budget_section(result: Any, name: Callable[[str], str] = called) -> Section:
    """Return the uncertainty budget of a result; empty where it has none.

    name: What people call a quantity.
    """
    items: list[Item] = []
    if callable(make := getattr(result, "budget", None)):
        try:
            found: Budget = make()
        except InputError as error:
            items = [str(error)]
        else:
            items = [*found.sentences(), _table(found, name), *_more(found)]
    return Section("Uncertainty budget", tuple(items))


def _table(found: Budget, name: Callable[[str], str]) -> Table:
    """One quantity a row: value, U, and what of U each source contributes."""
    sources = list(
        dict.fromkeys(x.source for m in found.measurands for x in m.lines if _counts(x, m))
    )
    rows: list[tuple[Cell, ...]] = []
    for m in found.measurands[:MAX_ROWS]:
        parts = {x.source: found.coverage_factor * x.contribution for x in m.lines if _counts(x, m)}
        each = [significant(parts[s], 2) if s in parts else None for s in sources]
        rows.append(
            (name(m.name), *with_expanded(m.value, m.std), m.unit, *each, *_freedom(m.std, m))
        )
    k = f"{found.coverage_factor:g}"
    heads = ("quantity", "value", f"U (k = {k})", "unit", *(f"U by {s}" for s in sources))
    return Table.of("What contributes to U", (*heads, "degrees of freedom"), rows)


def _counts(x: Line, m: Measurand) -> bool:
    """Whether a source is more than a thousandth of the variance."""
    return bool(x.contribution**2 > MIN_SHARE * m.std**2) and bool(np.isfinite(m.std))


def _freedom(std: float, m: Measurand) -> tuple[Shown | None]:
    return (freedom(m.degrees_of_freedom) if np.isfinite(std) else None,)


def _more(found: Budget) -> list[str]:
    """Explain the columns."""
    said = [
        "Contributions add as squares; those below a thousandth of the variance are left out. "
        "Degrees of freedom: how many independent readings the uncertainty itself rests on (GUM, "
        "G.4); ∞ where it was stated."
    ]
    more = len(found.measurands) - MAX_ROWS
    return [*said, f"{more} more quantities are not listed."] if more > 0 else said
