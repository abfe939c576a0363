"""The uncertainty budget of a result, where it has one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.report import Cell, Shown, Table, significant
from trunnion.machine.budget import SHARED, Budget, Line, Measurand, freedom
from trunnion.models.temperatures import recorded
from trunnion.plot.diagnosis import MAX_PARAMETERS
from trunnion.reports.document import Item, Section
from trunnion.reports.results import with_expanded
from trunnion.setup.names import called

MAX_ROWS = 40
MIN_SHARE = 1e-3  # of the variance of a quantity


def budget_section(
    result: Any, name: Callable[[str], str] = called, *, curves: bool = False
) -> Section:
    """Return the uncertainty budget of a result; empty where it has none.

    name: What people call a quantity. curves: Quantities that are many values of one curve, which
    say nothing one by one, are left out.
    """
    items: list[Item] = []
    if callable(make := getattr(result, "budget", None)):
        try:
            found: Budget = make()
        except InputError as error:
            items = [str(error)]
        else:
            of = Counter(m.name.partition(".")[0] for m in found.measurands)
            kept = [
                m
                for m in found.measurands
                if not curves or of[m.name.partition(".")[0]] <= MAX_PARAMETERS
            ]
            found = replace(found, measurands=tuple(kept))
            items = [*found.sentences(), _table(found, name), *_more(found)] if kept else []
    return Section("Uncertainty budget", tuple(items))


def held_by_u(result: Any, data: Any) -> list[str]:
    """Say which sources U holds, and that it holds no other; nothing without a budget.

    data: What the result was made of.
    """
    if not callable(make := getattr(result, "budget", None)):
        return []
    try:
        lines = [x for m in make().measurands for x in m.lines]
    except InputError:
        return []
    known = [s for s in dict.fromkeys(x.source for x in lines) if s not in SHARED]
    calibrated = [s for s in known if not s.startswith("steps of")]
    held = "scatter and steps of the readings, and the doubt between causes"
    if calibrated:
        return [f"U holds {held}; beside them: {', '.join(known)}. It holds nothing else."]
    if temperatures := recorded(data):
        return [
            f"U holds {held} alone. Calibration of instrument and artefact and alignment are not "
            f"in it: nothing is stated of them. Temperature is not in it, either: {temperatures}."
        ]
    return [
        f"U holds {held} alone. Calibration of instrument and artefact, alignment and temperature "
        "are not in it: nothing is stated of them."
    ]


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
